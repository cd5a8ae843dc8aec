"""The solvers under the strictest settings of JAX, which users choose for programs of their own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.optimization import (
    QuadraticProgram,
    Status,
    UnicycleParameters,
    solve_bounded_step_mpc,
    solve_qp,
    solve_step_mpc,
    solve_unicycle,
)
from iwalker_jax.perception.distance_field import signed_distance_field

STEPS = np.stack([0.1 * np.arange(1, 5), -0.05 * (-1.0) ** np.arange(4)], axis=1).astype(np.float32)
# The COM is to the right of the left stance foot, on the side of the next step.
STATE = np.array([[0, 0.02, 0.1], [0, -0.03, 0.0]], np.float32)
PATH = np.stack([np.linspace(0, 1, 8), np.linspace(0, 0.2, 8)], axis=1).astype(np.float32)


def qp(q: jax.Array) -> jax.Array:
    eye = jnp.eye(2, dtype=q.dtype)
    return solve_qp(QuadraticProgram(2 * eye, q, eye, -jnp.ones_like(q), jnp.ones_like(q)))


SOLVERS = {
    "qp": (qp, np.array([-1.0, -9.0], np.float32)),
    "free steps": (lambda steps: solve_step_mpc(steps, STATE), STEPS),
    "bounded steps": (lambda steps: solve_bounded_step_mpc(steps, STATE, jnp.float32(1)), STEPS),
    "unicycle": (
        lambda path: solve_unicycle(path, jnp.zeros(4, jnp.float32), UnicycleParameters(turn_bound=0.5)),
        PATH,
    ),
}


@pytest.fixture
def strict():
    with jax.numpy_rank_promotion("raise"), jax.numpy_dtype_promotion("strict"):
        yield


@pytest.mark.parametrize("name", SOLVERS)
def test_solvers_do_not_depend_on_promotion(name, strict):
    """Property: values of a compiled batch and gradients of a compiled call are computed, whatever is promoted."""
    solve, inputs = SOLVERS[name]
    statuses = jax.vmap(jax.jit(lambda x: solve(x).status))(jnp.stack([inputs, inputs]))
    assert np.all(np.asarray(statuses) == Status.CONVERGED)

    @jax.jit
    def size(x: jax.Array) -> jax.Array:
        return jnp.sum(jnp.square(jax.tree.leaves(solve(x).value)[0]))

    assert np.all(np.isfinite(jax.grad(size)(jnp.asarray(inputs))))


def test_distance_field_does_not_depend_on_promotion(strict):
    occupied = jnp.zeros((6, 9), bool).at[2, 3].set(True)
    field = signed_distance_field(occupied, 0.1)
    assert float(field[2, 5]) == pytest.approx(0.15)


def test_distance_field_in_double_precision(x64):
    """Oracle: by hand, two cells away less half a cell."""
    occupied = jnp.zeros((6, 40), bool).at[2, 3].set(True)
    assert float(signed_distance_field(occupied, 0.1)[2, 30]) == pytest.approx(2.65)

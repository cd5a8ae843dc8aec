"""Derivatives of quadratic programs against finite differences, for every input."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.problems.hard_qps import hard_qps
from iwalker_jax.optimization import QpSettings, QuadraticProgram, Status, solve_qp
from tests.gradients import assert_gradients_agree

FIELDS = ("P", "q", "C", "low", "high")


def point(gradient, settings, *arrays):
    """x and y in one vector; P enters by its symmetric part, as in the solver."""
    value = solve_qp(QuadraticProgram(*arrays), settings=settings, gradient=gradient).value
    return jnp.concatenate([value.x, value.y])


def case(name: str, seed: int = 0) -> list[jax.Array]:
    return [jnp.asarray(getattr(hard_qps(seed)[name], field)) for field in FIELDS]


@pytest.mark.parametrize("method", ["active_set", "admm"])
def test_implicit_gradients(x64, method):
    """Oracle: central differences, forward and reverse, for P, q, C, low and high, through vmap.

    The bounds of an equality move together, by their middle; those of an inequality also apart.
    """
    names, settings = ("benign", "equalities", "semidefinite", "one-sided"), QpSettings(method, tolerance=1e-12)
    P, q, C, low, high = (jnp.stack(arrays) for arrays in zip(*(case(name) for name in names)))
    solution = jax.jit(jax.vmap(lambda program: solve_qp(program, None, settings)))(
        QuadraticProgram(P, q, C, low, high)
    )
    assert np.all(solution.status == Status.CONVERGED) and np.all(solution.gradient_valid)
    apart, both = (high > low) & jnp.isfinite(low), jnp.isfinite(low)
    solve = jax.vmap(lambda *a: point("implicit", settings, *a))

    def batch(P, q, C, middle, half):
        half = jnp.where(apart, half, 0)
        return solve(P, q, C, jnp.where(both, middle - half, -jnp.inf), middle + half)

    middle, half = jnp.where(both, (low + high) / 2, high), jnp.where(both, (high - low) / 2, 0)
    assert_gradients_agree(jax.jit(batch), P, q, C, middle, half)


def test_unrolled_gradients(x64):
    """Oracle: central differences of ADMM's own answer, and the implicit gradient at the optimum."""
    arrays = case("benign")
    settings = QpSettings(admm_iterations=300)
    assert_gradients_agree(jax.jit(lambda *a: point("unrolled", settings, *a)), *arrays, tolerance=1e-4)
    slope = [
        jax.jit(jax.grad(lambda q, g=g, s=s: jnp.sum(point(g, s, arrays[0], q, *arrays[2:]) ** 2)))(arrays[1])
        for g, s in (("unrolled", QpSettings(admm_iterations=3000)), ("implicit", QpSettings()))
    ]
    np.testing.assert_allclose(slope[0], slope[1], rtol=1e-4)


def test_stopped_gradients_are_zero():
    arrays = [a.astype(jnp.float32) for a in case("benign")]
    slope = jax.grad(lambda q: jnp.sum(point("stopped", QpSettings(), arrays[0], q, *arrays[2:])))(arrays[1])
    assert not np.any(slope)


def test_gradients_are_finite_whatever_happens():
    """Property: no NaN leaves the solver, in value or gradient, on any hard program."""

    def loss(arrays):
        return jnp.sum(point("implicit", QpSettings(), *arrays) ** 2)

    slope = jax.jit(jax.grad(loss))
    for name in hard_qps():
        arrays = [a.astype(jnp.float32) for a in case(name)]
        for result in slope(arrays):
            assert np.all(np.isfinite(result)), name
    bad = [a.astype(jnp.float32) for a in case("benign")]
    bad[1] = bad[1].at[0].set(jnp.nan)
    assert all(np.all(np.isfinite(result)) for result in slope(bad))


def test_gradient_is_flagged_at_a_change_of_the_active_set(x64):
    """A bound that touches without pushing: one-sided derivatives differ, so none is valid."""
    eye = jnp.eye(2)
    touching = QuadraticProgram(eye, -jnp.ones(2), eye, jnp.full(2, -jnp.inf), jnp.array([1.0, 5.0]))
    solution = solve_qp(touching)
    assert int(solution.status) == Status.CONVERGED and not bool(solution.gradient_valid)
    np.testing.assert_allclose(solution.value.x, 1.0)

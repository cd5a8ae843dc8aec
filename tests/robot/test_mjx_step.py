"""`mjx.step` behind the same interface as our step: equal values from many states, no reverse mode."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.robot.dynamics import smooth_stages
from iwalker_jax.robot.mjx_step import complete_step_by_mjx
from iwalker_jax.robot.physics import PhysicsState, complete_step
from iwalker_jax.robot.variation import vary

STATES = 48


def drawn_states(bruce, robot, dtype):
    """Equal shares of states that stand, press into the floor in motion, fly, and fly with joints past their limits."""
    rng = np.random.default_rng(1)
    qpos = np.tile(bruce.key_qpos[0], (STATES, 1))
    kind = np.arange(STATES) % 4
    qpos[:, 2] += np.select([kind == 0, kind == 1], [-0.0005, -0.003], 0.3)
    qpos[:, 3:7] += rng.normal(size=(STATES, 4)) * np.select([kind == 0, kind == 1], [0, 0.003], 0.3)[:, None]
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1)[:, None]
    qpos[:, 7:] += rng.normal(size=(STATES, 16)) * np.where(kind == 3, 0.8, 0.02)[:, None]
    qvel = rng.normal(size=(STATES, 22)) * np.where(kind == 0, 0.05, 0.5)[:, None]
    warmstart = rng.normal(size=(STATES, 22))
    states = PhysicsState(*(jnp.asarray(x, dtype) for x in (qpos, qvel, warmstart, np.zeros(STATES))))
    inputs = {
        "torques": 2 * rng.normal(size=(STATES, 16)),
        "pushes": 5 * rng.normal(size=(STATES, 6)),
        "friction": rng.uniform(0.3, 1.0, STATES),
        "mass": rng.uniform(0.9, 1.1, STATES),
    }
    return states, {name: jnp.asarray(value, dtype) for name, value in inputs.items()}, kind


@jax.jit
def both(robot, states, inputs):
    """One step of every state, by ours and by MJX's."""

    def one(state, inputs):
        plant = vary(robot, mass_scale=inputs["mass"], friction=inputs["friction"])
        data = smooth_stages(plant, state.qpos, state.qvel)
        given = (plant, state, data, inputs["torques"], inputs["pushes"])
        return complete_step(*given), complete_step_by_mjx(*given)

    return jax.vmap(one)(states, inputs)


def assert_equal_steps(ours, theirs, tolerance):
    """Every number of state and information, but for the solvers' own, relative to the largest of its kind."""
    for one, other in zip(ours, theirs, strict=True):
        for name in set(one._fields) - {"residual", "iterations"}:
            mine, given = np.asarray(getattr(one, name)), np.asarray(getattr(other, name))
            if mine.dtype == bool:
                np.testing.assert_array_equal(mine, given, err_msg=name)
            else:
                np.testing.assert_allclose(mine, given, atol=tolerance * max(1.0, np.abs(mine).max()), err_msg=name)


def test_a_step_from_any_state_is_mjxs(bruce, robot64, x64):
    """Oracle: `mjx.step`, on robots of different mass and friction under random torques and pushes."""
    states, inputs, kind = drawn_states(bruce, robot64, jnp.float64)
    ours, theirs = both(robot64, states, inputs)
    touching = np.asarray(ours[1].touching).any(axis=1)
    assert touching[kind < 2].mean() > 0.8
    assert not touching[kind > 1].any()
    assert_equal_steps(ours, theirs, 1e-8)
    assert np.max(theirs[1].residual) < 1e-9
    assert np.all(theirs[1].iterations == -1)


def test_a_step_in_single_precision_is_mjxs(bruce, robot):
    """Oracle: the same, to rounding of contacts that are 10 times as stiff along the floor as upwards."""
    states, inputs, _ = drawn_states(bruce, robot, jnp.float32)
    ours, theirs = both(robot, states, inputs)
    for part in (0, 1):
        np.testing.assert_allclose(theirs[0][part], ours[0][part], atol=2e-3)


def test_reverse_mode_is_refused(bruce, robot):
    """Property: JAX has no reverse mode of the loop in `mjx.step`, which is why the step here is our own."""
    states, inputs, _ = drawn_states(bruce, robot, jnp.float32)
    state, torques = jax.tree.map(lambda leaf: leaf[0], (states, inputs["torques"]))
    data = smooth_stages(robot, state.qpos, state.qvel)
    with pytest.raises(ValueError, match=r"[Rr]everse-mode differentiation does not work"):
        jax.eval_shape(jax.grad(lambda x: jnp.sum(complete_step_by_mjx(robot, state, data, x)[0].qvel)), torques)

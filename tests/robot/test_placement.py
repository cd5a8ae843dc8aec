"""Placing COM and feet: C MuJoCo says where they are, finite differences say the derivatives."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from iwalker_jax.robot.placement import place_robot
from tests.gradients import assert_gradients_agree

COM, COM_VELOCITY = np.array([0.01, -0.03, 0.365]), np.array([0.3, -0.1, 0.0])
FEET, FEET_VELOCITIES = np.array([[0.04, -0.12, 0.02], [0.0, 0.0, 0.0]]), np.array([[0.5, 0.1, -0.2], [0.0, 0.0, 0.0]])


@pytest.fixture
def place(robot64, x64):
    return jax.jit(lambda *wanted: place_robot(robot64, *wanted))


def wanted(far: float = 0.0) -> tuple[jax.Array, ...]:
    feet = FEET + np.array([[far, 0, 0], [0, 0, 0]])
    return tuple(map(jnp.asarray, (COM, COM_VELOCITY, feet, FEET_VELOCITIES)))


def test_com_and_feet_are_and_move_as_wanted(place, bruce):
    state = place(*wanted())
    assert bool(state.converged)
    model, data = bruce, mujoco.MjData(bruce)
    data.qpos[:], data.qvel[:] = state.qpos, state.qvel
    mujoco.mj_forward(model, data)
    jacobian, base = np.zeros((3, model.nv)), int(model.jnt_bodyid[0])
    np.testing.assert_allclose(data.subtree_com[base], COM, atol=1e-7)
    mujoco.mj_jacSubtreeCom(model, data, jacobian, base)
    np.testing.assert_allclose(jacobian @ data.qvel, COM_VELOCITY, atol=1e-7)
    for k, name in enumerate(("midfoot_r", "midfoot_l")):
        site = model.site(name).id
        np.testing.assert_allclose(data.site_xpos[site], FEET[k], atol=1e-7)
        np.testing.assert_allclose(data.site_xmat[site][[3, 6]], 0, atol=1e-7)  # along x, and flat
        mujoco.mj_jacSite(model, data, jacobian, None, site)
        np.testing.assert_allclose(jacobian @ data.qvel, FEET_VELOCITIES[k], atol=1e-7)


def test_derivatives_are_those_of_the_state(place):
    def state(*x):
        placement = place(*x)
        return jnp.concatenate([placement.qpos, placement.qvel])

    assert_gradients_agree(state, *wanted(), tolerance=1e-4)


def test_what_is_out_of_reach_is_the_home_posture_without_derivatives(place):
    state = place(*wanted(far=0.5))
    assert not bool(state.converged)
    np.testing.assert_array_equal(state.qvel, 0)
    slope = jax.grad(lambda feet: jnp.sum(place(*wanted()[:2], feet, wanted()[3]).qpos))(wanted(far=0.5)[2])
    np.testing.assert_array_equal(slope, 0)

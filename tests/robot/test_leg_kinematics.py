"""Leg kinematics against C MuJoCo."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from bruce_model import BRUCE_XML
from iwalker_jax.errors import InputError
from iwalker_jax.robot.leg_kinematics import foot_jacobian, foot_motion, load_leg_kinematics
from tests.gradients import assert_gradients_agree

POINTS = ("midfoot", "toe", "heel")


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_path(str(BRUCE_XML))


def random_state(model, rng):
    """Any base pose, joints all over their ranges."""
    qpos = model.qpos0 + np.concatenate([rng.normal(size=7), rng.uniform(-1.5, 1.5, model.nq - 7)])
    qpos[3:7] /= np.linalg.norm(qpos[3:7])
    return qpos, 3 * rng.normal(size=model.nv)


@pytest.mark.parametrize("point", POINTS)
def test_position_velocity_and_jacobian_equal_mujoco(x64, model, point):
    """Oracle: mj_forward, mj_jacSite and site velocities, taken to the base frame."""
    legs, data, rng = load_leg_kinematics(model), mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(5):
        data.qpos[:], data.qvel[:] = random_state(model, rng)
        mujoco.mj_forward(model, data)
        motion = foot_motion(legs, jnp.asarray(data.qpos[7:]), jnp.asarray(data.qvel[6:]), point)
        jacobian = foot_jacobian(legs, jnp.asarray(data.qpos[7:]), point)
        to_base = data.xmat[model.jnt_bodyid[0]].reshape(3, 3).T
        for leg, side in enumerate("rl"):
            site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{point}_{side}")
            full = np.zeros((3, model.nv))
            mujoco.mj_jacSite(model, data, full, None, site)
            position = to_base @ (data.site_xpos[site] - data.qpos[:3])
            np.testing.assert_allclose(motion.position[leg], position, atol=1e-12)
            np.testing.assert_allclose(motion.velocity[leg], to_base @ full[:, 6:] @ data.qvel[6:], atol=1e-11)
            columns = slice(6 + 5 * leg, 11 + 5 * leg)
            np.testing.assert_allclose(jacobian[leg], to_base @ full[:, columns], atol=1e-12)


def test_float32_is_good_to_a_micrometre(model):
    """Oracle: C MuJoCo in double precision."""
    legs, data, rng = load_leg_kinematics(model), mujoco.MjData(model), np.random.default_rng(1)
    data.qpos[:], data.qvel[:] = random_state(model, rng)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    motion = jax.jit(foot_motion, static_argnames="point")(
        legs, jnp.asarray(data.qpos[7:], jnp.float32), jnp.asarray(data.qvel[6:], jnp.float32)
    )
    assert motion.position.dtype == jnp.float32
    np.testing.assert_allclose(motion.position, [data.site("midfoot_r").xpos, data.site("midfoot_l").xpos], atol=1e-6)


def test_gradients(x64, model):
    """Oracle: central differences, forward and reverse mode."""
    legs, rng = load_leg_kinematics(model), np.random.default_rng(2)
    qpos, qvel = random_state(model, rng)
    assert_gradients_agree(
        lambda q, v: jnp.stack(foot_motion(legs, q, v)), jnp.asarray(qpos[7:]), jnp.asarray(qvel[6:])
    )


def test_other_robots_are_refused_with_a_sentence():
    fixed = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body><geom size='.1'/></body></worldbody></mujoco>")
    with pytest.raises(InputError, match="floating base"):
        load_leg_kinematics(fixed)
    footless = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(InputError, match="no site 'midfoot_r'"):
        load_leg_kinematics(footless)
    legless = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/><site name='midfoot_r'/><site name='midfoot_l'/>"
        "</body></worldbody></mujoco>"
    )
    with pytest.raises(InputError, match="must be hinges"):
        load_leg_kinematics(legless)

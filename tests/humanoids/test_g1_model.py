"""The G1 as it is built for walking is the G1 of its own MJCF; oracle: MuJoCo on that file as it is."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from iwalker_jax.robot import (
    foot_motion,
    initial_state,
    load_leg_kinematics,
    load_robot_model,
    physics_step,
    rigid_body_terms,
)


@pytest.fixture(scope="module")
def standing(g1_model):
    data = mujoco.MjData(g1_model)
    mujoco.mj_resetDataKeyframe(g1_model, data, 0)
    mujoco.mj_forward(g1_model, data)
    return data


def test_mass_com_and_inertia_are_the_originals(g1_model, standing, g1_original):
    model, data = g1_original
    data.qpos[:7] = standing.qpos[:7]
    mujoco.mj_forward(model, data)
    assert g1_model.body_subtreemass[1] == pytest.approx(model.body_subtreemass[1], rel=1e-9)
    np.testing.assert_allclose(standing.subtree_com[1], data.subtree_com[1], atol=1e-6)
    matrices = []
    for m, d in ((g1_model, standing), (model, data)):
        full = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, d, full)
        matrices.append(full[:6, :6])  # of the whole robot as one body
    np.testing.assert_allclose(*matrices, atol=1e-5)


def test_legs_move_as_the_originals(g1, g1_model, g1_original, rng):
    """Also the joints' ranges, armature and torque limits."""
    model, data = g1_original
    mine = mujoco.MjData(g1_model)
    mine.qpos[:7] = data.qpos[:7] = [0, 0, 1, 1, 0, 0, 0]
    for joint in (*g1.anatomy.right_leg, *g1.anatomy.left_leg):
        here, there = g1_model.joint(joint), model.joint(joint)
        np.testing.assert_allclose(here.range, there.range)
        np.testing.assert_allclose(g1_model.dof_armature[here.dofadr[0]], model.dof_armature[there.dofadr[0]])
        np.testing.assert_allclose(g1_model.actuator(joint).forcerange, model.jnt_actfrcrange[there.id])
        mine.qpos[here.qposadr[0]] = data.qpos[there.qposadr[0]] = rng.uniform(*there.range)
    mujoco.mj_kinematics(g1_model, mine)
    mujoco.mj_kinematics(model, data)
    for foot in (g1.anatomy.right_foot, g1.anatomy.left_foot):
        np.testing.assert_allclose(mine.body(foot).xpos, data.body(foot).xpos, atol=1e-6)
        np.testing.assert_allclose(mine.body(foot).xmat, data.body(foot).xmat, atol=1e-6)


def test_it_stands_with_level_soles_on_the_points_where_its_own_feet_touch(g1, standing, g1_original):
    model, data = g1_original
    data.qpos[:7] = standing.qpos[:7]
    mujoco.mj_kinematics(model, data)
    for side, foot in (("r", g1.anatomy.right_foot), ("l", g1.anatomy.left_foot)):
        body = model.body(foot).id
        own = [data.geom_xpos[g] for g in range(model.ngeom) if model.geom_bodyid[g] == body and model.geom_contype[g]]
        corners = [
            standing.site(f"{end}_{edge}_{side}").xpos for end in ("front", "back") for edge in ("outer", "inner")
        ]
        np.testing.assert_allclose(np.array(corners)[:, 2], 0.0, atol=1e-6)
        for point in own:  # spheres of 5 mm, the hind ones 5 mm closer together than the front ones
            assert min(np.linalg.norm(point[:2] - corner[:2]) for corner in corners) < 0.006
            assert point[2] == pytest.approx(0.005, abs=1e-3)


def test_rigid_body_terms_are_mujocos(g1_model, rng):
    with jax.enable_x64(True):
        robot = load_robot_model(g1_model)
        data = mujoco.MjData(g1_model)
        mujoco.mj_resetDataKeyframe(g1_model, data, 0)
        data.qpos[7:] += rng.uniform(-0.2, 0.2, 12)
        data.qvel[:] = rng.normal(0, 0.5, 18)
        mujoco.mj_forward(g1_model, data)
        terms = rigid_body_terms(robot, jnp.asarray(data.qpos), jnp.asarray(data.qvel))
        matrix = np.zeros((18, 18))
        mujoco.mj_fullM(g1_model, data, matrix)
        np.testing.assert_allclose(terms.mass_matrix, matrix, atol=1e-8)
        np.testing.assert_allclose(terms.bias, data.qfrc_bias, atol=1e-7)
        assert terms.contact_positions.shape == (8, 3)
        for k, geom in enumerate(robot.contact_geoms):
            site = g1_model.site(g1_model.geom(geom).name).id
            jacobian = np.zeros((3, 18))
            mujoco.mj_jacSite(g1_model, data, jacobian, None, site)
            np.testing.assert_allclose(terms.contact_positions[k], data.site_xpos[site], atol=1e-9)
            np.testing.assert_allclose(terms.contact_jacobians[k], jacobian, atol=1e-9)
        foot = foot_motion(
            load_leg_kinematics(g1_model), jnp.asarray(data.qpos[7:]), jnp.asarray(data.qvel[6:])
        ).position
        base = data.xmat[1].reshape(3, 3)
        seen = [base.T @ (data.site(name).xpos - data.qpos[:3]) for name in ("midfoot_r", "midfoot_l")]
        np.testing.assert_allclose(foot, seen, atol=1e-9)


def test_our_step_of_the_physics_is_mujocos(g1_model, rng):
    with jax.enable_x64(True):
        robot = load_robot_model(g1_model)
        data = mujoco.MjData(g1_model)
        mujoco.mj_resetDataKeyframe(g1_model, data, 0)
        data.qpos[2] -= 1e-3
        torques = rng.uniform(-10, 10, 12)
        after, info = jax.jit(physics_step)(robot, initial_state(robot, jnp.asarray(data.qpos)), jnp.asarray(torques))
        data.ctrl[:] = torques
        mujoco.mj_step(g1_model, data)
        assert np.sum(info.touching) >= 4
        np.testing.assert_allclose(after.qvel, data.qvel, atol=1e-6)
        np.testing.assert_allclose(after.qpos, data.qpos, atol=1e-8)

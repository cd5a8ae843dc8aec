"""Rigid-body terms against C MuJoCo; derivatives against central differences of C MuJoCo."""

from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import bruce_model
from iwalker_jax.robot.model import load_robot_model
from iwalker_jax.robot.rigid_body import rigid_body_terms
from iwalker_jax.robot.structure import FEET, contact_point_names

compute = jax.jit(rigid_body_terms)
derivative = jax.jit(lambda robot, state, change: jax.jvp(lambda q, v: rigid_body_terms(robot, q, v), state, change)[1])


def random_state(model, rng, speed):
    qpos = np.concatenate([rng.normal(size=7), rng.uniform(-1.5, 1.5, model.nq - 7)])
    qpos[3:7] /= np.linalg.norm(qpos[3:7])
    return qpos, speed * rng.normal(size=model.nv)


def mujoco_terms(model, qpos, qvel):
    """The same quantities from C MuJoCo's own functions."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    mass_matrix, com_jacobian = np.zeros((model.nv, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_fullM(model, data, mass_matrix)
    mujoco.mj_jacSubtreeCom(model, data, com_jacobian, 1)
    terms = {
        "mass_matrix": mass_matrix,
        "bias": data.qfrc_bias.copy(),
        "mass": model.body_subtreemass[1],
        "com": data.subtree_com[1],
        "com_velocity": data.subtree_linvel[1],
        "com_jacobian": com_jacobian,
        "angular_momentum": data.subtree_angmom[1],
        "base_rotation": data.xmat[1].reshape(3, 3),
    }
    jacobians, rates = [], []
    for name in contact_point_names(model) + FEET:
        site = model.site(name).id
        jacobian, rate = np.zeros((6, model.nv)), np.zeros((6, model.nv))
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
        mujoco.mj_jacDot(model, data, rate[:3], rate[3:], data.site_xpos[site], model.site_bodyid[site])
        jacobians.append(jacobian)
        rates.append(rate @ qvel)
    jacobians, rates = np.array(jacobians), np.array(rates)
    sites = [model.site(name).id for name in contact_point_names(model) + FEET]
    torso = np.zeros((3, model.nv))
    mujoco.mj_jacBody(model, data, None, torso, 1)
    return terms | {
        "contact_positions": data.site_xpos[sites[:4]],
        "contact_jacobians": jacobians[:4, :3],
        "contact_velocities": (jacobians @ qvel)[:4, :3],
        "contact_bias_accelerations": rates[:4, :3],
        "foot_positions": data.site_xpos[sites[4:]],
        "foot_rotations": data.site_xmat[sites[4:]].reshape(2, 3, 3),
        "foot_jacobians": jacobians[4:],
        "foot_velocities": (jacobians @ qvel)[4:],
        "foot_bias_accelerations": rates[4:],
        "torso_jacobian": torso,
        "torso_angular_velocity": torso @ qvel,
        "torso_bias": np.zeros(3),
    }


@pytest.mark.parametrize("speed", [0.0, 1.0, 20.0])
def test_terms_are_mujocos(bruce, robot64, x64, rng, speed):
    for _ in range(3):
        qpos, qvel = random_state(bruce, rng, speed)
        terms = compute(robot64, jnp.asarray(qpos), jnp.asarray(qvel))
        for name, expected in mujoco_terms(bruce, qpos, qvel).items():
            scale = max(1.0, np.abs(expected).max())
            np.testing.assert_allclose(getattr(terms, name), expected, atol=1e-10 * scale, err_msg=name)


def test_single_precision(bruce, robot, rng):
    qpos, qvel = random_state(bruce, rng, 3.0)
    terms = compute(robot, jnp.asarray(qpos, jnp.float32), jnp.asarray(qvel, jnp.float32))
    for name, expected in mujoco_terms(bruce, qpos, qvel).items():
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(getattr(terms, name), expected, atol=1e-5 * scale, err_msg=name)


def test_rates_of_momenta(bruce, robot64, x64, rng):
    """COM and angular-momentum biases are the rates at zero acceleration, by central differences along the motion."""
    qpos, qvel = random_state(bruce, rng, 2.0)
    terms = compute(robot64, jnp.asarray(qpos), jnp.asarray(qvel))
    step, sides = 1e-6, []
    for sign in (1, -1):
        moved = qpos.copy()
        mujoco.mj_integratePos(bruce, moved, qvel, sign * step)
        sides.append(mujoco_terms(bruce, moved, qvel))
    for bias, of in (("com_bias_acceleration", "com_velocity"), ("angular_momentum_bias", "angular_momentum")):
        rate = (sides[0][of] - sides[1][of]) / (2 * step)
        np.testing.assert_allclose(getattr(terms, bias), rate, atol=1e-7 * max(1, np.abs(rate).max()), err_msg=bias)
    np.testing.assert_allclose(terms.angular_momentum_jacobian @ qvel, terms.angular_momentum, atol=1e-10)


def test_derivatives_are_those_of_mujoco(bruce, robot64, x64, rng):
    """Forward mode against central differences of C MuJoCo, along positions (all but the quaternion) and velocities."""
    qpos, qvel = random_state(bruce, rng, 2.0)
    along_qpos, along_qvel = rng.normal(size=bruce.nq), rng.normal(size=bruce.nv)
    along_qpos[3:7] = 0
    changed = derivative(
        robot64,
        (jnp.asarray(qpos), jnp.asarray(qvel)),
        (jnp.asarray(along_qpos), jnp.asarray(along_qvel)),
    )
    step = 1e-6
    ahead = mujoco_terms(bruce, qpos + step * along_qpos, qvel + step * along_qvel)
    behind = mujoco_terms(bruce, qpos - step * along_qpos, qvel - step * along_qvel)
    for name in ahead:
        numeric = (ahead[name] - behind[name]) / (2 * step)
        scale = max(1.0, np.abs(numeric).max())
        np.testing.assert_allclose(getattr(changed, name), numeric, atol=1e-7 * scale, err_msg=name)


def rebuilt(text: str) -> str:
    """The robot with both hip hinges on one body, the emptied body welded to it, and a hand welded to each forearm."""
    root = ElementTree.fromstring(text)
    for side in "rl":
        outer, inner = (root.find(f".//body[@name='{name}_{side}']") for name in ("hip_pitch", "thigh"))
        parent = root.find(f".//body[@name='hip_yaw_{side}']")
        hinge = outer.find("joint")
        outer.remove(hinge)
        outer.remove(inner)
        parent.remove(outer)
        parent.append(inner)
        inner.insert(0, hinge)
        inner.append(outer)
        hand = ElementTree.SubElement(root.find(f".//joint[@name='elbow_pitch_{side}']/.."), "body", pos="0 0 -0.1")
        hand.set("euler", "0.3 0.2 0.1")
        ElementTree.SubElement(hand, "inertial", pos="0.01 0 0", mass="0.05", diaginertia="1e-5 2e-5 2.5e-5")
    return ElementTree.tostring(root, encoding="unicode")


def test_bodies_with_several_or_no_joints(x64, rng):
    model = mujoco.MjModel.from_xml_string(rebuilt(bruce_model.mjcf_text()))
    robot = load_robot_model(model)
    qpos, qvel = random_state(model, rng, 3.0)
    terms = compute(robot, jnp.asarray(qpos), jnp.asarray(qvel))
    for name, expected in mujoco_terms(model, qpos, qvel).items():
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(getattr(terms, name), expected, atol=1e-10 * scale, err_msg=name)

"""The whole-body QP against NumPy's equations of motion, quadprog, and C MuJoCo's inverse dynamics."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
import quadprog

from iwalker_jax.control.controller import control_step, initial_controller, make_controller
from iwalker_jax.control.footstep_plan import make_plan, velocity_footsteps
from iwalker_jax.control.whole_body import reduced_dynamics
from iwalker_jax.optimization import Status
from iwalker_jax.robot import rigid_body_terms


@pytest.fixture(scope="module")
def decide(bruce, controller):
    """One control tick at a given state, compiled once: (torques, memory, info, terms)."""

    def tick(qpos, qvel, plan, memory):
        terms = rigid_body_terms(bruce, qpos, qvel)
        memory = initial_controller(controller, terms) if memory is None else memory
        arms = qpos[17:], qvel[16:]
        return *control_step(controller, terms, arms, jnp.ones(2, bool), plan, memory), terms

    return jax.jit(tick)


@pytest.fixture(scope="module")
def walk_plan():
    return make_plan(*velocity_footsteps(0.1, 0.0, 0.0, 8, 0.24, 0.1, 1), 1)


def disturbed(bruce, seed: int) -> tuple[jax.Array, jax.Array]:
    rng = np.random.default_rng(seed)
    qpos = np.array(bruce.home)
    qpos[7:] += rng.uniform(-0.1, 0.1, 16)
    return jnp.asarray(qpos, jnp.float32), jnp.asarray(rng.normal(0, 0.2, 22), jnp.float32)


def test_reduced_dynamics_are_the_equations_of_motion(bruce):
    qpos, qvel = disturbed(bruce, 0)
    terms = rigid_body_terms(bruce, qpos, qvel)
    carrying = jnp.asarray([1.0, 1.0, 0.0, 0.0])
    rng = np.random.default_rng(1)
    arms, x = rng.normal(size=6), rng.normal(size=22)
    dynamics = reduced_dynamics(terms, carrying, jnp.asarray(arms, jnp.float32))
    acceleration = dynamics.acceleration @ x + dynamics.acceleration_offset
    torque = np.concatenate([np.zeros(6), dynamics.torque @ x + dynamics.torque_offset])
    forces = x[10:].reshape(4, 3) * np.asarray(carrying)[:, None]
    jacobians = np.asarray(terms.contact_jacobians, np.float64)
    left = np.asarray(terms.mass_matrix, np.float64) @ acceleration + terms.bias
    right = torque + np.einsum("cij,ci->j", jacobians, forces)
    np.testing.assert_allclose(left, right, atol=2e-3)
    np.testing.assert_allclose(acceleration[16:], arms, atol=1e-6)


def test_standing_forces_carry_the_weight_and_torques_are_inverse_dynamics(bruce, bruce_mujoco, decide):
    qpos, qvel = jnp.asarray(bruce.home, jnp.float32), jnp.zeros(22, jnp.float32)
    plan = make_plan(np.zeros((0, 2)), np.zeros(0), 0)
    torques, _, info, terms = decide(qpos, qvel, plan, None)
    assert int(info.solution.status) == Status.CONVERGED
    np.testing.assert_allclose(np.sum(info.forces, 0), [0, 0, float(terms.mass) * 9.81], atol=0.3)
    data = mujoco.MjData(bruce_mujoco)
    data.qpos[:] = qpos
    data.qvel[:] = 0
    mujoco.mj_forward(bruce_mujoco, data)
    # Joint torques that hold the posture against gravity and the planned forces, by MuJoCo's own quantities.
    push = np.zeros(22)
    for site, force in zip(("toe_r", "heel_r", "toe_l", "heel_l"), np.asarray(info.forces, np.float64)):
        jacobian = np.zeros((3, 22))
        mujoco.mj_jacSite(bruce_mujoco, data, jacobian, None, bruce_mujoco.site(site).id)
        push += jacobian.T @ force
    wanted = (data.qfrc_bias - push)[6:]
    got = np.asarray(bruce.motor_moments, np.float64).T[6:] @ np.asarray(torques, np.float64)
    np.testing.assert_allclose(got, wanted, atol=0.15)


@pytest.mark.parametrize("seed", range(4))
def test_solution_is_quadprogs(bruce, decide, walk_plan, seed):
    qpos, qvel = disturbed(bruce, seed)
    _, memory, _, _ = decide(qpos, qvel, walk_plan, None)
    walking = memory.gait._replace(mode=jnp.asarray(2, jnp.int32), phase=jnp.asarray(0.4, jnp.float32))
    torques, _, info, _ = decide(qpos, qvel, walk_plan, memory._replace(gait=walking))
    p = info.program
    hessian, linear, rows = (np.asarray(a, np.float64) for a in (p.P, p.q, p.C))
    low, high = np.asarray(p.low, np.float64), np.asarray(p.high, np.float64)
    finite_low, finite_high = np.isfinite(low), np.isfinite(high)
    sides = np.concatenate([rows[finite_low], -rows[finite_high]])
    bounds = np.concatenate([low[finite_low], -high[finite_high]])
    x = quadprog.solve_qp((hessian + hessian.T) / 2, -linear, sides.T, bounds)[0]
    np.testing.assert_allclose(info.solution.value.x, x, atol=1e-2 * np.abs(x).max())
    swing = np.asarray(info.forces)[2 * (1 - int(walking.stance)) : 2 * (1 - int(walking.stance)) + 2]
    np.testing.assert_allclose(swing, 0, atol=1e-3)
    assert np.all(np.abs(torques) <= np.asarray(bruce.motor_limits)[:, 1] + 1e-6)


def test_a_mirrored_robot_gets_mirrored_torques(bruce, decide):
    """Standing with the body leaning left or right."""
    plan = make_plan(np.zeros((0, 2)), np.zeros(0), 0)
    joints = list(bruce.joint_names)
    mirror = [joints.index(n[:-1] + ("l" if n.endswith("r") else "r")) for n in joints]
    sign = np.array([1.0 if "pitch" in n and "shoulder" not in n and "elbow" not in n else -1.0 for n in joints])
    lean = 0.03
    results = []
    for side in (1.0, -1.0):
        qpos = np.array(bruce.home)
        offset = np.where(np.array([n.endswith("_l") for n in joints]), lean, 0.01) * np.array(
            ["roll" in n for n in joints]
        )
        qpos[7:] += offset if side > 0 else sign * offset[mirror]
        torques, *_ = decide(jnp.asarray(qpos, jnp.float32), jnp.zeros(22, jnp.float32), plan, None)
        results.append(np.asarray(bruce.motor_moments).T[6:] @ np.asarray(torques))
    np.testing.assert_allclose(results[1], sign * results[0][mirror], atol=6e-2)  # single precision QP


def test_controller_reports_its_period(bruce):
    assert make_controller(bruce).time_step == pytest.approx(bruce.time_step)

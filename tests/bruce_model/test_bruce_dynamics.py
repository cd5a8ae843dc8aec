"""Dynamics of C MuJoCo's model against plain NumPy: mass matrix with rotors, gravity, mirror image, motor torques."""

import mujoco
import numpy as np
import pytest

from bruce_model import crouch_qpos
from tests.bruce_model.numpy_robot import (
    LEGS,
    link_mass_matrix,
    mirrored_qpos,
    potential_energy,
    random_qpos,
    rotor_matrix,
    velocity_mirror,
)


def state_at(model, qpos, qvel=None) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    if qvel is not None:
        data.qvel[:] = qvel
    mujoco.mj_forward(model, data)
    return data


def mass_matrix(model, data) -> np.ndarray:
    """M by products with unit vectors: (22, 22)."""
    columns = np.zeros((model.nv, model.nv))
    for column, unit in zip(columns, np.eye(model.nv)):
        mujoco.mj_mulM(model, data, column, unit)
    return columns.T


def test_mass_matrix_is_the_links_plus_every_rotor(model):
    rng = np.random.default_rng(4)
    for qpos in (crouch_qpos(), random_qpos(rng), random_qpos(rng)):
        mass = mass_matrix(model, state_at(model, qpos))
        np.testing.assert_allclose(mass, link_mass_matrix(qpos) + rotor_matrix(), atol=1e-10)
    # The numbers that the transmission gives by hand: two rotors at pitch, roll and knee, one shared by knee and ankle.
    for dofs in LEGS.values():
        leg = (mass - link_mass_matrix(qpos))[dofs, dofs]
        np.testing.assert_allclose(np.diag(leg), np.array([1, 2, 2, 2, 1]) * 0.00182, atol=1e-10)
        np.testing.assert_allclose([leg[3, 4], leg[1, 2]], [0.00182, 0.0], atol=1e-10)


def test_gravity_torques_are_the_potential_energy_s_slope(model):
    """Central differences of the NumPy potential energy along each degree of freedom."""
    rng = np.random.default_rng(5)
    for qpos in (crouch_qpos(), random_qpos(rng)):
        data = state_at(model, qpos)
        slope, step = np.zeros(model.nv), 1e-5
        for dof, unit in enumerate(np.eye(model.nv)):
            energies = []
            for sign in (1, -1):
                moved = qpos.copy()
                mujoco.mj_integratePos(model, moved, sign * unit, step)
                energies.append(potential_energy(moved))
            slope[dof] = (energies[0] - energies[1]) / (2 * step)
        np.testing.assert_allclose(data.qfrc_bias, slope, atol=1e-8)
        assert data.qfrc_bias[2] == pytest.approx(4.4497 * 9.81, abs=1e-3)


def test_mirrored_robot_moves_as_the_mirror_image(model):
    rng = np.random.default_rng(6)
    mirror = velocity_mirror()
    for _ in range(3):
        qpos, qvel = random_qpos(rng), rng.normal(size=22)
        data = state_at(model, qpos, qvel)
        image = state_at(model, mirrored_qpos(qpos), mirror @ qvel)
        expected = mirror @ mass_matrix(model, data) @ mirror.T
        np.testing.assert_allclose(mass_matrix(model, image), expected, atol=1e-10)
        np.testing.assert_allclose(image.qfrc_bias, mirror @ data.qfrc_bias, atol=1e-9)


def motor_torques(model, ctrl) -> np.ndarray:
    """Joint torques (22,) that the motors exert at the crouch."""
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = crouch_qpos(), ctrl
    mujoco.mj_forward(model, data)
    return data.qfrc_actuator.copy()


def gauge(torque) -> float:
    """How far a leg's torque (5,) reaches towards the edge of the coupled torque set: 1 on the edge."""
    yaw, pitch, roll, knee, ankle = torque
    return max(abs(yaw) / 10.5, (abs(pitch) + abs(roll)) / 21, abs(knee - ankle) / 10.5, abs(ankle) / 10.5)


@pytest.mark.parametrize("side", ["r", "l"])
def test_motors_reach_exactly_the_coupled_torque_set(model, side):
    """Every torque on the set's edge is reached, and no command leads beyond it."""
    rng = np.random.default_rng(7)
    dofs, motors = LEGS[side], slice(0, 5) if side == "r" else slice(5, 10)
    for _ in range(50):
        torque = rng.normal(size=5) * rng.choice([0.1, 1.0, 10.0], size=5)
        torque /= gauge(torque)
        yaw, pitch, roll, knee, ankle = torque
        ctrl = np.zeros(model.nu)
        ctrl[motors] = [yaw, (pitch - roll) / 2, (-pitch - roll) / 2, knee - ankle, ankle]
        reached = motor_torques(model, ctrl)
        np.testing.assert_allclose(reached[dofs], torque, atol=1e-12)
        assert np.count_nonzero(reached) == np.count_nonzero(reached[dofs])
        ctrl[motors] = rng.normal(size=5) * 1e3
        assert gauge(motor_torques(model, ctrl)[dofs]) <= 1 + 1e-12


def test_arm_motors_saturate_at_one_newton_metre(model):
    ctrl = np.zeros(model.nu)
    ctrl[10:] = [5, -5, 0.5, 5, -5, 0.5]
    np.testing.assert_allclose(motor_torques(model, ctrl)[16:], [1, -1, 0.5, 1, -1, 0.5])

"""Motions of BRUCE with known truth: a kinematic walk by inverse kinematics, and a simulated squat and sway."""

import functools
from typing import NamedTuple

import mujoco
import numpy as np

from bruce_model import BRUCE_XML

PERIOD = 0.002
STEP_TIME = 0.24


class Motion(NamedTuple):
    """True states after each control period, and what an ideal IMU averages over the period."""

    qpos: np.ndarray
    qvel: np.ndarray
    force: np.ndarray
    contacts: np.ndarray


@functools.cache
def bruce() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(BRUCE_XML))


def crouch(model: mujoco.MjModel) -> np.ndarray:
    return model.key_qpos[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, "crouch")].copy()


def _finish(model: mujoco.MjModel, qpos: np.ndarray, contacts: np.ndarray) -> Motion:
    """Velocities and specific force by differences, as semi-implicit integration would have made the motion."""
    qvel = np.zeros((len(qpos), model.nv))
    for k in range(1, len(qpos)):
        mujoco.mj_differentiatePos(model, qvel[k], PERIOD, qpos[k - 1], qpos[k])
    qvel[0] = qvel[1]
    force = np.zeros((len(qpos), 3))
    for k in range(1, len(qpos)):
        acceleration = (qvel[k, :3] - qvel[k - 1, :3]) / PERIOD + [0, 0, 9.81]
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, qpos[k - 1, 3:7])
        force[k] = matrix.reshape(3, 3).T @ acceleration
    force[0] = force[1]
    return Motion(qpos, qvel, force, contacts)


@functools.cache
def walk(seconds: float = 4.0, speed: float = 0.3, turn: float = 0.25, slip: float = 0.003) -> Motion:
    """Kinematic walk along an arc with alternating stance feet, the base swaying sideways and nodding.

    Args:
        speed: [m/s]; turn: [rad/s]; slip: [m] a stance foot slides sideways in the 20 ms after touchdown.
    """
    model = bruce()
    data = mujoco.MjData(model)
    ticks = round(seconds / PERIOD)
    qpos = np.tile(crouch(model), (ticks, 1))
    contacts = np.zeros((ticks, 2))
    sites = {
        name: [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{name}_{side}") for side in "rl"]
        for name in ("midfoot", "toe", "heel")
    }
    height = crouch(model)[2]

    def path(time: float) -> tuple[np.ndarray, float]:
        yaw = turn * time
        radius = speed / turn
        return np.array([radius * np.sin(yaw), radius * (1 - np.cos(yaw)), 0.0]), yaw

    def foothold(step: int) -> tuple[np.ndarray, float]:
        centre, yaw = path((step + 0.5) * STEP_TIME)
        side = -1 if step % 2 == 0 else 1
        return centre + 0.05 * side * np.array([-np.sin(yaw), np.cos(yaw), 0.0]), yaw

    target = crouch(model)
    for k in range(ticks):
        time = k * PERIOD
        step, phase = int(time / STEP_TIME), (time % STEP_TIME) / STEP_TIME
        stance = step % 2
        contacts[k, stance] = 1
        place, yaw = path(time)
        sway = 0.02 * np.cos(np.pi * (time / STEP_TIME - 0.5))
        place = (
            place + sway * np.array([np.sin(yaw), -np.cos(yaw), 0]) + [0, 0, height + 0.003 * np.cos(2 * np.pi * phase)]
        )
        tilt = [0.02 * np.sin(np.pi * time / STEP_TIME), 0.05 + 0.02 * np.sin(2 * np.pi * phase), yaw]
        target[:3] = place
        mujoco.mju_euler2Quat(target[3:7], np.array([tilt[2], tilt[1], tilt[0]]), "ZYX")
        smooth = phase**3 * (10 - 15 * phase + 6 * phase**2)
        (before, yaw_before), (after, yaw_after) = foothold(step - 1), foothold(step + 1)
        feet, yaws = [np.zeros(3), np.zeros(3)], [0.0, 0.0]
        feet[stance], yaws[stance] = foothold(step)
        feet[1 - stance] = before + smooth * (after - before) + [0, 0, 0.025 * 64 * (phase * (1 - phase)) ** 3]
        yaws[1 - stance] = yaw_before + smooth * (yaw_after - yaw_before)
        # The whole slide of a step happens after touchdown and is undone while the foot is in the air.
        slid = min(phase * STEP_TIME / 0.02, 1.0)
        feet[stance] = feet[stance] + [0, slip * slid, 0]
        feet[1 - stance] = feet[1 - stance] + [0, slip * (1 - smooth), 0]
        _reach(model, data, target, sites, feet, yaws)
        qpos[k] = target
    return _finish(model, qpos, contacts)


def _reach(model, data, qpos, sites, feet, yaws) -> None:
    """Gauss-Newton inverse kinematics of both legs in place: midfoot position, foot heading, level foot."""
    for _ in range(20):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        worst = 0.0
        for leg in range(2):
            jacobians = {}
            for name, ids in sites.items():
                jacobians[name] = np.zeros((3, model.nv))
                mujoco.mj_jacSite(model, data, jacobians[name], None, ids[leg])
            columns = slice(6 + 5 * leg, 11 + 5 * leg)
            along = data.site_xpos[sites["toe"][leg]] - data.site_xpos[sites["heel"][leg]]
            turn = (jacobians["toe"] - jacobians["heel"])[:, columns]
            across = np.array([-np.sin(yaws[leg]), np.cos(yaws[leg]), 0])
            error = np.concatenate([data.site_xpos[sites["midfoot"][leg]] - feet[leg], [across @ along, along[2]]])
            matrix = np.vstack([jacobians["midfoot"][:, columns], across @ turn, turn[2]])
            qpos[7 + 5 * leg : 12 + 5 * leg] -= np.linalg.solve(matrix, error)
            worst = max(worst, np.abs(error).max())
        if worst < 1e-10:
            return
    raise AssertionError("inverse kinematics did not converge")


@functools.cache
def squat(seconds: float = 4.0) -> Motion:
    """C MuJoCo: both feet on the floor, joints under PD control follow a squat with a sideways sway."""
    model = mujoco.MjModel.from_xml_path(str(BRUCE_XML))
    model.dof_damping[6:] = 1.5  # implicit, so that the light ankles stay stable
    data = mujoco.MjData(model)
    data.qpos[:] = start = crouch(model)
    qpos, qvel, force = [], [], []
    for k in range(round(seconds / PERIOD)):
        time = k * PERIOD
        wanted = start[7:].copy()
        depth = 0.12 * (1 - np.cos(2 * np.pi * time / 0.8))
        sway = 0.05 * np.sin(2 * np.pi * time / 0.6)
        for leg in range(2):
            wanted[5 * leg : 5 * leg + 5] += [0, depth, sway, -2 * depth, depth]
        data.qfrc_applied[6:] = 60 * (wanted - data.qpos[7:])
        before = data.qvel[:3].copy()
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, data.qpos[3:7])
        mujoco.mj_step(model, data)
        qpos.append(data.qpos.copy())
        qvel.append(data.qvel.copy())
        force.append(matrix.reshape(3, 3).T @ ((data.qvel[:3] - before) / PERIOD + [0, 0, 9.81]))
    return Motion(np.array(qpos), np.array(qvel), np.array(force), np.ones((len(qpos), 2)))

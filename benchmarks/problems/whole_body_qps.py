"""Whole-body QPs of a small walking humanoid, without a physics engine: sequences for judging QP solvers.

Legs of point masses, BRUCE-like sizes and weights, a line foot with two contact points, friction pyramids. The state
follows a sinusoidal gait, so that consecutive problems differ little; contacts switch and pushes make them jump.
"""

from typing import NamedTuple

import numpy as np

STEP_TIME = 0.24  # [s]
TICK = 0.002  # [s]
_MASSES = ((0.0, 0.0, -0.1, 0.5), (0.0, 0.0, -0.3, 0.6), (0.0, 0.0, -0.41, 0.3))  # leg: x y z [m] of straight leg, kg
_TORSO = (np.array([0.02, 0.0, 0.12]), 1.7, np.array([0.012, 0.008, 0.008]))  # COM [m], kg, inertia [kg m^2]
_ARMATURE, _FRICTION, _TORQUE, _FORCE = 0.00182, 0.5, 10.5, 100.0
_POINTS = np.array([[0.05, 0.0, -0.429], [-0.035, 0.0, -0.429]])  # toe, heel [m] of the straight leg


class WholeBodyQps(NamedTuple):
    """A sequence min x'P x / 2 + q'x, low <= C x <= high; x = [joint accelerations or all accelerations, forces].

    Attributes:
        P, q, C, low, high: (T, n, n), (T, n), (T, m, n), (T, m), (T, m).
        blocks: names and row counts.
        torque_map, torque_offset: (T, 10, n), (T, 10), leg torques = map x + offset [N m].
    """

    P: np.ndarray
    q: np.ndarray
    C: np.ndarray
    low: np.ndarray
    high: np.ndarray
    blocks: tuple[tuple[str, int], ...]
    torque_map: np.ndarray
    torque_offset: np.ndarray


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def leg_points(hip: np.ndarray, angles: np.ndarray, points: np.ndarray, link: np.ndarray) -> tuple[np.ndarray, ...]:
    """Positions (k, 3) and Jacobians (k, 3, 5) of points given on the straight leg, after yaw, pitch, roll, knee,
    ankle rotations; `link` says how many joints carry each point.
    """
    axes = np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0]], float)
    pivots = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, -0.205], [0, 0, -0.405]])
    turn, place = np.eye(3), hip.copy()
    position, jacobian = np.zeros((len(points), 3)), np.zeros((len(points), 3, 5))
    world_axes, world_pivots = [], []
    for joint in range(5):
        world_axes.append(turn @ axes[joint])
        world_pivots.append(turn @ pivots[joint] + place)
        place = world_pivots[-1] - turn @ rotation(axes[joint], angles[joint]) @ pivots[joint]
        turn = turn @ rotation(axes[joint], angles[joint])
        for k in np.flatnonzero(link == joint + 1):
            position[k] = turn @ points[k] + place
    for point in range(len(points)):
        for joint in range(link[point]):
            jacobian[point, :, joint] = np.cross(world_axes[joint], position[point] - world_pivots[joint])
    return position, jacobian


def point_rows(position: np.ndarray, jacobian: np.ndarray, leg: int) -> np.ndarray:
    """(3, 16) Jacobian of a leg's point over [base linear, base angular, right leg, left leg]."""
    x, y, z = position
    rows = np.zeros((3, 16))
    rows[:, :3] = np.eye(3)
    rows[:, 3:6] = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    rows[:, 6 + 5 * leg : 11 + 5 * leg] = jacobian
    return rows


def dynamics(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass matrix (16, 16), gravity forces (16,) and contact Jacobian (12, 16) [toe_r, heel_r, toe_l, heel_l]."""
    com, mass, inertia = _TORSO
    rows = point_rows(com, np.zeros((3, 5)), 0)
    turn = np.zeros((3, 16))
    turn[:, 3:6] = np.eye(3)
    M = mass * rows.T @ rows + turn.T @ np.diag(inertia) @ turn
    h = mass * 9.81 * rows[2]
    contacts = []
    for leg, side in enumerate((-1.0, 1.0)):
        hip = np.array([0, 0.076 * side, 0])
        points = np.concatenate([np.asarray(_MASSES)[:, :3], _POINTS])
        where, jacobians = leg_points(hip, angles[leg], points, np.array([3, 4, 5, 5, 5]))
        for k, (position, jacobian) in enumerate(zip(where, jacobians)):
            rows = point_rows(position, jacobian, leg)
            if k < 3:
                M += _MASSES[k][3] * rows.T @ rows
                h += _MASSES[k][3] * 9.81 * rows[2]
            else:
                contacts.append(rows)
    M += np.diag([0.0] * 6 + [_ARMATURE] * 10)
    return M, h, np.concatenate(contacts)


class _Motion(NamedTuple):
    """What a walk in place asks for at one tick.

    Attributes:
        angles: (2, 5) of the right and the left leg.
        on: (2,) bool, feet in contact.
        clock, phase: time in steps, and within this step.
    """

    angles: np.ndarray
    on: np.ndarray
    clock: float
    phase: float


def _motion(clock: float, drift: np.ndarray) -> _Motion:
    """Sinusoidal gait at a time [steps] with slowly drifting joints (16,)."""
    stance, s = int(clock) % 2, clock % 1.0
    crouch = np.array([0.0, 0.5, 0.0, -1.017, 0.513])
    lift = np.sin(np.pi * s) * np.array([0.0, 0.25, 0.05, -0.5, 0.25])
    sway = 0.05 * np.cos(np.pi * clock) * np.array([0.5, 1, 1, 0.5, 1])
    angles = np.stack([crouch + sway, crouch - sway]) + drift[6:].reshape(2, 5)
    angles[1 - stance] += lift
    on = np.zeros(2, bool)
    on[stance] = True
    if s < 0.15:
        on[:] = True
    return _Motion(angles, on, clock, s)


def _tasks(
    motion: _Motion, M: np.ndarray, J: np.ndarray, drift: np.ndarray, bias: np.ndarray, rng: np.random.Generator
) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Rows over the 16 accelerations, wanted values and weights: feet, torso's tilt and heading, COM."""
    tasks: list[tuple[np.ndarray, np.ndarray, float]] = []
    for leg in range(2):
        rows = J[6 * leg : 6 * leg + 6]
        if motion.on[leg]:
            tasks.append((rows, rng.normal(0, 0.1, 6), 100.0))
        else:
            accelerate = 5 * np.sin(2 * np.pi * motion.phase + np.arange(6)) + rng.normal(0, 0.2, 6)
            tasks.append((rows, accelerate, 25.0))
    tilt = np.zeros((3, 16))
    tilt[:, 3:6] = np.eye(3)
    wanted = 6 * np.sin(np.pi * motion.clock + bias[:3]) + rng.normal(0, 0.3, 3) + 4 * drift[:3]
    tasks.append((tilt[:2], wanted[:2], 10.0))
    tasks.append((tilt[2:], wanted[2:], 1.0))
    total = M[0, 0]
    tasks.append((M[2:3] / total, np.array([0.5 * np.sin(4 * np.pi * motion.clock)]), 100.0))
    tasks.append((M[0:1] / total, np.array([1.5 * np.sin(np.pi * motion.clock)]), 30.0))
    return tasks


def _friction(on: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pyramids of the four contact points, whose forces follow `count` accelerations: rows, low and high."""
    rows = np.zeros((20, count + 12))
    low, high = np.full(20, -np.inf), np.zeros(20)
    for point in range(4):
        x, y, z = count + 3 * point + np.arange(3)
        for row, (axis, sign) in enumerate(((x, 1), (x, -1), (y, 1), (y, -1))):
            rows[5 * point + row, [axis, z]] = sign, -_FRICTION
        rows[5 * point + 4, z] = 1.0
        low[5 * point + 4], high[5 * point + 4] = (1.0, _FORCE) if on[point // 2] else (0.0, 0.0)
    return rows, low, high


def _program(
    motion: _Motion,
    terms: tuple[np.ndarray, np.ndarray, np.ndarray],
    tasks: list[tuple[np.ndarray, np.ndarray, float]],
    eliminate: bool,
) -> tuple[np.ndarray, ...]:
    """P, q, C, low, high, torque map and offset of one tick; `terms` are the mass matrix, forces and Jacobian."""
    M, h, J = terms
    count = 16 if eliminate else 22
    n = count + 12
    padding = np.zeros((count - 16, 16))
    Mc = np.block([[M, padding.T], [padding, 0.01 * np.eye(count - 16)]])
    Jc = np.concatenate([J, np.zeros((12, count - 16))], axis=1)
    hc = np.concatenate([h, np.zeros(count - 16)])
    P, q = np.zeros((n, n)), np.zeros(n)
    for rows, target, weight in tasks:
        wide = np.concatenate([rows, np.zeros((len(rows), n - 16))], axis=1)
        P += weight * wide.T @ wide
        q -= weight * wide.T @ target
    nominal = np.zeros(12)
    nominal[2::3] = np.repeat(motion.on, 2) * M[0, 0] * 9.81 / (2 * motion.on.sum())
    P += np.diag(np.full(n, 1e-2))
    q[count:] -= 1e-2 * nominal
    friction, low, high = _friction(motion.on, count)
    full = np.concatenate([Mc, -Jc.T], axis=1)
    if eliminate:
        inner = np.linalg.solve(M[:6, :6], np.concatenate([-M[:6, 6:16], J.T[:6]], axis=1))
        lift_map = np.concatenate([inner, np.eye(22)])
        offset = np.concatenate([-np.linalg.solve(M[:6, :6], h[:6]), np.zeros(22)])
        q, P = lift_map.T @ (q + P @ offset), lift_map.T @ P @ lift_map
        friction = friction @ lift_map
        torque, shift = full[6:16] @ lift_map, full[6:16] @ offset + h[6:]
        base = np.zeros((0, 22))
    else:
        torque, shift, base = full[6:16], hc[6:16], full[:6]
    return (
        (P + P.T) / 2,
        q,
        np.concatenate([friction, torque, base]),
        np.concatenate([low, -_TORQUE - shift, -h[: len(base)]]),
        np.concatenate([high, _TORQUE - shift, -h[: len(base)]]),
        torque,
        shift,
    )


def whole_body_qps(ticks: int = 500, seed: int = 0, push: float = 1.0, eliminate: bool = True) -> WholeBodyQps:
    """A walk in place with pushes; step phases, noise and pushes come from the seed.

    Args:
        ticks: programs, one every TICK.
        seed: of everything random.
        push: size of the pushes, 1 for half the gravity for 0.1 s once a step or so.
        eliminate: eliminate the base acceleration (22 variables, 30 rows), else keep it and add arms that swing
            freely (34 variables, 36 rows, 6 of them the base's equations).
    """
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 2)
    drift = np.cumsum(rng.normal(0, 0.02, (ticks, 16)), axis=0) * np.sqrt(TICK)
    kick, remaining, bias = np.zeros(6), 0, rng.normal(0, 1, 16)
    programs = []
    for tick in range(ticks):
        clock = phase + tick * TICK / STEP_TIME
        if rng.random() < TICK / STEP_TIME:
            kick, remaining = push * 22 * np.concatenate([rng.normal(0, 1, 3), rng.normal(0, 0.15, 3)]), 50
        remaining -= 1
        motion = _motion(clock, drift[tick])
        M, h, J = dynamics(motion.angles)
        h = h + 0.3 * np.sin(2 * np.pi * clock + bias) * np.array([3.0] * 3 + [0.3] * 3 + [0.2] * 10)
        h[:6] -= kick * (remaining > 0)
        programs.append(_program(motion, (M, h, J), _tasks(motion, M, J, drift[tick], bias, rng), eliminate))
    P, q, C, low, high, torque_map, torque_offset = (np.stack(arrays) for arrays in zip(*programs))
    blocks: tuple[tuple[str, int], ...] = (("friction", 20), ("torque", 10))
    if not eliminate:
        blocks = (*blocks, ("base dynamics", 6))
    return WholeBodyQps(P, q, C, low, high, blocks, torque_map, torque_offset)

"""Poses and goals that cannot be those of a walking robot: other units, other columns, jumps, or out of reach."""

import math

import numpy as np
from jaxtyping import Bool, Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import host

MAX_STEP = 5.0
"""[m] between the poses of successive images; a robot walks this far in ten seconds."""

MAX_POSITION = 1e4
"""[m] from the world's origin; farther out single precision loses the millimetre."""

MAX_GOAL = 100.0
"""[m] of a goal from its frame's base."""

_MAX_YAW = 2.0 * math.pi + 0.01  # [rad] either convention, 0 to 2 pi or -pi to pi
_MIN_MOVE = 0.03  # [m] between images, to tell a direction of walking
_MIN_MOVES = 3
_FORWARD, _ASIDE = math.radians(20.0), math.radians(60.0)  # walking along the yaw; not along it


def check_poses(poses: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Which poses [x m, y m, yaw rad] lie alone, far from both their neighbours; NaN where a pose is unknown.

    Raises:
        InputError: if they cannot be metres and radians, or fall apart into pieces.
    """
    known = np.isfinite(poses).all(axis=1)
    rows, index = poses[known], np.flatnonzero(known)
    alone = np.zeros(len(poses), bool)
    if not known.any():
        return alone
    if np.abs(rows[:, 2]).max() > _MAX_YAW:
        raise InputError(
            f"The poses' yaw reaches {_largest(rows[:, 2]):g}; it must be in radians, from -pi to pi (degrees are not)."
        )
    if np.abs(rows[:, :2]).max() > MAX_POSITION:
        raise InputError(
            f"The poses reach {_largest(rows[:, :2]):g} m; give metres, measured from where the recording starts."
        )
    alone[index] = _strays(rows[:, :2], np.diff(index))
    rows, index = poses[known & ~alone], np.flatnonzero(known & ~alone)
    steps = np.linalg.norm(np.diff(rows[:, :2], axis=0), axis=1)
    jumps = np.flatnonzero(steps > MAX_STEP * np.diff(index))
    if jumps.size:
        first = jumps[0]
        raise InputError(
            f"The poses jump by {steps[first]:.3g} m between images {index[first]} and {index[first + 1]}; give "
            "metres, rows x y yaw in the images' order, and each recording its own folder."
        )
    if _walks_along(rows, np.radians(rows[:, 2])) < _FORWARD and _walks_along(rows, rows[:, 2]) > _ASIDE:
        raise InputError(
            "The poses' yaw agrees with the direction of walking only if it is in degrees; write it in radians."
        )
    return alone


def doubts_about_walking(poses: Float[np.ndarray, "n 3"]) -> list[str]:
    """What is odd about poses [x m, y m, yaw rad] though it can be; NaN where a pose is unknown."""
    rows = poses[np.isfinite(poses).all(axis=1)]
    angle = _walks_along(rows, rows[:, 2])
    if not angle > _ASIDE:
        return []
    return [
        f"say that the robot walks at {math.degrees(angle):.0f} degrees to where it faces (median); check that rows "
        "are x y yaw and that yaw is counted anticlockwise from the x axis."
    ]


def _largest(values: Float[np.ndarray, "*shape"]) -> float:
    return float(values.flat[np.argmax(np.abs(values))])


def _strays(places: Float[np.ndarray, "n 2"], gaps: Int[np.ndarray, " m"]) -> Bool[np.ndarray, " n"]:
    """Places far from the ones before and after, which lie close to each other."""
    strays = np.zeros(len(places), bool)
    if len(places) < 3:
        return strays
    far = np.linalg.norm(np.diff(places, axis=0), axis=1) > MAX_STEP * gaps
    around = np.linalg.norm(places[2:] - places[:-2], axis=1) <= MAX_STEP * (gaps[1:] + gaps[:-1])
    strays[1:-1] = far[:-1] & far[1:] & around
    return strays


def _walks_along(poses: Float[np.ndarray, "n 3"], yaw: Float[np.ndarray, " n"]) -> float:
    """[rad] median angle between the direction of walking and a yaw; NaN if the robot hardly walks."""
    moves = np.diff(poses[:, :2], axis=0)
    walking = np.linalg.norm(moves, axis=1) > _MIN_MOVE
    if walking.sum() < _MIN_MOVES:
        return math.nan
    between = np.angle(np.exp(1j * (np.arctan2(moves[:, 1], moves[:, 0]) - yaw[:-1])))
    return float(np.median(np.abs(between[walking])))


def check_goals(goals: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "n 3"] | None) -> None:
    """Refuse goals [m] that cannot be places in each frame's base frame; NaN where a goal is unknown.

    Raises:
        InputError: if goals are out of reach, or do not move in the base frame while the base moves.
    """
    known = np.isfinite(goals).all(axis=1)
    if known.any() and np.linalg.norm(goals[known], axis=1).max() > MAX_GOAL:
        raise InputError(
            f"A goal lies {np.linalg.norm(goals[known], axis=1).max():.3g} m away; give metres in the frame's own base "
            f"frame, at most {MAX_GOAL:g} m."
        )
    if poses is None or not (known & np.isfinite(poses).all(axis=1)).any():
        return
    both = known & np.isfinite(poses).all(axis=1)
    walked = np.ptp(poses[both, :2], axis=0).max()
    if walked > 1.0 and np.ptp(goals[both], axis=0).max() < 0.01:
        raise InputError(
            f"The goal stays at {goals[both][0].tolist()} in every frame while the base moves {walked:.1f} m; give it "
            "in each frame's own base frame (x ahead, y to the left)."
        )


def check_end(poses: Float[np.ndarray, "n 3"]) -> None:
    """Refuse a recording whose end, the first goal of its frames, is out of reach of one of them.

    Raises:
        InputError: naming the distance.
    """
    distance = np.linalg.norm(host.to_base(poses, poses[-1, :2]), axis=1).max()
    if distance > MAX_GOAL:
        raise InputError(
            f"The recording ends {distance:.0f} m from one of its frames, whose goal it is; split it into parts of at "
            f"most {MAX_GOAL:g} m."
        )

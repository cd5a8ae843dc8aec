"""What a walk is to be: a motion as a checked footstep plan from where the robot stands."""

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import mujoco
import numpy as np
from jaxtyping import Float

from bruce_model import load_mujoco
from iwalker_jax.checks import require_numbers
from iwalker_jax.control import (
    FootstepPlan,
    GaitParameters,
    check_footsteps,
    footsteps_along,
    load_footsteps,
    make_plan,
    ramp_shares,
    velocity_footsteps,
)
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import Side, host, other_side
from iwalker_jax.robot import FEET
from iwalker_jax.runtime import read_text
from iwalker_jax.runtime.reading import printable

MotionKind = Literal["stand", "in_place", "straight", "sideways", "turn", "s_curve", "footsteps", "path"]
"""Kinds of motion that a `Motion` may be."""

CURVE_RADIUS = 1.0
"""[m] of both arcs of the S-curve."""
_PACE_CHANGE = 0.03  # [m] by which successive steps may lengthen
_ROWS = 64  # of a plan, or a multiple
_LONGEST_WALK = 1000.0  # [m]
_MOST_STEPS = 100_000
_SETTLING = 2.0  # [s] allowed for coming to rest


@dataclass(frozen=True)
class Motion:
    """A motion to command.

    Attributes:
        kind: what to do; `footsteps` and `path` read a file.
        speed: [m/s] forward; of `sideways` to the left; negative walks the other way. The gait's own if left out.
        turn: [deg/s] of `turn`, left positive.
        step_length: [m] from one foot to the next, in place of the speed, if given.
        distance: [m] to walk; or
        seconds: [s] to move for. The distance counts if both are given.
        width: [m] between the tracks of the two feet; the gait's own if left out.
        file: CSV of footsteps (`side, x, y, yaw_degrees`) or of a path (`x, y`), from between the standing feet.
    """

    kind: MotionKind = "s_curve"
    speed: float | None = None
    turn: float = 15.0
    step_length: float | None = None
    distance: float | None = None
    seconds: float | None = None
    width: float | None = None
    file: Path | None = None

    def __post_init__(self) -> None:
        if self.kind not in get_args(MotionKind):
            raise InputError(f"Unknown motion {self.kind!r}; choose one of {', '.join(get_args(MotionKind))}.")
        require_numbers(self)
        if not (self.file is None or isinstance(self.file, (str, PathLike))):
            raise InputError(f"The motion's file is {self.file!r:.40}; give the path of one.")
        bounds = {
            "speed": (-1.0, 1.0, "m/s"),
            "turn": (-90.0, 90.0, "deg/s"),
            "step_length": (-0.3, 0.3, "m"),
            "distance": (0.01, _LONGEST_WALK, "m"),
            "seconds": (0.1, 3600.0, "s"),
            "width": (0.05, 0.5, "m"),
        }
        for name, (low, high, unit) in bounds.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise InputError(f"The motion's {name} is {value} {unit}; give {low:g} to {high:g} {unit}.")
        if (self.kind in ("footsteps", "path")) != (self.file is not None):
            raise InputError(
                f"Motion {self.kind!r} reads {'a file, but none was given' if self.file is None else 'no file'}; "
                "give a file with footsteps or path, and with these only."
            )


class Walk(NamedTuple):
    """A motion made ready.

    Attributes:
        plan: footsteps from where the robot stands.
        path: (n, 2) [m] that they follow, if any.
        speed: [m/s] commanded in the steady part.
        seconds: [s] that it takes, with time to come to rest.
    """

    plan: FootstepPlan
    path: Float[np.ndarray, "n 2"] | None
    speed: float
    seconds: float


def make_walk(
    motion: Motion,
    model: mujoco.MjModel | None = None,
    gait: GaitParameters = GaitParameters(),
    rows: int | None = None,
) -> Walk:
    """The footstep plan of a motion; its origin, that of files too, is midway between the robot's standing feet.

    Args:
        motion: to make.
        model: whose first keyframe is how the robot stands, facing along x; BRUCE by default.
        gait: of the controller that shall walk it: its step time, its reach.
        rows: of the plan, so that plans match in shape; by default the next multiple of 64, so that most walks share
            their compiled programs.

    Raises:
        InputError: a bad file, footsteps out of reach, or more than `rows`.
    """
    step_time = float(gait.hlip.step_time)
    before = gait.stand_time + gait.shift_time + gait.settle_time
    if motion.kind == "stand":
        plan = make_plan(np.zeros((0, 2)), np.zeros(0), Side.LEFT, rows or _ROWS)
        return Walk(plan, None, 0.0, 10.0 if motion.seconds is None else motion.seconds)
    path, first_swing = None, Side.LEFT
    pace = gait.speed if motion.speed is None else motion.speed
    width = gait.width if motion.width is None else motion.width
    length = pace * step_time if motion.step_length is None else motion.step_length
    speed = length / step_time
    if motion.kind == "footsteps" and motion.file is not None:
        positions, yaws, first_swing = load_footsteps(motion.file)
        strides = np.linalg.norm(positions[2:] - positions[:-2], axis=1)
        speed = float(np.median(strides)) / 2 / step_time if len(strides) else 0.0
    elif motion.kind in ("s_curve", "path"):
        path = s_curve(motion.distance or 3.0) if motion.file is None else load_path(motion.file)
        if length <= 0:
            raise InputError(f"A path is followed at {speed:g} m/s; give a speed above 0.")
        whole = host.polyline_length(path)
        shares = ramp_shares(_steps_for(whole, length), _ramp(length))
        positions, yaws = footsteps_along(path, np.cumsum(shares) * length, width, Side.LEFT)
    else:
        positions, yaws, speed = _velocity_walk(motion, length, width, step_time)
    feet = standing_feet(load_mujoco() if model is None else model)
    start = feet[:, :2].mean(axis=0)
    positions, path = positions + start, None if path is None else path + start
    check_footsteps(positions, yaws, first_swing, gait.reach, feet[other_side(first_swing)])
    plan = make_plan(positions, yaws, first_swing, rows or -(-len(positions) // _ROWS) * _ROWS)
    return Walk(plan, path, speed, before + len(positions) * step_time * gait.slowest + _SETTLING)


def _velocity_walk(
    motion: Motion, length: float, width: float, step_time: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Footsteps of a constant command, and its speed [m/s]."""
    pace = length if motion.kind in ("straight", "sideways") else 0.0
    if motion.distance is not None and pace != 0:
        steps = _steps_for(motion.distance, abs(pace))
    else:
        steps = max(round((10.0 if motion.seconds is None else motion.seconds) / step_time), 2)
    forward, sideways = (0.0, pace) if motion.kind == "sideways" else (pace, 0.0)
    turn = np.radians(motion.turn) if motion.kind == "turn" else 0.0
    command = (forward / step_time, sideways / step_time, float(turn))
    positions, yaws = velocity_footsteps(*command, steps, step_time, width, Side.LEFT, _ramp(pace))
    return positions, yaws, pace / step_time


def _ramp(length: float) -> int:
    return max(4, int(np.ceil(abs(length) / _PACE_CHANGE)))


def _steps_for(distance: float, length: float) -> int:
    """Fewest footsteps that cover a distance [m] with the ramps included.

    Raises:
        InputError: if they are too many for any walk.
    """
    if distance > _LONGEST_WALK or distance / length > _MOST_STEPS:
        raise InputError(
            f"{distance:g} m in steps of {length:g} m are too long a walk; give at most {_LONGEST_WALK:g} m and "
            f"{_MOST_STEPS} steps."
        )
    lost = _ramp(length)  # the ramps miss half their steps each
    steps = int(np.floor(distance / length)) + 2
    while ramp_shares(steps, lost).sum() * length < distance - 1e-9:
        steps += 1
    return steps


def s_curve(length: float, spacing: float = 0.01) -> Float[np.ndarray, "n 2"]:
    """(n, 2) [m] half of the length on an arc to the left, the other half to the right, from the origin along x."""
    along = np.linspace(0.0, length, int(np.ceil(length / spacing)) + 1)
    step = along[1] - along[0]
    middle = along[:-1] + step / 2
    heading = np.where(middle < length / 2, middle, length - middle) / CURVE_RADIUS
    moves = step * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])


def load_path(file: Path) -> Float[np.ndarray, "n 2"]:
    """(n, 2) [m] points of a CSV file, one `x, y` a line; lines beginning with # are comments.

    Raises:
        InputError: with what is wrong.
    """
    name = printable(file, 300)
    try:
        lines = read_text(Path(file)).splitlines()
    except InputError as error:
        raise InputError(f"The path file {name} cannot be read: it {error}") from None
    points: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            point = [float(part) for part in line.split(",")]
        except ValueError:
            point = []
        if len(point) != 2 or not np.isfinite(point).all():
            raise InputError(f"{name}, line {number} reads {printable(line.strip())!r}; write `x, y` in finite metres.")
        if not points or point != points[-1]:
            points.append(point)
    if len(points) < 2:
        raise InputError(f"{name} holds {len(points)} different points; a path needs at least two.")
    return np.asarray(points)


def standing_feet(model: mujoco.MjModel) -> Float[np.ndarray, "2 3"]:
    """x, y [m] and yaw [rad] of the right and the left foot in the first keyframe."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    feet = [data.site(name) for name in FEET]
    return np.array([[*foot.xpos[:2], np.arctan2(foot.xmat[3], foot.xmat[0])] for foot in feet])

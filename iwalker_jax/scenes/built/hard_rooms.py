"""Rooms that are hard to walk through, or that nobody of the robot's size can: each one difficulty, by itself."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.built.layout import Layout, Pose2D, designed_layout
from iwalker_jax.scenes.built.rooms import Rectangle, enclose
from iwalker_jax.scenes.scene import Scene


@dataclass(frozen=True, eq=False)
class HardRoom:
    """A room, where a robot starts in it and where it shall go.

    Attributes:
        scene: the room.
        start: x, y [m] and yaw [rad].
        goal: (2,) [m].
        passable: whether there is a way for the robot; None where it may either go on or stop, but not touch.
    """

    scene: Scene
    start: Pose2D
    goal: np.ndarray
    passable: bool | None


def hard_room(name: str, rng: np.random.Generator) -> HardRoom:
    """The room of a name in `HARD_ROOM_NAMES`.

    Args:
        name: of the room.
        rng: moves the room's obstacles and the start by up to 3 cm and 5 degrees; widths and heights stay.

    Raises:
        InputError: for an unknown name.
    """
    if name not in _ROOMS:
        raise InputError(f"Unknown hard room {name!r}; choose one of {', '.join(HARD_ROOM_NAMES)}.")
    design, passable, floor = _ROOMS[name]
    layout = designed_layout(rng, floor.bounds)
    enclose(layout, floor, {})
    shift = rng.uniform(-0.03, 0.03, 2)
    design(layout, Pose2D(float(shift[0]), float(shift[1]), 0.0))
    x, y, yaw = rng.uniform(-1, 1, 3) * (0.03, 0.03, math.radians(5))
    # Where the way is bent, the goal lies round the bend.
    goal = np.array([2.6, 1.9] if design is _corner else [3.0, 0.0])
    return HardRoom(layout.scene(f"room-{name}", "hard_room"), Pose2D(float(x), float(y), float(yaw)), goal, passable)


_HALL = Rectangle(-0.8, -1.5, 3.8, 1.5)
_LANE = Rectangle(-0.8, -0.7, 3.8, 0.7)
_WALL = 0.12


def _gap(width: float) -> Callable[[Layout, Pose2D], None]:
    """A wall across the hall with an opening of a width [m]."""

    def build(layout: Layout, at: Pose2D) -> None:
        for side in (-1, 1):
            reach = _HALL.y_max + 0.1
            middle = side * (width / 2 + reach) / 2
            layout.box(at.moved(1.4, middle), _WALL, reach - width / 2, 0.0, layout.ceiling)

    return build


def _trap(depth: float, width: float) -> Callable[[Layout, Pose2D], None]:
    """A blind bay of a depth and a width [m] that opens towards the start."""

    def build(layout: Layout, at: Pose2D) -> None:
        layout.box(at.moved(0.35 + depth, 0.0), _WALL, width + 2 * _WALL, 0.0, 1.2)
        for side in (-1, 1):
            layout.box(at.moved(0.35 + depth / 2, side * (width + _WALL) / 2), depth, _WALL, 0.0, 1.2)

    return build


def _posts(layout: Layout, at: Pose2D) -> None:
    for k in range(3):
        layout.cylinder(at.moved(0.7 + 0.7 * k, 0.25 * (-1) ** k), 0.06, 0.0, 1.2)


def _poles(layout: Layout, at: Pose2D) -> None:
    for x, first in ((0.9, -1.3), (1.9, -0.95)):
        for k in range(4):
            layout.cylinder(at.moved(x, first + 0.7 * k), 0.015, 0.0, 1.4)


def _table(layout: Layout, at: Pose2D) -> None:
    layout.box(at.moved(1.4, 0.0), 0.7, 1.2, 0.5, 0.54)
    for x in (-0.3, 0.3):
        for y in (-0.55, 0.55):
            layout.box(at.moved(1.4 + x, y), 0.05, 0.05, 0.0, 0.5)


def _beam(layout: Layout, at: Pose2D) -> None:
    layout.box(at.moved(1.4, -0.45), 0.08, 2.1, 0.5, 0.58)


def _corner(layout: Layout, at: Pose2D) -> None:
    """A corridor 0.7 m wide that turns left after two metres."""
    low, high = -0.35 + at.y, 0.35 + at.y
    layout.box(Pose2D(0.9 + at.x, (high + 2.6) / 2), 2.7, 2.6 - high, 0.0, 1.5)
    layout.box(Pose2D(1.25 + at.x, (low - 0.9) / 2), 3.4, low + 0.9, 0.0, 1.5)
    layout.box(Pose2D(3.4 + at.x, 1.0), 0.9, 3.8, 0.0, 1.5)


def _ramp(layout: Layout, at: Pose2D) -> None:
    """A slope of ten degrees over the whole width, in strips of 4 cm."""
    for k in range(50):
        layout.box(at.moved(1.42 + 0.04 * k, 0.0), 0.04, 1.6, 0.0, 0.0353 * 0.2 * (k + 1))


def _platform(layout: Layout, at: Pose2D) -> None:
    layout.box(at.moved(2.7, 0.0), 2.4, 1.6, 0.0, 0.06)


def _door(layout: Layout, at: Pose2D) -> None:
    _gap(0.85)(layout, at)
    layout.box(at.moved(1.4, 0.0), 0.04, 0.85, 0.01, 2.0)
    layout.box(at.moved(1.4, 0.0), _WALL, 0.85, 2.0, layout.ceiling)


def _threshold(height: float) -> Callable[[Layout, Pose2D], None]:
    """A bar of a height [m] over the whole width."""

    def build(layout: Layout, at: Pose2D) -> None:
        layout.box(at.moved(1.4, 0.0), 0.08, 1.6, 0.0, height)

    return build


_ROOMS: dict[str, tuple[Callable[[Layout, Pose2D], None], bool | None, Rectangle]] = {
    "trap": (_trap(1.0, 1.4), True, Rectangle(-0.8, -1.9, 3.8, 1.9)),
    "dead_end": (_trap(1.6, 0.9), True, Rectangle(-1.0, -1.5, 3.8, 1.5)),
    "gap_60": (_gap(0.60), True, _HALL),
    "gap_45": (_gap(0.45), True, _HALL),
    "gap_40": (_gap(0.40), False, _HALL),
    "gap_35": (_gap(0.35), False, _HALL),
    "posts": (_posts, True, _LANE),
    "poles": (_poles, True, _HALL),
    "table": (_table, True, _HALL),
    "beam": (_beam, True, _HALL),
    "corner": (_corner, True, Rectangle(-0.5, -0.8, 3.8, 2.6)),
    "ramp": (_ramp, False, _LANE),
    "platform": (_platform, False, _LANE),
    "closed_door": (_door, False, _HALL),
    "threshold_20": (_threshold(0.020), None, _LANE),
    "threshold_30": (_threshold(0.030), None, _LANE),
    "threshold_45": (_threshold(0.045), None, _LANE),
    "threshold_60": (_threshold(0.060), None, _LANE),
}

HARD_ROOM_NAMES: tuple[str, ...] = tuple(_ROOMS)
"""Names of the hard rooms."""


def room_is_passable(name: str) -> bool | None:
    """`HardRoom.passable` of a name in `HARD_ROOM_NAMES`."""
    return _ROOMS[name][1]

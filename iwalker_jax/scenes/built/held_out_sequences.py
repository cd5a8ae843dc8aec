"""The four held-out test sequences: layouts designed by hand, each with a route to its goal."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.built.furniture import (
    barrel,
    cabinet,
    chair,
    clutter,
    desk,
    office_chair,
    person,
    pillar,
    shelf,
    staircase,
    waste_bin,
)
from iwalker_jax.scenes.built.layout import Layout, Pose2D, designed_layout
from iwalker_jax.scenes.built.oblique_walls import bent_passage, enclose_polygon
from iwalker_jax.scenes.scene import Scene
from iwalker_jax.streams import SEQUENCE_FURNITURE


@dataclass(frozen=True, eq=False)
class HeldOutSequence:
    """A held-out scene and the route through it.

    Attributes:
        scene: the scene.
        route: (n, 2) corners of a collision-free polyline [m] in the scene's frame; it starts at the first.
        goal: (x, y) [m], the route's end.
    """

    scene: Scene
    route: np.ndarray

    @property
    def goal(self) -> tuple[float, float]:
        """(x, y) [m] of the route's end."""
        return float(self.route[-1, 0]), float(self.route[-1, 1])


def held_out_sequence(name: str) -> HeldOutSequence:
    """The test sequence of a name in `SEQUENCE_NAMES`.

    Raises:
        InputError: for an unknown name.
    """
    if name not in _SEQUENCES:
        raise InputError(f"Unknown test sequence {name!r}; choose one of {', '.join(SEQUENCE_NAMES)}.")
    layout, route = _SEQUENCES[name]()
    return HeldOutSequence(layout.scene(f"test-{name}", f"test_{name}"), np.asarray(route))


def _stair() -> tuple[Layout, list[tuple[float, float]]]:
    """A stairwell: two opposed flights with a half landing in mid-room, a chamfered corner, things in the way."""
    layout = designed_layout(SEQUENCE_FURNITURE.generator(0), (0.0, 0.0, 9.4, 7.2))
    corners = [(0.0, 0.0), (9.4, 0.0), (9.4, 4.9), (7.3, 7.2), (0.0, 7.2)]
    enclose_polygon(layout, corners, {4: ((5.6, 1.0),), 1: ((3.6, 0.95),)})
    lower = staircase(layout, 1.25, 8)
    foot = Pose2D(4.4, 2.7)
    layout.furnish([(lower, foot)])
    turn = foot.moved(lower.length / 2 + 0.65, 0.7)
    layout.box(turn, 1.3, 2.65, 0.0, 1.45)
    for i in range(8):
        # The upper flight returns beside the lower one, walled up underneath.
        step = foot.moved(lower.length / 2 - (i + 0.5) * 0.27, 1.4)
        layout.box(step, 0.27, 1.25, 0.0, 1.45 + (i + 1) * 0.17)
    layout.furnish(
        [
            (pillar(layout), Pose2D(2.2, 4.6)),
            (pillar(layout), Pose2D(7.75, 4.1, 0.7)),
            (person(layout), Pose2D(3.9, 5.9, 1.0)),
            (waste_bin(layout), Pose2D(0.4, 3.4)),
            (waste_bin(layout), Pose2D(8.9, 0.5)),
            (clutter(layout), Pose2D(5.6, 6.7, 0.4)),
            (cabinet(layout, 1.1, 0.35, 1.0), Pose2D(0.2, 1.2)),
            (chair(layout), Pose2D(8.95, 2.0, math.pi)),
            (barrel(layout), Pose2D(6.2, 0.5)),
        ],
    )
    return layout, [(1.2, 2.4), (1.3, 4.4), (1.7, 5.3), (2.6, 5.6), (3.3, 5.05), (6.2, 5.3), (7.4, 5.5), (8.5, 4.4)]


def _office() -> tuple[Layout, list[tuple[float, float]]]:
    """Cubicles behind chest-high partitions, turned against the walls of a room with a slanted facade."""
    layout = designed_layout(SEQUENCE_FURNITURE.generator(1), (0.0, 0.0, 10.6, 8.0))
    corners = [(0.0, 0.0), (9.0, 0.0), (10.6, 4.2), (10.6, 8.0), (0.0, 8.0)]
    enclose_polygon(layout, corners, {4: ((6.6, 0.9),), 3: ((2.0, 1.0),)})
    turn = math.radians(24)
    for x, y in ((2.6, 2.0), (5.0, 3.1), (7.4, 4.2), (3.4, 6.2)):
        cell = Pose2D(x, y, turn)
        for part, length, width in (
            (cell.moved(0.0, 0.95), 1.9, 0.06),
            (cell.moved(0.95, 0.0), 0.06, 1.9),
            (cell.moved(-0.45, -0.95), 1.0, 0.06),
        ):
            layout.box(part, length, width, 0.0, 1.38)
        desk(layout, 1.6).build(layout, cell.moved(0.5, 0.08))
        office_chair(layout).build(layout, cell.moved(-0.25, 0.1, 0.6))
    layout.furnish(
        [
            (shelf(layout, 1.1), Pose2D(0.22, 3.4)),
            (shelf(layout, 1.1), Pose2D(4.6, 7.75, -math.pi / 2)),
            (cabinet(layout, 0.9, 0.7, 1.15), Pose2D(0.4, 5.2)),
            (person(layout), Pose2D(5.3, 5.3, 2.0)),
            (office_chair(layout), Pose2D(4.7, 0.45, 1.2)),
            (waste_bin(layout), Pose2D(6.6, 1.4)),
            (clutter(layout), Pose2D(8.3, 2.2, 0.3)),
            (pillar(layout), Pose2D(6.7, 6.4, turn)),
        ],
    )
    return layout, [(1.0, 0.6), (2.2, 0.38), (3.4, 0.6), (5.1, 1.6), (7.4, 2.5), (9.3, 3.4), (9.3, 5.0), (8.4, 6.0)]


def _corridor() -> tuple[Layout, list[tuple[float, float]]]:
    """A corridor with two bends of 33 degrees, side rooms, and things along and across it."""
    layout = designed_layout(SEQUENCE_FURNITURE.generator(2), (0.0, -1.3, 13.2, 4.4))
    bend = math.radians(33)
    middle = (4.6 + 4.2 * math.cos(bend), 1.0 + 4.2 * math.sin(bend))
    line = [(0.0, 1.0), (4.6, 1.0), middle, (13.2, middle[1])]
    bent_passage(layout, line, 1.9, 2.2, [(0, 1, 1.0, 3.6, 2.2, 1.0), (1, -1, 1.2, 3.6, 2.6, 0.95)])
    layout.box(Pose2D(11.3, -0.9), 4.2, 1.6, 0.0, layout.ceiling)
    up = Pose2D(4.6, 1.0, bend)
    last = Pose2D(*middle, 0.0)
    layout.furnish(
        [
            (cabinet(layout, 0.9, 0.4, 1.3), Pose2D(1.4, 0.26, math.pi / 2)),
            (waste_bin(layout), Pose2D(4.0, 1.75)),
            (chair(layout), Pose2D(3.1, 0.3, math.pi / 2)),
            (person(layout), up.moved(1.2, 0.45, 1.0)),
            (clutter(layout), up.moved(3.1, 0.5, 0.2)),
            (shelf(layout, 0.9, 0.3), last.moved(1.6, 0.78, -math.pi / 2)),
            (barrel(layout), last.moved(2.3, -0.55)),
            (waste_bin(layout), last.moved(3.4, 0.7)),
        ],
    )
    return layout, [
        (0.6, 1.1),
        (3.4, 1.1),
        up.point(0.1, -0.05),
        up.point(1.2, -0.35),
        up.point(3.2, -0.35),
        last.point(0.6, -0.1),
        last.point(2.3, 0.2),
        last.point(2.9, 0.0),
    ]


def _corner() -> tuple[Layout, list[tuple[float, float]]]:
    """Two wide passages that meet at a blind corner of 104 degrees, with a pillar and a person behind it."""
    layout = designed_layout(SEQUENCE_FURNITURE.generator(3), (0.0, -0.1, 8.3, 7.2))
    turn = math.radians(76)
    end = (5.6 + 6.2 * math.cos(turn), 1.0 + 6.2 * math.sin(turn))
    bent_passage(layout, [(0.0, 1.0), (5.6, 1.0), end], 2.2, 1.8, [(0, 1, 0.5, 3.2, 1.7, 1.05)])
    layout.box(Pose2D(1.8, 5.8), 3.8, 3.2, 0.0, layout.ceiling)
    around = Pose2D(5.6, 1.0, turn)
    layout.furnish(
        [
            (pillar(layout), Pose2D(6.05, 1.2)),
            (clutter(layout), Pose2D(3.2, 0.35, 0.2)),
            (barrel(layout), Pose2D(1.3, 0.35)),
            (person(layout), around.moved(3.2, -0.35, 0.4)),
            (cabinet(layout, 1.0, 0.45, 1.5), around.moved(2.0, -0.86, math.pi / 2)),
            (chair(layout), around.moved(4.6, 0.8, -math.pi / 2)),
            (waste_bin(layout), Pose2D(4.0, 1.85)),
        ],
    )
    return layout, [
        (0.7, 1.1),
        (3.9, 1.1),
        (4.9, 1.4),
        around.point(1.2, 0.45),
        around.point(3.2, 0.4),
        around.point(5.2, -0.1),
    ]


_SEQUENCES: dict[str, Callable[[], tuple[Layout, list[tuple[float, float]]]]] = {
    "stair": _stair,
    "office": _office,
    "corridor": _corridor,
    "corner": _corner,
}

SEQUENCE_NAMES: tuple[str, ...] = tuple(_SEQUENCES)
"""Names of the scenes that are kept for sequences."""

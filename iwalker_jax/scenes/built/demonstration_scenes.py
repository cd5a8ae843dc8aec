"""The scenes of the demonstrations, designed by hand: a factory hall, a winding corridor and a cluttered office."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.built.furniture import (
    cabinet,
    chair,
    clutter,
    desk,
    office_chair,
    person,
    rack,
    shelf,
    sofa,
    table,
    waste_bin,
)
from iwalker_jax.scenes.built.layout import Furniture, Layout, Pose2D, designed_layout
from iwalker_jax.scenes.built.oblique_walls import bent_passage, enclose_polygon
from iwalker_jax.scenes.built.rooms import seat_around
from iwalker_jax.scenes.scene import Scene
from iwalker_jax.streams import DEMONSTRATION_FURNITURE


@dataclass(frozen=True, eq=False)
class DemonstrationScene:
    """A scene, where a robot starts in it and where it shall go.

    Attributes:
        scene: the scene.
        start: x, y [m] and yaw [rad].
        goals: (G, 2) [m], to visit in this order.
    """

    scene: Scene
    start: Pose2D
    goals: np.ndarray


class _Jitter:
    """Moves small things a little, so that every seed shows the same scene somewhat rearranged."""

    def __init__(self, rng: np.random.Generator, shift: float, turn: float) -> None:
        self._rng, self._shift, self._turn = rng, shift, turn

    def __call__(self, x: float, y: float, yaw: float = 0.0) -> Pose2D:
        moved = self._rng.uniform(-1, 1, 3) * (self._shift, self._shift, self._turn)
        return Pose2D(x + float(moved[0]), y + float(moved[1]), yaw + float(moved[2]))


_Design = tuple[Layout, Pose2D, list[tuple[float, float]]]


def demonstration_scene(name: str, rng: np.random.Generator) -> DemonstrationScene:
    """The demonstration of a name in `DEMONSTRATION_NAMES`, its clutter moved and its start pose drawn at random.

    Args:
        name: of the demonstration.
        rng: of clutter (8 cm, 15 degrees) and start (5 cm, 5 degrees); the building and large pieces stay.

    Raises:
        InputError: for an unknown name.
    """
    if name not in _DESIGNS:
        raise InputError(f"Unknown demonstration {name!r}; choose one of {', '.join(DEMONSTRATION_NAMES)}.")
    layout, start, goals = _DESIGNS[name](_Jitter(rng, 0.08, math.radians(15)))
    start = _Jitter(rng, 0.05, math.radians(5))(start.x, start.y, start.yaw)
    return DemonstrationScene(layout.scene(f"demonstration-{name}", f"demonstration_{name}"), start, np.asarray(goals))


def _drum(radius: float, height: float) -> Furniture:
    """A drum with its two rolling hoops."""

    def build(out: Layout, at: Pose2D) -> None:
        out.cylinder(at, radius, 0.0, height)
        for level in (0.33, 0.66):
            out.cylinder(at, radius + 0.012, level * height - 0.015, level * height + 0.015)

    return Furniture(2 * radius, 2 * radius, build)


def _machine(length: float, width: float, height: float) -> Furniture:
    """A machine tool: bed, column with a hood, and a control panel on an arm."""

    def build(out: Layout, at: Pose2D) -> None:
        out.box(at, length, width, 0.0, 0.55 * height)
        out.box(at.moved(-0.15 * length, 0.0), 0.6 * length, 0.8 * width, 0.55 * height, height)
        out.box(at.moved(length / 2 - 0.05, width / 2 + 0.1), 0.3, 0.06, 0.62 * height, 0.85 * height)

    return Furniture(length, width, build)


def _pallet(layers: int) -> Furniture:
    """A pallet on its blocks with cartons stacked in layers."""

    def build(out: Layout, at: Pose2D) -> None:
        out.box(at, 0.8, 0.6, 0.09, 0.13)
        for sx in (-1, 0, 1):
            out.box(at.moved(sx * 0.34, 0.0), 0.1, 0.6, 0.0, 0.09)
        for layer in range(layers):
            level = 0.13 + 0.28 * layer
            out.box(at.moved(0.0, 0.0, 0.05 * (-1) ** layer), 0.74 - 0.06 * layer, 0.55, level, level + 0.28)

    return Furniture(0.8, 0.6, build)


def _round_table(radius: float) -> Furniture:
    """A round table on a stem with a plate-shaped foot."""

    def build(out: Layout, at: Pose2D) -> None:
        out.cylinder(at, 0.26, 0.0, 0.03)
        out.cylinder(at, 0.04, 0.03, 0.7)
        out.cylinder(at, radius, 0.7, 0.73)

    return Furniture(2 * radius, 2 * radius, build)


def _coat_stand() -> Furniture:
    """A coat stand: pole on a cross, with coats hanging from its top."""

    def build(out: Layout, at: Pose2D) -> None:
        for turn in (0.0, math.pi / 2):
            out.box(at.moved(0.0, 0.0, turn), 0.5, 0.04, 0.0, 0.05)
        out.cylinder(at, 0.02, 0.05, 1.7)
        out.box(at.moved(0.12, 0.05, 0.4), 0.16, 0.42, 0.55, 1.55)

    return Furniture(0.5, 0.5, build)


def _plant(height: float) -> Furniture:
    """A potted plant whose leaves spread wider than its pot."""

    def build(out: Layout, at: Pose2D) -> None:
        out.cylinder(at, 0.14, 0.0, 0.28)
        out.cylinder(at, 0.02, 0.28, 0.45)
        for k in range(3):
            leaves = at.moved(0.0, 0.0, 2.1 * k).moved(0.08, 0.0)
            out.cylinder(leaves, 0.2 - 0.03 * k, 0.42 + 0.2 * k, min(0.66 + 0.25 * k, height))

    return Furniture(0.5, 0.5, build)


def _factory(jitter: _Jitter) -> _Design:
    """A hall between pillars: drums to weave through, a line of racks with one narrow gap, machines behind it."""
    layout = designed_layout(DEMONSTRATION_FURNITURE.generator(0), (0.0, 0.0, 9.0, 6.6))
    corners = [(0.0, 0.0), (9.0, 0.0), (9.0, 5.0), (7.6, 6.6), (0.0, 6.6)]
    enclose_polygon(layout, corners, {4: ((3.6, 1.1),), 0: ((7.4, 1.0),)})
    round_pillar = Furniture(0.4, 0.4, lambda out, at: out.cylinder(at, 0.2, 0.0, out.ceiling))
    for x in (2.5, 6.4):
        for y in (2.1, 4.6):
            round_pillar.build(layout, Pose2D(x, y))
    # The line across the hall; between the two drums in it remains a gap of 0.66 m.
    gap = 2.95
    layout.furnish(
        [
            (rack(layout, 2.1, 0.8), Pose2D(4.4, 1.07)),
            (_drum(0.29, 0.88), Pose2D(4.35, gap - 0.33 - 0.29)),
            (_drum(0.29, 0.88), Pose2D(4.45, gap + 0.33 + 0.29)),
            (rack(layout, 2.35, 0.8), Pose2D(4.4, 5.4)),
            (_machine(1.5, 0.8, 1.5), Pose2D(7.9, 3.05, math.pi / 2)),
            (_machine(1.2, 0.7, 1.3), Pose2D(2.0, 6.15)),
            (shelf(layout, 1.4), Pose2D(0.25, 5.3)),
            (cabinet(layout, 1.0, 0.45, 1.9), Pose2D(6.2, 0.24, math.pi / 2)),
        ],
    )
    layout.furnish(
        [
            (_drum(0.27, 0.85), jitter(1.7, 1.9)),
            (_drum(0.27, 0.85), jitter(1.6, 2.6)),
            (_drum(0.29, 0.9), jitter(3.2, 0.5)),
            (_drum(0.25, 0.8), jitter(3.35, 4.35)),
            (_pallet(2), jitter(1.3, 4.3, 0.3)),
            (_pallet(3), jitter(5.6, 1.3, 1.2)),
            (_drum(0.27, 0.85), jitter(5.75, 3.35)),
            (_drum(0.27, 0.85), jitter(6.05, 5.7)),
            (_drum(0.27, 0.85), jitter(7.5, 1.0)),
            (clutter(layout), jitter(8.5, 0.7, 0.4)),
            (person(layout), jitter(8.3, 4.5, 2.0)),
            (waste_bin(layout), jitter(0.35, 6.2)),
        ],
    )
    return layout, Pose2D(0.95, 0.9, math.radians(8)), [(3.15, 2.95), (5.25, 4.15), (7.1, 2.0)]


_CORRIDOR_WIDTH = 1.4


def _corridor(jitter: _Jitter) -> _Design:
    """A corridor that turns left, right, right and left again, with things along its walls."""
    layout = designed_layout(DEMONSTRATION_FURNITURE.generator(1), (0.0, 0.0, 8.8, 4.0))
    legs = ((2.2, 0.0), (2.3, 62.0), (2.3, 2.0), (2.1, -58.0), (2.2, 4.0))
    line = [(0.0, 1.0)]
    for length, degrees in legs:
        line.append(Pose2D(*line[-1], math.radians(degrees)).point(length, 0.0))
    bent_passage(layout, line, _CORRIDOR_WIDTH, 0.45)
    at = [Pose2D(*corner, math.radians(degrees)) for corner, (_, degrees) in zip(line, legs)]
    side = _CORRIDOR_WIDTH / 2
    layout.furnish(
        [
            (cabinet(layout, 0.8, 0.26, 1.1), at[0].moved(1.2, side - 0.14, -math.pi / 2)),
            (shelf(layout, 0.9, 0.26), at[2].moved(1.1, side - 0.14, -math.pi / 2)),
            (cabinet(layout, 0.7, 0.24, 0.9), at[3].moved(0.9, -side + 0.13, math.pi / 2)),
        ],
    )
    for leg, forward, left, piece in (
        (0, 1.9, -0.45, _plant(1.0)),
        (1, 1.2, -0.42, _drum(0.18, 0.6)),
        (2, 1.95, -0.45, _plant(1.1)),
        (3, 1.75, 0.42, _drum(0.17, 0.5)),
        (4, 0.9, 0.38, chair(layout)),
    ):
        piece.build(layout, jitter(*at[leg].point(forward, left), at[leg].yaw + 0.3))
    return layout, at[0].moved(0.5, 0.0), [at[4].point(1.6, -0.1)]


def _office(jitter: _Jitter) -> _Design:
    """An office crammed with desks, a meeting table, a round table, plants and cartons, all at odd angles."""
    layout = designed_layout(DEMONSTRATION_FURNITURE.generator(2), (0.0, 0.0, 8.0, 6.2))
    corners = [(0.0, 0.0), (8.0, 0.0), (8.0, 4.6), (6.6, 6.2), (0.0, 6.2)]
    enclose_polygon(layout, corners, {4: ((1.2, 0.95),), 0: ((7.0, 1.0),)})
    meeting = Pose2D(3.0, 2.75, math.radians(18))
    layout.furnish(
        [
            (table(layout, 0.9, 1.7), meeting),
            (desk(layout, 1.5), Pose2D(0.6, 4.6, math.pi)),
            (desk(layout, 1.5), Pose2D(5.3, 0.6, -math.pi / 2)),
            (desk(layout, 1.4), Pose2D(5.4, 3.1, math.radians(-65))),
            (desk(layout, 1.4), Pose2D(7.35, 3.4, 0.0)),
            (_round_table(0.45), Pose2D(4.9, 5.1)),
            (shelf(layout, 1.2), Pose2D(2.3, 5.95, -math.pi / 2)),
            (cabinet(layout, 1.0, 0.45, 1.1), Pose2D(3.4, 0.25, math.pi / 2)),
            (sofa(layout, 1.4), Pose2D(2.0, 0.47, math.pi / 2)),
        ],
    )
    seat_around(layout, meeting, 0.9, 1.7, chair, ends=False)
    layout.furnish(
        [
            (office_chair(layout), jitter(1.35, 4.5, math.pi + 0.3)),
            (office_chair(layout), jitter(5.2, 1.35, -math.pi / 2)),
            (office_chair(layout), jitter(6.55, 3.5, 0.3)),
            (chair(layout), jitter(4.2, 5.35, -0.3)),
            (chair(layout), jitter(5.55, 5.2, 3.0)),
            (_plant(1.3), jitter(0.4, 2.6)),
            (_plant(1.2), jitter(3.9, 4.0)),
            (_coat_stand(), jitter(6.6, 5.2, 0.6)),
            (clutter(layout), jitter(1.5, 1.8, 0.5)),
            (clutter(layout), jitter(7.4, 1.9, 0.9)),
            (waste_bin(layout), jitter(6.4, 0.4)),
        ],
    )
    return layout, Pose2D(0.75, 1.2, math.radians(60)), [(2.1, 4.0), (5.75, 4.25)]


_DESIGNS: dict[str, Callable[[_Jitter], _Design]] = {
    "factory": _factory,
    "corridor": _corridor,
    "office": _office,
}

DEMONSTRATION_NAMES: tuple[str, ...] = tuple(_DESIGNS)
"""Names of the demonstration scenes."""

"""Builder of scenes on the host: collects boxes and cylinders and keeps furniture from overlapping."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.scene import Scene


@dataclass(frozen=True)
class Style:
    """What a building's parts have in common: ranges (low, high) [m], and the share of doorways with an open door."""

    wall_thickness: tuple[float, float] = (0.08, 0.14)
    ceiling: tuple[float, float] = (2.4, 3.1)
    door_width: tuple[float, float] = (0.75, 1.05)
    door_height: tuple[float, float] = (1.98, 2.1)
    table_height: tuple[float, float] = (0.70, 0.755)
    seat_height: tuple[float, float] = (0.40, 0.48)
    shelf_height: tuple[float, float] = (1.2, 2.2)
    barrel_radius: tuple[float, float] = (0.22, 0.32)
    pillar_radius: tuple[float, float] = (0.12, 0.28)
    post_radius: tuple[float, float] = (0.14, 0.22)
    clutter_size: tuple[float, float] = (0.2, 0.65)
    open_doors: float = 0.45

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name == "open_doors":
                if not 0 <= value <= 1:
                    raise InputError(f"Style.open_doors is a share between 0 and 1, got {value}.")
            elif not 0 < value[0] <= value[1]:
                raise InputError(f"Style.{name} must be a range (low, high) with 0 < low <= high [m], got {value}.")


TRAINING_STYLE = Style()
"""Style of the training scenes."""

HELD_OUT_STYLE = Style(
    wall_thickness=(0.18, 0.26),
    ceiling=(3.2, 3.8),
    door_width=(0.85, 1.1),
    door_height=(2.12, 2.3),
    table_height=(0.71, 0.76),
    seat_height=(0.42, 0.5),
    shelf_height=(1.0, 2.0),
    barrel_radius=(0.2, 0.36),
    pillar_radius=(0.16, 0.34),
    post_radius=(0.15, 0.24),
    clutter_size=(0.25, 0.75),
    open_doors=0.3,
)
"""Ceiling and wall thickness lie outside every range of training, so no layout can appear in both."""


@dataclass(frozen=True)
class Pose2D:
    """A pose in plan view: x, y [m] and yaw [rad]; furniture faces its local +x, and its back is at -x."""

    x: float
    y: float
    yaw: float = 0.0

    def point(self, forward: float, left: float) -> tuple[float, float]:
        """World (x, y) [m] of a point given in this pose's own axes."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return self.x + cos * forward - sin * left, self.y + sin * forward + cos * left

    def moved(self, forward: float, left: float, turn: float = 0.0) -> "Pose2D":
        """This pose shifted [m] along its own axes, then turned [rad]."""
        return Pose2D(*self.point(forward, left), self.yaw + turn)


@dataclass(frozen=True)
class Furniture:
    """Something to put in a room: its reserved footprint (length along local x, width along y) [m] and its parts."""

    length: float
    width: float
    build: Callable[["Layout", Pose2D], None]


@dataclass
class Layout:
    """A scene under construction.

    Attributes:
        rng: source of every random choice.
        style: ranges of the building's common dimensions.
        bounds: (x_min, y_min, x_max, y_max) [m].
        ceiling: [m].
        wall_thickness: [m].
    """

    rng: np.random.Generator
    style: Style
    bounds: tuple[float, float, float, float]
    ceiling: float = field(init=False)
    wall_thickness: float = field(init=False)
    boxes: list[tuple[float, ...]] = field(default_factory=list)
    cylinders: list[tuple[float, ...]] = field(default_factory=list)
    reserved: list[tuple[Pose2D, float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.ceiling = self.draw("ceiling")
        self.wall_thickness = self.draw("wall_thickness")

    def draw(self, name: str) -> float:
        """A value [m] from the style's range of that name."""
        return float(self.rng.uniform(*getattr(self.style, name)))

    def uniform(self, low: float, high: float) -> float:
        """A uniform random number."""
        return float(self.rng.uniform(low, high))

    def chance(self, probability: float) -> bool:
        """True with a probability."""
        return self.uniform(0.0, 1.0) < probability

    def box(self, pose: Pose2D, length: float, width: float, z_low: float, z_high: float) -> None:
        """Add a box centred at a pose: full sizes along the pose's x and y, and its lower and upper height [m]."""
        self.boxes.append(
            (
                pose.x,
                pose.y,
                (z_low + z_high) / 2,
                length / 2,
                width / 2,
                (z_high - z_low) / 2,
                math.remainder(pose.yaw, 2 * math.pi),
            )
        )

    def cylinder(self, pose: Pose2D, radius: float, z_low: float, z_high: float) -> None:
        """Add an upright cylinder."""
        self.cylinders.append((pose.x, pose.y, (z_low + z_high) / 2, radius, (z_high - z_low) / 2))

    def reserve(self, pose: Pose2D, length: float, width: float) -> None:
        """Keep later furniture out of an oriented rectangle."""
        self.reserved.append((pose, length, width))

    def is_free(self, pose: Pose2D, length: float, width: float, gap: float) -> bool:
        """Whether an oriented rectangle, widened by `gap` [m] all round, misses everything reserved."""
        return not any(_overlap((pose, length + 2 * gap, width + 2 * gap), other) for other in self.reserved)

    def put(self, furniture: Furniture, pose: Pose2D, gap: float = 0.0) -> bool:
        """Build furniture at a pose if its footprint is free there; True if it was."""
        if not self.is_free(pose, furniture.length, furniture.width, gap):
            return False
        self.reserve(pose, furniture.length, furniture.width)
        furniture.build(self, pose)
        return True

    def furnish(self, pieces: Sequence[tuple[Furniture, Pose2D]]) -> None:
        """Build pieces where a design wants them, whether or not that is reserved."""
        for furniture, pose in pieces:
            furniture.build(self, pose)

    def wall(
        self,
        start: tuple[float, float],
        end: tuple[float, float],
        openings: tuple[tuple[float, float], ...] = (),
        height: float | None = None,
    ) -> None:
        """Add a wall from start to end with doorways.

        Args:
            start, end: [m] ends of the wall's centre line.
            openings: (centre along the wall, width) [m], in order; a lintel closes each above the door height, some
                have a door standing open, and the floor a metre before and behind stays clear.
            height: [m]; to the ceiling by default.
        """
        top = self.ceiling if height is None else height
        length = math.dist(start, end)
        yaw = math.atan2(end[1] - start[1], end[0] - start[0])
        origin = Pose2D(*start, yaw)
        done = 0.0
        for centre, width in openings:
            self._wall_piece(origin, done, centre - width / 2, 0.0, top)
            door_top = min(self.draw("door_height"), top - 0.1)
            self._wall_piece(origin, centre - width / 2, centre + width / 2, door_top, top)
            if self.chance(self.style.open_doors):
                self._open_door(origin.moved(centre, 0.0), width, door_top - 0.02)
            self.reserve(origin.moved(centre, 0.0), width + 0.1, 2.0)
            done = centre + width / 2
        self._wall_piece(origin, done, length, 0.0, top)
        self.reserve(origin.moved(length / 2, 0.0), length, self.wall_thickness)

    def _open_door(self, doorway: Pose2D, width: float, height: float) -> None:
        # Hinged on either jamb, opening to either side by at least a right angle: the doorway keeps its width.
        jamb, swing = (1.0 if self.chance(0.5) else -1.0 for _ in range(2))
        hinge = doorway.moved(jamb * (width / 2 + 0.03), swing * self.wall_thickness / 2)
        opened = swing * (math.pi / 2 - jamb * self.uniform(0.02, 0.5))
        leaf = hinge.moved(0.0, 0.0, opened).moved(width / 2, 0.0)
        if self.is_free(leaf, width - 0.1, 0.06, 0.0):
            self.box(leaf, width, 0.04, 0.01, height)
            self.reserve(leaf, width, 0.06)

    def _wall_piece(self, origin: Pose2D, begin: float, end: float, z_low: float, z_high: float) -> None:
        if end - begin > 0.02:
            self.box(origin.moved((begin + end) / 2, 0.0), end - begin, self.wall_thickness, z_low, z_high)

    def scene(self, name: str, family: str) -> Scene:
        """The finished scene."""
        boxes = np.asarray(self.boxes).reshape(-1, 7)
        cylinders = np.asarray(self.cylinders).reshape(-1, 5)
        return Scene(name, family, boxes, cylinders, self.bounds, self.ceiling)


def designed_layout(rng: np.random.Generator, bounds: tuple[float, float, float, float]) -> Layout:
    """An empty layout [m] for a design by hand, in the held-out style and without open doors.

    Args:
        rng: of the furniture's small dimensions; seed it by a constant to make them constants of the design.
        bounds: (x_min, y_min, x_max, y_max) [m].
    """
    return Layout(rng, replace(HELD_OUT_STYLE, open_doors=0.0), bounds)


def _overlap(first: tuple[Pose2D, float, float], second: tuple[Pose2D, float, float]) -> bool:
    # Separating axes of two oriented rectangles are their four edge directions.
    dx, dy = second[0].x - first[0].x, second[0].y - first[0].y
    for yaw in (first[0].yaw, second[0].yaw):
        for angle in (yaw, yaw + math.pi / 2):
            reach = sum(
                abs(math.cos(angle - p.yaw)) * length / 2 + abs(math.sin(angle - p.yaw)) * width / 2
                for p, length, width in (first, second)
            )
            if abs(math.cos(angle) * dx + math.sin(angle) * dy) >= reach:
                return False
    return True

"""Rooms of the scenes: enclosing walls with doorways, and where furniture goes in them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from iwalker_jax.scenes.built.layout import Furniture, Layout, Pose2D

Maker = Callable[[Layout], Furniture]

SIDES = ("south", "east", "north", "west")


@dataclass(frozen=True)
class Rectangle:
    """An axis-aligned part of the floor [m]."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @property
    def length(self) -> float:
        """[m] along x."""
        return self.x_max - self.x_min

    @property
    def width(self) -> float:
        """[m] along y."""
        return self.y_max - self.y_min

    @property
    def centre(self) -> Pose2D:
        """The middle, facing +x."""
        return Pose2D((self.x_min + self.x_max) / 2, (self.y_min + self.y_max) / 2)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(x_min, y_min, x_max, y_max)."""
        return self.x_min, self.y_min, self.x_max, self.y_max

    def shrunk(self, margin: float) -> "Rectangle":
        """The rectangle without a margin [m] on every side."""
        return Rectangle(self.x_min + margin, self.y_min + margin, self.x_max - margin, self.y_max - margin)

    def side(self, name: str) -> tuple[tuple[float, float], tuple[float, float]]:
        """Ends of a side, walked counter-clockwise, so that the inside lies to the left."""
        corners = (
            (self.x_min, self.y_min),
            (self.x_max, self.y_min),
            (self.x_max, self.y_max),
            (self.x_min, self.y_max),
        )
        i = SIDES.index(name)
        return corners[i], corners[(i + 1) % 4]


def enclose(layout: Layout, room: Rectangle, doors: dict[str, tuple[tuple[float, float], ...]]) -> None:
    """Walls around a room, just outside its floor.

    Args:
        layout: to build in.
        room: the room's floor.
        doors: per side, (fraction of the side, width [m]) of each doorway in counter-clockwise order.
    """
    outer = room.shrunk(-layout.wall_thickness / 2)
    for name in SIDES:
        start, end = outer.side(name)
        length = math.dist(start, end)
        openings = tuple((fraction * length, width) for fraction, width in doors.get(name, ()))
        layout.wall(start, end, openings)


def pose_at_wall(room: Rectangle, side: str, along: float, offset: float) -> Pose2D:
    """A place `along` [m] a side and `offset` [m] inside it, facing into the room."""
    start, end = room.side(side)
    yaw = math.atan2(end[1] - start[1], end[0] - start[0])
    return Pose2D(*start, yaw).moved(along, offset, math.pi / 2)


def put_against_wall(layout: Layout, room: Rectangle, furniture: Furniture, side: str, fraction: float) -> bool:
    """Put furniture with its back to a wall, centred at a fraction of the free length; True if it fits."""
    length = math.dist(*room.side(side))
    if length < furniture.width + 0.1:
        return False
    along = furniture.width / 2 + 0.02 + fraction * (length - furniture.width - 0.04)
    return layout.put(furniture, pose_at_wall(room, side, along, furniture.length / 2 + 0.015))


def line_walls(layout: Layout, room: Rectangle, makers: Sequence[Maker], count: int) -> None:
    """Put `count` pieces with their backs to random walls, where doors and earlier pieces leave room."""
    for _ in range(count):
        furniture = _choose(layout, makers)(layout)
        for _ in range(12):
            side = SIDES[layout.rng.integers(4)]
            if put_against_wall(layout, room, furniture, side, layout.uniform(0.0, 1.0)):
                break


def scatter(
    layout: Layout, area: Rectangle, makers: Sequence[Maker], count: int, gap: float = 0.4, squared: bool = False
) -> None:
    """Put up to `count` pieces at random poses in an area, `gap` [m] apart; `squared` keeps them parallel to walls."""
    for _ in range(count):
        furniture = _choose(layout, makers)(layout)
        for _ in range(15):
            yaw = layout.uniform(-math.pi, math.pi)
            if squared:
                yaw = round(yaw / (math.pi / 2)) * math.pi / 2 + layout.uniform(-0.1, 0.1)
            x, y = layout.uniform(area.x_min, area.x_max), layout.uniform(area.y_min, area.y_max)
            if layout.put(furniture, Pose2D(x, y, yaw), gap):
                break


def _choose(layout: Layout, makers: Sequence[Maker]) -> Maker:
    return makers[int(layout.rng.integers(len(makers)))]


def dress_walls(layout: Layout, room: Rectangle, count: int) -> None:
    """Radiators, boards and pilasters on the walls: the relief a depth camera sees on real walls."""
    for _ in range(count):
        side = SIDES[layout.rng.integers(4)]
        length = math.dist(*room.side(side))
        width = layout.uniform(0.3, min(1.4, 0.5 * length))
        along = layout.uniform(width / 2, length - width / 2)
        kind = layout.uniform(0.0, 1.0)
        if kind < 0.45:
            pose, depth, z_low, z_high = pose_at_wall(room, side, along, 0.02), 0.04, 0.9, 1.6
        elif kind < 0.8:
            pose, depth, z_low, z_high = pose_at_wall(room, side, along, 0.06), 0.1, 0.12, 0.65
        else:
            width = 0.35
            pose, depth, z_low, z_high = pose_at_wall(room, side, along, 0.1), 0.2, 0.0, layout.ceiling
        if layout.is_free(pose, depth, width, 0.0):
            layout.box(pose, depth, width, z_low, z_high)
            layout.reserve(pose, depth, width)


def seat_around(
    layout: Layout, at: Pose2D, length: float, width: float, maker: Maker, ends: bool, share: float = 1.0
) -> None:
    """Chairs that face a table of the given size from its two sides (and ends), partly pulled out and turned."""
    spots: list[tuple[float, float, float]] = []
    per_side = max(1, int(width // 0.75))
    for i in range(per_side):
        lateral = (i + 0.5) * width / per_side - width / 2
        spots += [(-length / 2, lateral, 0.0), (length / 2, lateral, math.pi)]
    if ends:
        spots += [(0.0, -width / 2, math.pi / 2), (0.0, width / 2, -math.pi / 2)]
    for forward, left, yaw in spots:
        if layout.uniform(0.0, 1.0) > share:
            continue
        furniture = maker(layout)
        turn = layout.uniform(-0.35, 0.35)
        reach = (furniture.length * math.cos(turn) + furniture.width * abs(math.sin(turn))) / 2
        pulled = -reach - layout.uniform(0.01, 0.25)
        layout.put(furniture, at.moved(forward, left, yaw).moved(pulled, layout.uniform(-0.05, 0.05), turn))

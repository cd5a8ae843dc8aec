"""Walls that training scenes never have: polygonal rooms and bent passages at oblique angles."""

import math
from collections.abc import Sequence

import numpy as np

from iwalker_jax.scenes.built.layout import Layout, Pose2D

Point = tuple[float, float]

_BEHIND = 2.0
"""[m] depth of the solid building part behind a slanted wall."""


def enclose_polygon(
    layout: Layout, corners: Sequence[Point], doors: dict[int, tuple[tuple[float, float], ...]] | None = None
) -> None:
    """Walls just outside a convex polygon; what lies behind a slanted wall is another building part, solid.

    Args:
        layout: to build in.
        corners: [m] counter-clockwise.
        doors: per edge index, (centre along the edge, width) [m] of its doorways.
    """
    t = layout.wall_thickness
    for i, start in enumerate(corners):
        end = corners[(i + 1) % len(corners)]
        length = math.dist(start, end)
        edge = Pose2D(*start, math.atan2(end[1] - start[1], end[0] - start[0]))
        openings = tuple((centre + t, width) for centre, width in (doors or {}).get(i, ()))
        # A thickness beyond each end closes the corner whatever its angle.
        layout.wall(edge.point(-t, -t / 2), edge.point(length + t, -t / 2), openings)
        if not openings and abs(math.sin(2 * edge.yaw)) > 0.05:
            layout.box(edge.moved(length / 2, -t - _BEHIND / 2), length, _BEHIND, 0.0, layout.ceiling)


def bent_passage(
    layout: Layout,
    centreline: Sequence[Point],
    width: float,
    depth: float,
    rooms: Sequence[tuple[int, int, float, float, float, float]] = (),
) -> None:
    """A passage of constant width around a polyline that turns by less than 90 degrees, closed at both ends.

    Args:
        layout: to build in.
        centreline: [m] corners of the middle line.
        width: [m] between the walls.
        depth: [m] of the solid building parts on both sides.
        rooms: side rooms hollowed out of them, (segment, side: 1 left or -1 right, begin, end, door centre, door
            width) [m] along that side's wall.
    """
    steps = np.diff(np.asarray(centreline), axis=0)
    headings = [math.atan2(step[1], step[0]) for step in steps]
    turns = np.diff(headings)
    t = layout.wall_thickness
    for k, heading in enumerate(headings):
        before = math.tan(turns[k - 1] / 2) if k > 0 else 0.0
        after = math.tan(turns[k] / 2) if k < len(turns) else 0.0
        length = float(np.hypot(*steps[k]))
        for side in (1, -1):
            # Mitred joints: the inner wall of a bend is shorter, the outer one longer and closes the wedge behind it.
            begin = side * before * width / 2
            end = length - side * after * width / 2
            wall = Pose2D(*centreline[k], heading).moved(begin, side * width / 2)
            span = end - begin
            overrun = [max(-side * bend, 0.0) * (depth + t) for bend in (before, after)]
            own = [room for room in rooms if room[:2] == (k, side)]
            doors = tuple((room[4] + overrun[0], room[5]) for room in own)
            start = wall.moved(-overrun[0], side * t / 2)
            layout.wall(start.point(0.0, 0.0), start.point(span + sum(overrun), 0.0), doors)
            _fill_behind(layout, wall, side, depth, -overrun[0], span + overrun[1], [(r[2], r[3]) for r in own])
    for tip in (Pose2D(*centreline[0], headings[0] + math.pi), Pose2D(*centreline[-1], headings[-1])):
        layout.wall(tip.point(t / 2, -width / 2 - t), tip.point(t / 2, width / 2 + t))


def _fill_behind(
    layout: Layout, wall: Pose2D, side: int, depth: float, begin: float, end: float, hollows: list[tuple[float, float]]
) -> None:
    t = layout.wall_thickness
    edges = [begin, *[edge for hollow in hollows for edge in hollow], end]
    for low, high in zip(edges[::2], edges[1::2], strict=True):
        mass = wall.moved((low + high) / 2, side * (t + depth / 2))
        layout.box(mass, high - low, depth, 0.0, layout.ceiling)
        layout.reserve(mass, high - low, depth)
    for low, high in hollows:
        layout.box(wall.moved((low + high) / 2, side * (depth + t / 2)), high - low, t, 0.0, layout.ceiling)

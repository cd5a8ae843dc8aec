"""Training families that are passages: corridors, joined rooms, landings, slaloms and gaps."""

import math

import numpy as np

from iwalker_jax.scenes.built.furniture import (
    barrel,
    cabinet,
    chair,
    clutter,
    person,
    pillar,
    shelf,
    staircase,
    table,
    waste_bin,
)
from iwalker_jax.scenes.built.layout import Furniture, Layout, Pose2D, Style
from iwalker_jax.scenes.built.rooms import SIDES, Rectangle, dress_walls, enclose, line_walls, put_against_wall, scatter

_ON_WALL = [
    waste_bin,
    chair,
    clutter,
    lambda layout: cabinet(layout, layout.uniform(0.5, 1.0), layout.uniform(0.25, 0.4), layout.uniform(0.7, 1.8)),
    lambda layout: shelf(layout, 0.8, 0.28),
]


def corridor(rng: np.random.Generator, style: Style) -> Layout:
    """A straight corridor with doorways into small rooms on both sides and things along its walls."""
    length, width = float(rng.uniform(8.0, 12.0)), float(rng.uniform(1.5, 2.4))
    depth = float(rng.uniform(1.6, 2.6))
    layout = Layout(rng, style, (0.0, -depth, length, width + depth))
    half = layout.wall_thickness / 2
    for y, outer in ((-half, -depth), (width + half, width + depth)):
        count = int(rng.integers(2, 4))
        centres = [(i + layout.uniform(0.3, 0.7)) * length / count for i in range(count)]
        layout.wall((0.0, y), (length, y), tuple((c, layout.draw("door_width")) for c in centres))
        layout.wall((0.0, outer), (length, outer))
        for i in range(1, count):
            layout.wall((i * length / count, y), (i * length / count, outer))
    layout.wall((-half, -depth), (-half, width + depth))
    layout.wall((length + half, -depth), (length + half, width + depth))
    passage = Rectangle(0.0, 0.0, length, width)
    line_walls(layout, passage, _ON_WALL, int(rng.integers(4, 8)))
    scatter(layout, passage.shrunk(0.35), [person, waste_bin, clutter], 2, gap=0.45)
    for room in (Rectangle(0.0, -depth, length, -0.1), Rectangle(0.0, width + 0.1, length, width + depth)):
        scatter(layout, room.shrunk(0.3), [chair, clutter, barrel], 3)
    dress_walls(layout, passage, 5)
    return layout


def l_corridor(rng: np.random.Generator, style: Style) -> Layout:
    """Two corridor legs that meet at a right-angled corner."""
    first, second = float(rng.uniform(5.5, 9.0)), float(rng.uniform(5.5, 9.0))
    wide, narrow = float(rng.uniform(1.4, 2.3)), float(rng.uniform(1.3, 2.1))
    layout = Layout(rng, style, (0.0, 0.0, first, second))
    outer = Rectangle(0.0, 0.0, first, second)
    enclose(layout, outer, {"west": ((0.8, layout.draw("door_width")),)})
    # The solid block inside the L leaves a leg along x (south) and a leg along y (east).
    t = layout.wall_thickness / 2
    corner = (first - narrow - t, wide + t)
    layout.wall((0.0, corner[1]), corner, ((layout.uniform(0.3, 0.7) * corner[0], layout.draw("door_width")),))
    layout.wall(corner, (corner[0], second))
    legs = Rectangle(0.0, 0.0, first, wide), Rectangle(first - narrow, 0.0, first, second)
    for leg in legs:
        line_walls(layout, leg, _ON_WALL, int(rng.integers(2, 5)))
        scatter(layout, leg.shrunk(0.35), [person, waste_bin, clutter], 1, gap=0.4)
    inner = Rectangle(0.0, corner[1] + t, corner[0] - t, second)
    scatter(layout, inner.shrunk(0.5), [barrel, chair, clutter, lambda layout: table(layout, 0.7, 1.2)], 6)
    dress_walls(layout, legs[0], 4)
    dress_walls(layout, legs[1], 4)
    return layout


def t_corridor(rng: np.random.Generator, style: Style) -> Layout:
    """A corridor that ends in the side of another."""
    length, stem = float(rng.uniform(8.0, 12.0)), float(rng.uniform(4.0, 6.5))
    bar_width, stem_width = float(rng.uniform(1.4, 2.3)), float(rng.uniform(1.3, 2.2))
    layout = Layout(rng, style, (0.0, -stem, length, bar_width))
    t = layout.wall_thickness / 2
    left = layout.uniform(0.25, 0.65) * (length - stem_width)
    right = left + stem_width
    layout.wall((0.0, bar_width + t), (length, bar_width + t), ((0.5 * length, layout.draw("door_width")),))
    # What lies beside the stem is another building part, solid to this scene.
    for x_min, x_max in ((0.0, left), (right, length)):
        mass = Pose2D((x_min + x_max) / 2, -stem / 2)
        layout.box(mass, x_max - x_min, stem, 0.0, layout.ceiling)
        layout.reserve(mass, x_max - x_min, stem)
    layout.wall((left, -stem - t), (right, -stem - t))
    for x in (-t, length + t):
        layout.wall((x, 0.0), (x, bar_width))
    bar, foot = Rectangle(0.0, 0.0, length, bar_width), Rectangle(left, -stem, right, 0.0)
    for leg in (bar, foot):
        line_walls(layout, leg, _ON_WALL, int(rng.integers(3, 6)))
        scatter(layout, leg.shrunk(0.35), [person, barrel, clutter], 2, gap=0.4)
        dress_walls(layout, leg, 4)
    return layout


def joined_rooms(rng: np.random.Generator, style: Style) -> Layout:
    """Three or four rooms joined by doorways, each furnished differently."""
    size = Rectangle(0.0, 0.0, float(rng.uniform(7.5, 11.0)), float(rng.uniform(6.5, 9.0)))
    layout = Layout(rng, style, size.bounds)
    enclose(layout, size, {"south": ((layout.uniform(0.15, 0.4), layout.draw("door_width")),)})
    t = layout.wall_thickness / 2
    x, y = layout.uniform(0.42, 0.58) * size.length, layout.uniform(0.42, 0.58) * size.width
    across = tuple((c, layout.draw("door_width")) for c in (0.5 * y, y + layout.uniform(0.4, 0.6) * (size.width - y)))
    layout.wall((x, 0.0), (x, size.width), across)
    layout.wall((0.0, y), (x, y), ((layout.uniform(0.3, 0.7) * x, layout.draw("door_width")),))
    rooms = [
        Rectangle(0.0, 0.0, x - t, y - t),
        Rectangle(0.0, y + t, x - t, size.width),
        Rectangle(x + t, 0.0, size.x_max, size.width),
    ]
    if layout.chance(0.5):
        reach = size.length - x
        layout.wall((x, y), (size.x_max, y), ((layout.uniform(0.3, 0.7) * reach, layout.draw("door_width")),))
    for room in rooms:
        line_walls(
            layout,
            room,
            [lambda layout: shelf(layout, 0.9), lambda layout: cabinet(layout, 1.0, 0.5, 0.9), waste_bin],
            2,
        )
        makers = [chair, clutter, waste_bin, barrel, lambda layout: table(layout, 0.7, layout.uniform(0.9, 1.4))]
        scatter(layout, room.shrunk(0.4), makers, int(rng.integers(2, 5)))
        dress_walls(layout, room, 2)
    return layout


def landing(rng: np.random.Generator, style: Style) -> Layout:
    """A landing with flights of stairs, which this robot must walk around, and rails in front of them."""
    room = Rectangle(0.0, 0.0, float(rng.uniform(6.0, 9.0)), float(rng.uniform(5.0, 8.0)))
    layout = Layout(rng, style, room.bounds)
    enclose(layout, room, {"west": ((layout.uniform(0.3, 0.7), layout.draw("door_width")),)})
    for _ in range(int(rng.integers(1, 3))):
        flight = staircase(layout, layout.uniform(1.0, 1.6), int(rng.integers(6, 11)))
        # A flight leans its high end or its side on a wall.
        for _ in range(8):
            side = SIDES[rng.integers(4)]
            if put_against_wall(layout, room, _climbing_to_wall(flight), side, float(rng.choice([0.0, 0.5, 1.0]))):
                break
    scatter(layout, room.shrunk(0.6), [pillar, person, waste_bin], int(rng.integers(2, 5)), gap=0.45)
    line_walls(layout, room, _ON_WALL, 3)
    dress_walls(layout, room, 4)
    return layout


def _climbing_to_wall(flight: Furniture) -> Furniture:
    return Furniture(flight.length, flight.width, lambda out, at: flight.build(out, at.moved(0.0, 0.0, math.pi)))


def slalom(rng: np.random.Generator, style: Style) -> Layout:
    """Obstacles that alternate left and right along a wide corridor, so that every straight line is blocked."""
    length, width = float(rng.uniform(8.0, 12.0)), float(rng.uniform(2.6, 3.8))
    room = Rectangle(0.0, 0.0, length, width)
    layout = Layout(rng, style, room.bounds)
    enclose(layout, room, {"west": ((0.5, layout.draw("door_width")),), "east": ((0.5, layout.draw("door_width")),)})
    side = 1.0 if layout.chance(0.5) else -1.0
    x = layout.uniform(1.4, 2.0)
    while x < length - 1.2:
        reach = width - layout.uniform(0.8, 1.15)
        kind = int(rng.integers(3))
        if kind == 0:
            y = 0.0 if side > 0 else width
            height = layout.uniform(0.8, 2.2)
            layout.wall((x, y), (x + layout.uniform(-0.3, 0.3), y + side * reach), height=min(height, layout.ceiling))
        else:
            makers = [barrel, person] if kind == 1 else [clutter, chair, pillar]
            span = 0.25
            while span < reach - 0.2:
                piece = makers[int(rng.integers(len(makers)))](layout)
                y = span if side > 0 else width - span
                layout.put(piece, Pose2D(x + layout.uniform(-0.1, 0.1), y, layout.uniform(-0.5, 0.5)))
                span += max(piece.width, 0.3) + layout.uniform(0.05, 0.15)
        side = -side
        x += layout.uniform(1.3, 1.9)
    dress_walls(layout, room, 3)
    return layout


def narrow_gap(rng: np.random.Generator, style: Style) -> Layout:
    """A hall cut by rows of furniture that leave a single gap hardly wider than a doorway."""
    room = Rectangle(0.0, 0.0, float(rng.uniform(6.0, 9.5)), float(rng.uniform(4.5, 7.0)))
    layout = Layout(rng, style, room.bounds)
    enclose(layout, room, {"west": ((layout.uniform(0.3, 0.7), layout.draw("door_width")),)})
    for x_fraction in (0.36, 0.7) if room.length > 7.5 else (0.5,):
        x = x_fraction * room.length
        gap = layout.uniform(0.6, 0.9)
        centre = layout.uniform(0.15, 0.85) * (room.width - gap) + gap / 2
        layout.reserve(Pose2D(x, centre), 1.6, gap)
        row = [
            lambda layout: cabinet(
                layout, layout.uniform(0.5, 1.1), layout.uniform(0.35, 0.6), layout.uniform(0.6, 1.9)
            ),
            barrel,
            clutter,
            lambda layout: shelf(layout, 0.8),
        ]
        for low, high in ((0.0, centre - gap / 2), (centre + gap / 2, room.width)):
            y = low
            while high - y > 0.25:
                piece = row[int(rng.integers(len(row)))](layout)
                if piece.width > high - y:
                    piece = cabinet(layout, high - y - 0.02, 0.4, layout.uniform(0.6, 1.5))
                at = Pose2D(x + layout.uniform(-0.08, 0.08), y + piece.width / 2 + 0.01)
                layout.put(piece, at)
                y += piece.width + layout.uniform(0.02, 0.12)
    scatter(layout, room.shrunk(0.5), [chair, waste_bin, person, clutter], 5)
    dress_walls(layout, room, 4)
    return layout

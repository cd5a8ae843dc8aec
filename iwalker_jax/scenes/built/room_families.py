"""Training families that are furnished rooms and halls."""

import math

import numpy as np

from iwalker_jax.scenes.built.furniture import (
    barrel,
    cabinet,
    chair,
    clutter,
    desk,
    office_chair,
    person,
    pillar,
    rack,
    shelf,
    sofa,
    table,
    waste_bin,
)
from iwalker_jax.scenes.built.layout import Layout, Pose2D, Style
from iwalker_jax.scenes.built.rooms import (
    Rectangle,
    dress_walls,
    enclose,
    line_walls,
    pose_at_wall,
    scatter,
    seat_around,
)


def _room(
    rng: np.random.Generator, style: Style, length: tuple[float, float], width: tuple[float, float], doors: int
) -> tuple[Layout, Rectangle]:
    """A rectangular room with doorways at random spots of distinct sides."""
    room = Rectangle(0.0, 0.0, float(rng.uniform(*length)), float(rng.uniform(*width)))
    layout = Layout(rng, style, room.bounds)
    sides = rng.permutation(["south", "east", "north", "west"])[:doors]
    enclose(layout, room, {str(side): ((layout.uniform(0.2, 0.8), layout.draw("door_width")),) for side in sides})
    return layout, room


def open_office(rng: np.random.Generator, style: Style) -> Layout:
    """Rows of desks, single or back to back, with swivel chairs, screens and partitions."""
    layout, room = _room(rng, style, (7.0, 11.0), (6.0, 9.0), 2)
    line_walls(layout, room, [lambda layout: shelf(layout, 0.9), lambda layout: cabinet(layout, 0.8, 0.45, 1.1)], 2)
    width = layout.uniform(1.2, 1.6)
    aisle = layout.uniform(1.1, 1.6)
    back_to_back = layout.chance(0.6)
    x = room.x_min + layout.uniform(1.0, 1.8)
    placed = 0
    while x < room.x_max - 1.2:
        y = room.y_min + layout.uniform(0.7, 1.4)
        while y + width < room.y_max - 0.5:
            if placed < 8 and layout.chance(0.8):
                placed += _workplaces(layout, Pose2D(x, y + width / 2), width, back_to_back)
            y += width + (0.05 if layout.chance(0.5) else aisle)
        x += (2.9 if back_to_back else 1.7) + layout.uniform(0.5, 0.9)
    scatter(layout, room.shrunk(0.5), [waste_bin, person, clutter], 4)
    dress_walls(layout, room, 4)
    return layout


def _workplaces(layout: Layout, at: Pose2D, width: float, back_to_back: bool) -> int:
    workplace = desk(layout, width)
    count = 0
    for turn in (0.0, math.pi) if back_to_back else (0.0,):
        facing = at.moved(0.0, 0.0, turn)
        if not layout.put(workplace, facing.moved(-workplace.length / 2 - 0.03, 0.0)):
            continue
        count += 1
        pull = layout.uniform(0.0, 0.35)
        seat = facing.moved(-workplace.length - 0.3 - pull, layout.uniform(-0.2, 0.2), layout.uniform(-0.8, 0.8))
        layout.put(office_chair(layout), seat)
    return count


def meeting_room(rng: np.random.Generator, style: Style) -> Layout:
    """One long table with chairs around it, a sideboard and a whiteboard on a stand."""
    layout, room = _room(rng, style, (5.0, 7.5), (4.5, 6.5), 1)
    length, width = layout.uniform(1.0, 1.4), layout.uniform(1.8, 3.0)
    turn = 0.0 if room.length < room.width else math.pi / 2
    at = room.centre.moved(layout.uniform(-0.4, 0.4), layout.uniform(-0.3, 0.3), turn + layout.uniform(-0.08, 0.08))
    layout.put(table(layout, length, width), at)
    maker = chair if layout.chance(0.5) else office_chair
    seat_around(layout, at, length, width, maker, ends=True, share=0.85)
    line_walls(layout, room, [lambda layout: cabinet(layout, 1.4, 0.42, 0.8), lambda layout: shelf(layout, 0.8)], 2)
    line_walls(layout, room, [chair, waste_bin, clutter], 3)
    scatter(layout, room.shrunk(0.4), [person, waste_bin], 1)
    dress_walls(layout, room, 5)
    return layout


def living_room(rng: np.random.Generator, style: Style) -> Layout:
    """Sofa, armchairs and a coffee table, a dining corner, shelves and plants."""
    layout, room = _room(rng, style, (5.0, 8.0), (4.5, 6.5), 2)
    at = Pose2D(
        room.x_min + layout.uniform(0.35, 0.6) * room.length,
        room.y_min + layout.uniform(0.35, 0.65) * room.width,
        float(rng.integers(4)) * math.pi / 2 + layout.uniform(-0.15, 0.15),
    )
    low = cabinet(layout, layout.uniform(0.8, 1.2), layout.uniform(0.5, 0.65), layout.uniform(0.35, 0.48))
    layout.put(low, at)
    reach = low.length / 2 + layout.uniform(0.35, 0.6)
    layout.put(sofa(layout, layout.uniform(1.6, 2.2)), at.moved(-reach - 0.45, 0.0))
    for left in (-1, 1):
        if layout.chance(0.6):
            beside = at.moved(0.1, left * (low.width / 2 + layout.uniform(0.85, 1.1)), -left * math.pi / 2)
            layout.put(sofa(layout, layout.uniform(0.8, 0.95)), beside)
    line_walls(
        layout,
        room,
        [
            lambda layout: shelf(layout, 1.0),
            lambda layout: cabinet(layout, 1.6, 0.42, 0.5),
            lambda layout: cabinet(layout, 1.0, 0.5, 1.9),
        ],
        4,
    )
    dining = table(layout, 0.85, layout.uniform(0.9, 1.4))
    corner = Pose2D(room.x_max - layout.uniform(1.3, 1.6), room.y_min + layout.uniform(1.3, 1.6))
    if layout.put(dining, corner, 0.3):
        seat_around(layout, corner, dining.length, dining.width, chair, ends=False)
    scatter(layout, room.shrunk(0.3), [waste_bin, clutter, chair], 4)
    dress_walls(layout, room, 4)
    return layout


def kitchen(rng: np.random.Generator, style: Style) -> Layout:
    """Counters along two walls, tall appliances, wall cupboards, an island or a table with chairs."""
    layout, room = _room(rng, style, (4.0, 6.5), (4.0, 5.5), 1)
    for side in ("south", "west"):
        # Counters stand shoulder to shoulder along the wall, with cupboards above all but the tall appliances.
        along = 0.02
        end = layout.uniform(0.55, 1.0) * (room.length if side == "south" else room.width)
        while (width := layout.uniform(0.5, 0.95)) + along < end:
            is_tall = layout.chance(0.2)
            at = pose_at_wall(room, side, along + width / 2, 0.315)
            piece = cabinet(layout, width, 0.6, layout.uniform(1.8, 2.0) if is_tall else 0.9)
            if layout.put(piece, at) and not is_tall and layout.chance(0.7):
                layout.box(at.moved(-0.13, 0.0), 0.34, width, 1.4, 2.05)
            along += width + 0.005
    at = room.centre.moved(layout.uniform(0.2, 0.6), layout.uniform(0.2, 0.6))
    if layout.chance(0.45):
        layout.put(cabinet(layout, layout.uniform(1.2, 1.8), layout.uniform(0.6, 0.9), 0.92), at, 0.3)
        scatter(layout, room.shrunk(0.5), [waste_bin], 3, gap=0.05)
    else:
        dining = table(layout, layout.uniform(0.7, 0.9), layout.uniform(0.9, 1.5))
        if layout.put(dining, at, 0.3):
            seat_around(layout, at, dining.length, dining.width, chair, ends=True, share=0.8)
    scatter(layout, room.shrunk(0.3), [waste_bin, clutter, person], 2)
    dress_walls(layout, room, 3)
    return layout


def warehouse(rng: np.random.Generator, style: Style) -> Layout:
    """Racks in parallel aisles, with pallets and cartons left in the way."""
    layout, room = _room(rng, style, (8.0, 12.0), (7.0, 10.0), 2)
    depth, length = layout.uniform(0.7, 1.0), layout.uniform(1.8, 2.6)
    aisle = layout.uniform(1.2, 2.0)
    y = room.y_min + layout.uniform(0.5, 1.3)
    while y + depth < room.y_max - 0.3:
        x = room.x_min + layout.uniform(1.0, 1.8)
        while x + length < room.x_max - 0.9:
            if layout.chance(0.85) and len(layout.boxes) < 84:
                layout.put(rack(layout, length, depth), Pose2D(x + length / 2, y + depth / 2, math.pi / 2))
            x += length + (0.05 if layout.chance(0.7) else layout.uniform(0.9, 1.4))
        y += depth + aisle
    scatter(layout, room.shrunk(0.5), [clutter, clutter, barrel, person], 7, gap=0.3)
    dress_walls(layout, room, 3)
    return layout


def factory_hall(rng: np.random.Generator, style: Style) -> Layout:
    """Pillars on a grid, machines, groups of drums and crates."""
    layout, room = _room(rng, style, (9.0, 12.0), (8.0, 11.0), 2)
    column = pillar(layout)
    spacing = layout.uniform(3.0, 4.2)
    for x in np.arange(room.x_min + spacing / 2, room.x_max - 0.8, spacing):
        for y in np.arange(room.y_min + spacing / 2, room.y_max - 0.8, spacing):
            layout.put(column, Pose2D(float(x), float(y)))
    machines = [
        lambda layout: cabinet(layout, layout.uniform(0.8, 2.0), layout.uniform(0.6, 1.2), layout.uniform(0.9, 1.9)),
        lambda layout: table(layout, 0.8, layout.uniform(1.2, 1.8)),
    ]
    scatter(layout, room.shrunk(1.0), machines, 6, gap=0.5, squared=True)
    for _ in range(int(rng.integers(2, 5))):
        heap = Pose2D(layout.uniform(1.2, room.x_max - 1.2), layout.uniform(1.2, room.y_max - 1.2))
        area = Rectangle(heap.x - 0.9, heap.y - 0.9, heap.x + 0.9, heap.y + 0.9)
        scatter(layout, area, [barrel], int(rng.integers(2, 6)), gap=0.01)
    scatter(layout, room.shrunk(0.4), [clutter, person, barrel], 7)
    line_walls(layout, room, [lambda layout: shelf(layout, 1.2), lambda layout: cabinet(layout, 0.9, 0.5, 1.8)], 3)
    return layout


def storage(rng: np.random.Generator, style: Style) -> Layout:
    """A lumber room: shelves on the walls and cartons, drums and chairs all over the floor."""
    layout, room = _room(rng, style, (4.5, 7.5), (4.0, 6.5), 1)
    line_walls(layout, room, [lambda layout: shelf(layout, layout.uniform(0.8, 1.3))], 4)
    makers = [clutter, clutter, clutter, barrel, waste_bin, chair]
    scatter(layout, room.shrunk(0.4), makers, int(rng.integers(10, 18)), gap=0.24)
    dress_walls(layout, room, 2)
    return layout


def lobby(rng: np.random.Generator, style: Style) -> Layout:
    """A large hall with pillars, a reception desk, benches, planters and people standing about."""
    layout, room = _room(rng, style, (8.0, 12.0), (7.0, 11.0), 3)
    reception = cabinet(layout, layout.uniform(1.8, 3.0), layout.uniform(0.5, 0.8), 1.05)
    side = str(rng.choice(["south", "north"]))
    start = room.side(side)[0]
    inward = 1.0 if side == "south" else -1.0
    layout.put(reception, Pose2D(room.centre.x, start[1] + inward * 1.6, inward * math.pi / 2), 0.2)
    column = pillar(layout)
    for x_fraction in (0.28, 0.72):
        for y_fraction in (0.3, 0.7):
            layout.put(column, Pose2D(x_fraction * room.length, y_fraction * room.width), 0.3)
    bench = [lambda layout: sofa(layout, layout.uniform(1.2, 2.0)), lambda layout: cabinet(layout, 1.4, 0.45, 0.44)]
    scatter(layout, room.shrunk(1.0), bench, 4, gap=0.4, squared=True)
    scatter(layout, room.shrunk(0.5), [person], int(rng.integers(3, 9)), gap=0.35)
    scatter(layout, room.shrunk(0.4), [waste_bin, clutter], 4)
    dress_walls(layout, room, 5)
    return layout

"""Furniture of the scenes, each drawn with its own sizes [m] from a layout's random source and style."""

import math

from iwalker_jax.scenes.built.layout import Furniture, Layout, Pose2D

_SHEET = 0.025
"""[m] thickness of table tops, boards and panels."""


def table(layout: Layout, length: float, width: float) -> Furniture:
    """A table `length` deep (local x) and `width` wide on four round legs."""
    height = layout.draw("table_height")
    leg = layout.uniform(0.02, 0.035)

    def build(out: Layout, at: Pose2D) -> None:
        out.box(at, length, width, height - _SHEET, height)
        for sx in (-1, 1):
            for sy in (-1, 1):
                corner = at.moved(sx * (length / 2 - 0.06), sy * (width / 2 - 0.06))
                out.cylinder(corner, leg, 0.0, height - _SHEET)

    return Furniture(length, width, build)


def desk(layout: Layout, width: float) -> Furniture:
    """A desk on side panels, often with a screen and a drawer unit; one sits at its local -x side."""
    height = layout.draw("table_height")
    depth = layout.uniform(0.65, 0.85)
    has_screen = layout.chance(0.75)
    has_drawers = layout.chance(0.5)

    def build(out: Layout, at: Pose2D) -> None:
        out.box(at, depth, width, height - _SHEET, height)
        for side in (-1, 1):
            out.box(at.moved(0.0, side * (width / 2 - 0.03)), depth - 0.05, 0.04, 0.0, height - _SHEET)
        if has_screen:
            out.box(at.moved(depth / 2 - 0.2, 0.05), 0.04, 0.55, height + 0.1, height + 0.45)
        if has_drawers:
            out.box(at.moved(0.0, width / 2 - 0.3), depth - 0.15, 0.4, 0.03, height - 0.12)

    return Furniture(depth, width, build)


def chair(layout: Layout) -> Furniture:
    """A chair with seat, back rest (at its local -x side) and four legs."""
    seat = layout.draw("seat_height")
    side = layout.uniform(0.38, 0.46)
    back = layout.uniform(0.8, 0.95)
    leg = layout.uniform(0.03, 0.045)

    def build(out: Layout, at: Pose2D) -> None:
        out.box(at, side, side, seat - 0.04, seat)
        out.box(at.moved(-side / 2 + 0.02, 0.0), 0.035, side, seat + 0.1, back)
        for sx in (-1, 1):
            for sy in (-1, 1):
                corner = at.moved(sx * (side - leg) / 2, sy * (side - leg) / 2)
                out.box(corner, leg, leg, 0.0, seat + 0.1 if sx < 0 else seat - 0.04)

    return Furniture(side, side, build)


def office_chair(layout: Layout) -> Furniture:
    """A swivel chair: crossed foot, gas spring, seat and back rest (at its local -x side)."""
    seat = layout.draw("seat_height") + 0.05
    side = layout.uniform(0.44, 0.52)
    foot_turn = layout.uniform(0.0, math.pi / 2)

    def build(out: Layout, at: Pose2D) -> None:
        for turn in (foot_turn, foot_turn + math.pi / 2):
            out.box(at.moved(0.0, 0.0, turn), 0.58, 0.05, 0.03, 0.1)
        out.cylinder(at, 0.03, 0.05, seat - 0.08)
        out.box(at, side, side, seat - 0.08, seat)
        out.box(at.moved(-side / 2 + 0.03, 0.0), 0.06, side - 0.06, seat + 0.12, seat + 0.55)

    return Furniture(0.6, 0.6, build)


def shelf(layout: Layout, width: float, depth: float | None = None) -> Furniture:
    """Shelves with uprights, boards, a back panel (local -x side) and goods on some boards."""
    height = layout.draw("shelf_height")
    deep = layout.uniform(0.28, 0.45) if depth is None else depth
    boards = max(2, round(height / layout.uniform(0.38, 0.5)))
    pitch = (height - 0.06) / boards
    goods = [
        (layout.uniform(-0.3, 0.3) * width, layout.uniform(0.15, 0.35) * width, layout.uniform(0.3, 0.8) * pitch)
        for _ in range(boards)
    ]
    filled = [layout.chance(0.6) for _ in range(boards)]

    def build(out: Layout, at: Pose2D) -> None:
        for side in (-1, 1):
            out.box(at.moved(0.0, side * (width - 0.03) / 2), deep, 0.03, 0.0, height)
        out.box(at.moved(-deep / 2 + 0.01, 0.0), 0.02, width - 0.06, 0.06, height)
        for i in range(boards):
            level = 0.06 + i * pitch
            out.box(at, deep, width - 0.06, level, level + _SHEET)
            offset, span, tall = goods[i]
            if filled[i]:
                out.box(at.moved(0.0, offset), 0.7 * deep, span, level + _SHEET, level + _SHEET + tall)

    return Furniture(deep, width, build)


def rack(layout: Layout, length: float, depth: float) -> Furniture:
    """A warehouse rack along its local y: corner posts, two or three decks and pallets of goods."""
    height = layout.uniform(1.9, 2.3)
    decks = int(layout.rng.integers(2, 4))
    loads = [[layout.uniform(0.25, 0.95) for _ in range(2)] for _ in range(decks)]

    def build(out: Layout, at: Pose2D) -> None:
        for sx in (-1, 1):
            for sy in (-1, 1):
                out.box(at.moved(sx * (depth / 2 - 0.04), sy * (length / 2 - 0.04)), 0.08, 0.08, 0.0, height)
        pitch = (height - 0.1) / decks
        for i in range(decks):
            level = 0.1 + i * pitch
            out.box(at, depth, length, level - 0.06, level)
            for sy, load in zip((-1, 1), loads[i], strict=True):
                if load > 0.4:
                    spot = at.moved(0.0, sy * length / 4)
                    out.box(spot, 0.85 * depth, 0.42 * length, level, level + 0.85 * load * (pitch - 0.06))

    return Furniture(depth, length, build)


def cabinet(layout: Layout, width: float, depth: float, height: float) -> Furniture:
    """A closed box on the floor: cupboard, counter, machine or appliance."""

    def build(out: Layout, at: Pose2D) -> None:
        out.box(at, depth, width, 0.0, height)

    return Furniture(depth, width, build)


def sofa(layout: Layout, width: float) -> Furniture:
    """A sofa (or armchair) with seat, back rest at its local -x side and two arms."""
    depth = layout.uniform(0.8, 0.95)
    seat = layout.draw("seat_height")
    back = layout.uniform(0.32, 0.45)

    def build(out: Layout, at: Pose2D) -> None:
        out.box(at, depth, width, 0.04, seat)
        out.box(at.moved(-depth / 2 + 0.1, 0.0), 0.2, width, seat, seat + back)
        for side in (-1, 1):
            out.box(at.moved(0.1, side * (width / 2 - 0.08)), depth - 0.2, 0.16, seat, seat + 0.18)

    return Furniture(depth, width, build)


def barrel(layout: Layout) -> Furniture:
    """A drum 0.6-0.95 m tall."""
    radius = layout.draw("barrel_radius")
    height = layout.uniform(0.6, 0.95)

    def build(out: Layout, at: Pose2D) -> None:
        out.cylinder(at, radius, 0.0, height)

    return Furniture(2 * radius, 2 * radius, build)


def pillar(layout: Layout) -> Furniture:
    """A round or square pillar to the ceiling."""
    radius = layout.draw("pillar_radius")
    is_round = layout.chance(0.6)

    def build(out: Layout, at: Pose2D) -> None:
        if is_round:
            out.cylinder(at, radius, 0.0, out.ceiling)
        else:
            out.box(at, 2 * radius, 2 * radius, 0.0, out.ceiling)

    return Furniture(2 * radius, 2 * radius, build)


def person(layout: Layout) -> Furniture:
    """A person-sized post: legs, trunk and head as stacked cylinders."""
    radius = layout.draw("post_radius")
    height = layout.uniform(1.55, 1.9)

    def build(out: Layout, at: Pose2D) -> None:
        for side in (-1, 1):
            out.cylinder(at.moved(0.0, side * 0.55 * radius), 0.45 * radius, 0.0, 0.48 * height)
        out.cylinder(at, radius, 0.48 * height, 0.84 * height)
        out.cylinder(at, 0.09, 0.84 * height, height)

    return Furniture(2 * radius, 2 * radius, build)


def waste_bin(layout: Layout) -> Furniture:
    """A waste bin, plant pot or stool: a low cylinder, sometimes with a plant's crown above."""
    radius = layout.uniform(0.13, 0.2)
    height = layout.uniform(0.3, 0.6)
    has_plant = layout.chance(0.4)
    crown = layout.uniform(0.18, 0.3)

    def build(out: Layout, at: Pose2D) -> None:
        out.cylinder(at, radius, 0.0, height)
        if has_plant:
            out.cylinder(at, crown, height + 0.1, height + 0.7)

    reach = max(radius, crown) if has_plant else radius
    return Furniture(2 * reach, 2 * reach, build)


def clutter(layout: Layout) -> Furniture:
    """A carton, or two stacked askew."""
    length, width = layout.draw("clutter_size"), layout.draw("clutter_size")
    height = layout.uniform(0.15, 0.6)
    upper = layout.uniform(0.15, 0.4) if layout.chance(0.35) else 0.0
    turn = layout.uniform(-0.5, 0.5)

    def build(out: Layout, at: Pose2D) -> None:
        out.box(at, length, width, 0.0, height)
        if upper:
            side = 0.7 * min(length, width)
            out.box(at.moved(0.0, 0.0, turn), side, side, height, height + upper)

    return Furniture(length, width, build)


def staircase(layout: Layout, width: float, steps: int) -> Furniture:
    """A flight of solid steps that climbs along its local +x, with a handrail on one side."""
    rise, tread = layout.uniform(0.15, 0.19), layout.uniform(0.24, 0.31)
    length = steps * tread
    rail_side = 1 if layout.chance(0.5) else -1
    has_rail = layout.chance(0.7)

    def build(out: Layout, at: Pose2D) -> None:
        for i in range(steps):
            step = at.moved(-length / 2 + (i + 0.5) * tread, 0.0)
            out.box(step, tread, width, 0.0, (i + 1) * rise)
        if has_rail:
            for i in (0, steps - 1):
                post = at.moved(-length / 2 + (i + 0.5) * tread, rail_side * (width / 2 - 0.04))
                out.cylinder(post, 0.025, (i + 1) * rise, (i + 1) * rise + 0.9)

    return Furniture(length, width, build)

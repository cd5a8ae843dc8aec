"""Unlimited held-out scenes for evaluation: oblique rooms and mixtures of furniture that training never shows."""

import math

import numpy as np

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.built.free_space import draw_connected
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
    sofa,
    staircase,
    table,
    waste_bin,
)
from iwalker_jax.scenes.built.layout import HELD_OUT_STYLE, Layout, Pose2D, Style
from iwalker_jax.scenes.built.oblique_walls import enclose_polygon
from iwalker_jax.scenes.built.rooms import Maker, Rectangle, scatter
from iwalker_jax.scenes.scene import Scene
from iwalker_jax.streams import HELD_OUT_SCENES

_FAMILY = "held_out"

_MAKERS: tuple[Maker, ...] = (
    chair,
    office_chair,
    barrel,
    pillar,
    person,
    waste_bin,
    clutter,
    lambda layout: table(layout, layout.uniform(0.75, 1.1), layout.uniform(1.0, 2.2)),
    lambda layout: desk(layout, layout.uniform(1.3, 1.8)),
    lambda layout: shelf(layout, layout.uniform(0.7, 1.5)),
    lambda layout: cabinet(layout, layout.uniform(0.4, 1.6), layout.uniform(0.35, 0.8), layout.uniform(0.5, 1.7)),
    lambda layout: sofa(layout, layout.uniform(0.9, 2.1)),
    lambda layout: staircase(layout, layout.uniform(0.8, 1.2), 3),
)


def held_out_scene(seed: int) -> Scene:
    """The held-out scene of a seed: a four- or five-cornered hall cut by a slanted wall, each part with its own mix.

    No training seed can produce it: ceiling and walls are higher and thicker than any in training, and its walls
    stand at oblique angles.

    Args:
        seed: a whole number from 0 to 2^32 - 1.

    Raises:
        InputError: for a seed out of its range.
    """
    if seed < 0:
        raise InputError(f"A scene's seed must not be negative, got {seed}.")
    return draw_connected(f"{_FAMILY}-{seed}", _FAMILY, _oblique_hall, HELD_OUT_STYLE, HELD_OUT_SCENES, seed)


def _oblique_hall(rng: np.random.Generator, style: Style) -> Layout:
    length, width = float(rng.uniform(7.0, 11.5)), float(rng.uniform(5.5, 9.0))
    layout = Layout(rng, style, (0.0, 0.0, length, width))
    slant, chamfer = layout.uniform(0.6, 1.6), layout.uniform(0.9, 1.8)
    corners = [(0.0, 0.0), (length - slant, 0.0), (length, width - chamfer), (length - chamfer, width), (0.0, width)]
    enclose_polygon(layout, corners, {4: ((layout.uniform(0.3, 0.7) * width, layout.draw("door_width")),)})
    _cut(layout, length, width)
    middle = length / 2
    for area in (Rectangle(0.2, 0.2, middle, width - 0.2), Rectangle(middle, 0.2, length - slant / 2, width - 0.2)):
        kinds = [_MAKERS[i] for i in rng.choice(len(_MAKERS), size=4, replace=False)]
        scatter(layout, area.shrunk(0.25), kinds, int(rng.integers(6, 12)), gap=0.3)
    return layout


def _cut(layout: Layout, length: float, width: float) -> None:
    """A slanted partition across the hall: to the ceiling with a doorway, or chest-high and open at one end."""
    lean = layout.uniform(0.25, 0.6) * (1 if layout.chance(0.5) else -1)
    foot = layout.uniform(0.4, 0.6) * length - width / 2 * math.tan(lean)
    start = Pose2D(foot, 0.0, math.pi / 2 - lean)
    reach = width / math.cos(lean)
    if layout.chance(0.6):
        door = layout.uniform(0.25, 0.75) * reach
        layout.wall(start.point(0.0, 0.0), start.point(reach, 0.0), ((door, layout.draw("door_width")),))
    else:
        open_end = layout.uniform(1.0, 2.0)
        height = layout.uniform(0.9, 1.4)
        layout.wall(start.point(open_end, 0.0), start.point(reach, 0.0), height=height)

"""Which drawn layouts are worth keeping: their free floor is large, hangs together and lets the robot through."""

from collections.abc import Callable

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from iwalker_jax.geometry import BODY
from iwalker_jax.scenes.built.layout import Layout, Style
from iwalker_jax.scenes.grid_distance import occupancy
from iwalker_jax.scenes.scene import SMALL, Scene, SceneArrays
from iwalker_jax.streams import Stream

Family = Callable[[np.random.Generator, Style], Layout]
"""Draws a layout of one kind."""

# [m^2] of connected floor, and its share of all free floor, below which a layout is drawn again.
_MIN_AREA, _MIN_SHARE = 5.0, 0.85
_ATTEMPTS = 60
_MAP_RESOLUTION = 0.1


def draw_connected(name: str, family: str, draw_layout: Family, style: Style, stream: Stream, seed: int) -> Scene:
    """Draw layouts from a stream, one attempt after the other, until one fits the arrays and its floor is connected.

    Args:
        name, family: of the scene.
        draw_layout: of the family.
        style: of the building.
        stream: of the family; seed: of the scene.

    Raises:
        RuntimeError: if no layout of this seed is usable, which means the generator itself is faulty.
    """
    for attempt in range(_ATTEMPTS):
        scene = draw_layout(stream.generator(seed, attempt), style).scene(name, family)
        if len(scene.boxes) > SMALL.boxes or len(scene.cylinders) > SMALL.cylinders:
            continue
        area, share = connected_free_space(scene)
        if area >= _MIN_AREA and share >= _MIN_SHARE:
            return scene
    raise RuntimeError(f"Scene {name}: none of {_ATTEMPTS} layouts had connected free space; use another seed.")


def connected_free_space(scene: Scene) -> tuple[float, float]:
    """Area [m^2] of the largest region the robot's centre can roam, and its share of all free cells."""
    # Single precision whatever JAX's mode, so that a seed gives the same scene in every process.
    arrays = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), scene.arrays())
    free = ~np.asarray(_inflated_map(arrays))
    labels, regions = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    if labels < 2:
        return 0.0, 0.0
    largest = np.bincount(regions[free]).max()
    return float(largest) * _MAP_RESOLUTION**2, float(largest / free.sum())


@jax.jit
def _inflated_map(scene: SceneArrays) -> Bool[Array, "rows columns"]:
    cells = round(SMALL.extent / _MAP_RESOLUTION)
    return occupancy(scene, scene.bounds[:2], _MAP_RESOLUTION, (cells, cells), BODY.layout_radius)

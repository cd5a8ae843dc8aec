"""Seeded generator of training scenes: fifteen families with unlimited layouts each."""

from collections.abc import Callable

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.built import families_passages as passages
from iwalker_jax.scenes.built import families_rooms as rooms
from iwalker_jax.scenes.built.layout import TRAINING_STYLE, Layout, Style
from iwalker_jax.scenes.scene import (
    BOX_CAPACITY,
    CYLINDER_CAPACITY,
    MAX_EXTENT,
    Scene,
    SceneArrays,
    occupancy,
)

Family = Callable[[np.random.Generator, Style], Layout]

_GENERATORS: dict[str, Family] = {
    "corridor_doors": passages.corridor,
    "l_corridor": passages.l_corridor,
    "t_corridor": passages.t_corridor,
    "joined_rooms": passages.joined_rooms,
    "landing": passages.landing,
    "slalom": passages.slalom,
    "narrow_gap": passages.narrow_gap,
    "open_office": rooms.open_office,
    "meeting_room": rooms.meeting_room,
    "living_room": rooms.living_room,
    "kitchen": rooms.kitchen,
    "warehouse": rooms.warehouse,
    "factory_hall": rooms.factory_hall,
    "storage": rooms.storage,
    "lobby": rooms.lobby,
}

FAMILIES: tuple[str, ...] = tuple(_GENERATORS)

ROBOT_RADIUS = 0.15
"""[m] of the robot's inflated footprint, for which scenes must offer connected free space."""

# [m^2] of connected floor, and its share of all free floor, below which a layout is drawn again.
_MIN_AREA, _MIN_SHARE = 5.0, 0.85
_ATTEMPTS = 60
_MAP_RESOLUTION = 0.1


def generate_scene(family: str, seed: int) -> Scene:
    """The training scene of a family and a seed; the same arguments give the same scene.

    Layouts whose free space is small or falls apart are drawn again (from a sub-seed, so the result stays a function
    of the seed).

    Args:
        family: one of `FAMILIES`.
        seed: any non-negative integer.

    Raises:
        InputError: for an unknown family or a negative seed.
    """
    if family not in _GENERATORS:
        raise InputError(f"Unknown scene family {family!r}; choose one of {', '.join(FAMILIES)}.")
    if seed < 0:
        raise InputError(f"A scene's seed must not be negative, got {seed}.")
    key = (FAMILIES.index(family), seed)
    return draw_connected(f"{family}-{seed}", family, _GENERATORS[family], TRAINING_STYLE, key)


def draw_connected(name: str, family: str, generator: Family, style: Style, key: tuple[int, ...]) -> Scene:
    """Draw layouts from successive sub-seeds of a key until one fits the arrays and its free space is connected.

    Raises:
        RuntimeError: if no layout of this key is usable, which means the generator itself is faulty.
    """
    for attempt in range(_ATTEMPTS):
        scene = generator(np.random.default_rng([*key, attempt]), style).scene(name, family)
        if len(scene.boxes) > BOX_CAPACITY or len(scene.cylinders) > CYLINDER_CAPACITY:
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
    cells = round(MAX_EXTENT / _MAP_RESOLUTION)
    return occupancy(scene, scene.bounds[:2], _MAP_RESOLUTION, (cells, cells), ROBOT_RADIUS)

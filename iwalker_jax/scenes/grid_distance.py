"""Ground-truth maps of a scene: distances and occupancy at the cells of a grid, whatever the number of obstacles."""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.perception import DEFAULT_OBSTACLES, GridSpec
from iwalker_jax.scenes.scene import (
    LARGEST,
    SMALL,
    SceneArrays,
    obstacle_distance,
    plan_distance_to_boxes,
    plan_distance_to_cylinders,
)

SCENE_RESOLUTION = 0.1
"""[m] side of the cells of ground-truth maps."""

_TILE = 16
"""Cells of a side of a tile, which looks at its own obstacles only."""

_BAND = (DEFAULT_OBSTACLES.min_height, DEFAULT_OBSTACLES.max_height)


def scene_grid(scene: SceneArrays) -> GridSpec:
    """Grid that covers any scene of these arrays' shape; its origin is the lower corner of the scene's bounds."""
    extent = SMALL.extent if scene.boxes.shape[-2] <= SMALL.boxes else LARGEST.extent
    return scene_grid_of(round(extent / SCENE_RESOLUTION))


def scene_grid_of(cells: int) -> GridSpec:
    """The ground-truth grid with this number of cells a side."""
    return GridSpec(x_min=0.0, y_min=0.0, resolution=SCENE_RESOLUTION, rows=cells, columns=cells)


def distance_up_to(
    scene: SceneArrays, points_xy: Float[Array, "rows columns 2"], most: float
) -> Float[Array, "rows columns"]:
    """`obstacle_distance` [m] at the points of a grid, exact where it is at most `most`, else some larger number.

    A scene of many obstacles is looked at tile by tile, each with the obstacles near it.
    """
    if scene.boxes.shape[-2] <= SMALL.boxes:
        return obstacle_distance(scene, points_xy)
    dtype = points_xy.dtype
    boxes, cylinders = scene.boxes.astype(dtype), scene.cylinders.astype(dtype)
    cos, sin = jnp.abs(jnp.cos(boxes[:, 6])), jnp.abs(jnp.sin(boxes[:, 6]))
    box_reach = jnp.stack([cos * boxes[:, 3] + sin * boxes[:, 4], sin * boxes[:, 3] + cos * boxes[:, 4]], axis=1)
    cylinder_reach = jnp.broadcast_to(cylinders[:, 3:4], (len(cylinders), 2))

    def tile_distance(points: Float[Array, "a b 2"]) -> Float[Array, "a b"]:
        corners = points.reshape(-1, 2)
        low, high = corners.min(axis=0) - most, corners.max(axis=0) + most
        box_rows, box_count = _near(boxes, box_reach, low, high)
        cylinder_rows, cylinder_count = _near(cylinders, cylinder_reach, low, high)
        x, y = points[..., :1], points[..., 1:]

        def add_box(i: Int[Array, ""], nearest: Float[Array, "a b"]) -> Float[Array, "a b"]:
            return jnp.minimum(nearest, plan_distance_to_boxes(boxes[box_rows[i]][None], x, y, *_BAND)[..., 0])

        def add_cylinder(i: Int[Array, ""], nearest: Float[Array, "a b"]) -> Float[Array, "a b"]:
            row = cylinders[cylinder_rows[i]][None]
            return jnp.minimum(nearest, plan_distance_to_cylinders(row, x, y, *_BAND)[..., 0])

        nearest = jnp.full(points.shape[:2], jnp.inf, dtype)
        nearest = lax.fori_loop(0, box_count, add_box, nearest)
        return lax.fori_loop(0, cylinder_count, add_cylinder, nearest)

    rows, columns = points_xy.shape[:2]
    padded = jnp.pad(points_xy, ((0, -rows % _TILE), (0, -columns % _TILE), (0, 0)), mode="edge")
    down, across = padded.shape[0] // _TILE, padded.shape[1] // _TILE
    tiles = padded.reshape(down, _TILE, across, _TILE, 2).swapaxes(1, 2).reshape(-1, _TILE, _TILE, 2)
    distances = lax.map(tile_distance, tiles)
    whole = distances.reshape(down, across, _TILE, _TILE).swapaxes(1, 2).reshape(down * _TILE, across * _TILE)
    return whole[:rows, :columns]


def _near(
    geoms: Float[Array, "n k"], reach: Float[Array, "n 2"], low: Float[Array, "2"], high: Float[Array, "2"]
) -> tuple[Int[Array, " n"], Int[Array, ""]]:
    """Rows of the geoms whose bounding rectangle meets another one, first, and how many they are."""
    meets = ((geoms[:, :2] + reach >= low) & (geoms[:, :2] - reach <= high)).all(axis=1)
    meets &= geoms[:, 2] > 0  # rows that are not used lie far below the floor
    return jnp.nonzero(meets, size=len(geoms), fill_value=0)[0], meets.sum()


def occupancy(
    scene: SceneArrays,
    origin: Float[Array, " 2"],
    resolution: float,
    shape: tuple[int, int],
    inflation: float = 0.0,
) -> Bool[Array, "rows columns"]:
    """Ground-truth map: True where a cell's centre is nearer than `inflation` to an obstacle or outside the bounds.

    Args:
        scene: one scene.
        origin: (x, y) [m] of the map's lowest corner in the world frame; rows run along x, columns along y.
        resolution: [m] side of a cell.
        shape: (rows, columns), fixed under jit; of `scene_grid` covers any scene from its lowest corner.
        inflation: [m] radius of the robot's footprint.
    """
    x = origin[0] + (jnp.arange(shape[0], dtype=origin.dtype) + 0.5) * resolution
    y = origin[1] + (jnp.arange(shape[1], dtype=origin.dtype) + 0.5) * resolution
    points = jnp.stack(jnp.meshgrid(x, y, indexing="ij"), axis=-1)
    return ~inside_bounds(scene, points) | (distance_up_to(scene, points, inflation) <= inflation)


def inside_bounds(scene: SceneArrays, points_xy: Float[Array, "*batch 2"]) -> Bool[Array, "*batch"]:
    """Whether points [m, world] are within a scene's bounds."""
    return ((points_xy >= scene.bounds[:2]) & (points_xy <= scene.bounds[2:])).all(axis=-1)

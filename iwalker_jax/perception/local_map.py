"""One depth image turned into the maps a planner needs: occupied, free, unknown, distance field, published map."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.arrays import as_floats, as_numbers, is_known
from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.perception.collision_map import (
    DEFAULT_OBSTACLES,
    ObstacleParameters,
    PointPlanes,
    cell_offsets,
    classify_points,
    flat_cell_index,
    occupied_cells,
    point_planes,
    published_collision_map,
)
from iwalker_jax.perception.depth_cleanup import check_depth_image, check_image_size, clean_depth
from iwalker_jax.perception.distance_field import signed_distance_field
from iwalker_jax.perception.grid import DEFAULT_GRID, GridSpec
from iwalker_jax.perception.soft_map import SoftOccupancy, soft_map

BLIND_DISC_RADIUS = 0.4
"""[m] around the base origin: the robot stands there, so the floor under and beside it counts as free."""


class LocalMap(NamedTuple):
    """Maps around the robot in the base frame; every cell is exactly one of occupied, known free and unknown.

    Attributes:
        occupied: (rows, columns) an obstacle as `ObstacleParameters` say was seen here.
        known_free: (rows, columns) seen to be free, or within `BLIND_DISC_RADIUS` of the base origin.
        unknown: (rows, columns) hidden behind an obstacle, past the brink of a drop, out of view or never
            measured.
        esdf: (rows, columns) [m] signed distance to the occupied cells; unknown space does not repel. If asked for,
            that of `soft_map`, which is differentiable in depth and mount; nothing else here is.
        published: (100, 100) the paper's blurred collision map on `PUBLISHED_GRID`.
    """

    occupied: Bool[Array, "rows columns"]
    known_free: Bool[Array, "rows columns"]
    unknown: Bool[Array, "rows columns"]
    esdf: Float[Array, "rows columns"]
    published: Float[Array, "map_rows map_columns"]


def build_local_map(
    depth: Float[Array | np.ndarray, "height width"],
    mount: Float[Array, " 5"],
    intrinsics: Intrinsics,
    grid: GridSpec = DEFAULT_GRID,
    obstacles: ObstacleParameters = DEFAULT_OBSTACLES,
    soft: SoftOccupancy | None = None,
) -> LocalMap:
    """All maps of one raw depth image; finite and valid for empty, all-zero and all-blocked images too.

    Args:
        depth: z-depth [m]; 0, negative, NaN and inf mean no return. Cleaned here.
        mount: [height, pitch, roll, forward, left] as in `CameraMount`, known or from `fit_floor`.
        intrinsics: of this image size.
        grid: of the occupancy and distance maps, base frame.
        obstacles: obstacle heights and point counts.
        soft: makes `esdf` differentiable (`soft_map`); None gives the exact distance to the occupied cells.

    Raises:
        InputError: if the image has another size than its intrinsics or is not floating-point metres; outside `jit`
            also for millimetres and for a mount that cannot be, such as one in degrees.
    """
    given = depth, mount
    depth, mount = as_numbers(depth, "The depth image"), as_floats(mount, "The mount")
    if not isinstance(intrinsics, Intrinsics) or mount.shape != (5,):
        raise InputError(
            f"build_local_map needs Intrinsics and a mount of shape (5,), got a {type(intrinsics).__name__} and "
            f"{mount.shape}."
        )
    if not isinstance(soft, SoftOccupancy | None):
        raise InputError(f"build_local_map takes soft=SoftOccupancy() or None, got a {type(soft).__name__}.")
    check_image_size(depth.shape, intrinsics)
    if is_known(given):
        check_depth_image(np.asarray(given[0]))
        CameraMount(*np.asarray(given[1]).tolist())
    depth = clean_depth(depth)
    occupied, known_free, _ = frame_cells(depth, mount, intrinsics, grid, obstacles)
    base_x, base_y = cell_offsets(grid, jnp.zeros(2))
    known_free = ~occupied & (known_free | (base_x**2 + base_y**2 <= BLIND_DISC_RADIUS**2))
    if soft is None:
        esdf = signed_distance_field(occupied, grid.resolution)
    else:
        esdf = soft_map(depth, mount, intrinsics, grid, obstacles, soft).esdf
    return LocalMap(
        occupied=occupied,
        known_free=known_free,
        unknown=~occupied & ~known_free,
        esdf=esdf,
        published=published_collision_map(depth, mount, intrinsics),
    )


class FrameCells(NamedTuple):
    """What one depth image shows of the cells of a grid.

    Attributes:
        occupied: an obstacle as `ObstacleParameters` say was seen here.
        known_free: not occupied, and floor was seen in the cell; or it lies nearer to the camera than the first
            obstacle or drop of its bearing and no farther than the farthest floor or obstacle seen along that bearing.
            This includes the wedge below the image's lower edge, between the robot and the first surface seen; where
            nothing was seen along a bearing, the wedge stays unknown.
        seen_free: known free without that wedge, in which a low obstacle may stand unseen.
    """

    occupied: Bool[Array, "rows columns"]
    known_free: Bool[Array, "rows columns"]
    seen_free: Bool[Array, "rows columns"]


def frame_cells(
    depth: Float[Array, "height width"],
    mount: Float[Array, " 5"],
    intrinsics: Intrinsics,
    grid: GridSpec,
    obstacles: ObstacleParameters,
) -> FrameCells:
    """Occupied and free cells of a cleaned depth image, by what it shows alone.

    Args:
        depth: z-depth [m], 0 = no return (`clean_depth`).
        mount, intrinsics, grid, obstacles: as in `build_local_map`.
    """
    points = point_planes(depth, mount, intrinsics)
    floor, obstacle, drop = classify_points(points, obstacles)
    points = _moved_to_brink(points, drop, mount)
    cell = flat_cell_index(points, floor | obstacle | drop, grid)
    cells = grid.rows * grid.columns

    # One scatter counts the points of all three classes; each class has its own layer of cells.
    layer = jnp.where(obstacle, 0, jnp.where(drop, cells, 2 * cells))
    index = jnp.where(cell < cells, layer + cell, 3 * cells)
    counts = jnp.zeros(3 * cells, jnp.int32).at[index.ravel()].add(1, mode="drop").reshape(3, *grid.shape)
    occupied, brink = (occupied_cells(counts[k], mount[3:5], intrinsics, grid, obstacles) for k in (0, 1))
    floor_seen = counts[2] > 0

    # Points that made no cell occupied are noise and hide nothing; obstacles beyond the map still end the view.
    confirmed = jnp.concatenate([occupied.ravel(), brink.ravel(), jnp.zeros(cells + 1, bool)])[index]
    ends = confirmed | (obstacle & (cell == cells))
    bins = bearing_bin_count(intrinsics)
    pixel_bin = bearing_bin(points.x - mount[3], points.y - mount[4], points.ground_range, bins)
    first_end, farthest, nearest = bearing_ranges(points.ground_range, pixel_bin, bins, ends, floor | (ends & obstacle))

    ahead, left = cell_offsets(grid, mount[3:5])
    cell_range = jnp.sqrt(ahead**2 + left**2)
    cell_bin = bearing_bin(ahead, left, cell_range, bins)
    half = 0.5 * grid.resolution
    in_view = (cell_range < first_end.at[cell_bin].get(mode="fill", fill_value=0.0) - half) & (
        cell_range <= farthest.at[cell_bin].get(mode="fill", fill_value=0.0)
    )
    below_view = cell_range < nearest.at[cell_bin].get(mode="fill", fill_value=jnp.inf) - half
    return FrameCells(
        occupied=occupied,
        known_free=~occupied & (in_view | floor_seen),
        seen_free=~occupied & ((in_view & ~below_view) | floor_seen),
    )


def _moved_to_brink(points: PointPlanes, drop: Bool[Array, "height width"], mount: Float[Array, " 5"]) -> PointPlanes:
    """Points with those below the floor moved up their rays to the floor plane, where floor is known to be missing."""
    share = jnp.where(drop, mount[0] / jnp.maximum(mount[0] - points.z, 1e-3), 1.0)
    return points._replace(
        x=mount[3] + share * (points.x - mount[3]),
        y=mount[4] + share * (points.y - mount[4]),
        ground_range=share * points.ground_range,
    )


def bearing_ranges(
    ranges: Float[Array, "height width"],
    pixel_bin: Int[Array, "height width"],
    bins: int,
    ends: Bool[Array, "height width"],
    surfaces: Bool[Array, "height width"],
) -> tuple[Float[Array, " bins"], Float[Array, " bins"], Float[Array, " bins"]]:
    """Ranges [m] of each bearing: to the first point that ends the view, to the farthest and to the nearest surface.

    Where a bearing has none, the first and the nearest are infinite and the farthest is zero.
    """
    flat = ranges.ravel()
    end_bin = jnp.where(ends, pixel_bin, bins).ravel()
    first_end = jnp.full(bins, jnp.inf, flat.dtype).at[end_bin].min(flat, mode="drop")
    surface_bin = jnp.where(surfaces, pixel_bin, bins).ravel()
    farthest = jnp.zeros(bins, flat.dtype).at[surface_bin].max(flat, mode="drop")
    nearest = jnp.full(bins, jnp.inf, flat.dtype).at[surface_bin].min(flat, mode="drop")
    return first_end, farthest, nearest


def bearing_bin_count(intrinsics: Intrinsics) -> int:
    """Bins a quarter wider than a pixel column at the image's centre, so that every bin in view holds pixels."""
    return max(8, int(3.2 * intrinsics.fx))


def bearing_bin(
    ahead: Float[Array, "*#n"], left: Float[Array, "*#n"], distance: Float[Array, "*n"], bins: int
) -> Int[Array, "*n"]:
    """Bin of a horizontal direction seen from the camera; `bins` (one past the last) for directions behind it.

    tan(bearing / 2) = left / (ahead + distance) is nearly uniform in the bearing and far cheaper than arctan2.
    """
    half_tangent = left / jnp.maximum(ahead + distance, 1e-6)
    index = jnp.floor((half_tangent + 1.0) * (0.5 * bins))
    in_front = (ahead > 0.0) & (index >= 0) & (index < bins)
    return jnp.where(in_front, index, bins).astype(jnp.int32)

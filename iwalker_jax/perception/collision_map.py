"""What stands in the way: floor and obstacle points, the occupancy grid, and the paper's blurred collision map."""

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Num

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY
from iwalker_jax.perception.camera import Intrinsics, camera_pose, offsets_from_camera
from iwalker_jax.perception.depth_cleanup import check_image_size
from iwalker_jax.perception.grid import DEFAULT_GRID, PUBLISHED_GRID, GridSpec


@dataclass(frozen=True)
class ObstacleParameters:
    """Which points are obstacles, and how many of them make a cell occupied.

    Attributes:
        min_height: [m] above the floor; lower points belong to the floor.
        max_height: [m] above the floor; the robot walks under higher points.
        tolerance_range: [m] distance from the camera up to which min_height holds.
        drop_height: [m] below the floor, from which points belong to a drop.
        tolerance_slope: [m/m] growth of both beyond tolerance_range: depth noise and an error of the camera's pitch
            lift far floor points; 0.025 forgives 1.4 degrees and still sees a 0.11 m step at 4 m.
        max_tolerance: [m] limit of that growth: a step or a drop this high is never floor.
        min_area: [m^2] image area, seen face on, that a small obstacle shows (a strip of 3 cm x 10 cm).
        min_points: fewest points that make a cell occupied, however far.
        max_points: number of points that always suffices, however near.
    """

    min_height: float = BODY.step_over
    max_height: float = 0.75
    drop_height: float = 0.05
    tolerance_range: float = 0.8
    tolerance_slope: float = 0.025
    max_tolerance: float = 0.15
    min_area: float = 0.003
    min_points: int = 2
    max_points: int = 8

    def __post_init__(self) -> None:
        if not all(math.isfinite(v) for v in (self.min_height, self.max_height, self.min_area)):
            raise InputError("ObstacleParameters needs finite heights and area.")
        if not 0.0 < self.min_height < self.max_height:
            raise InputError(
                f"ObstacleParameters needs 0 < min_height < max_height, got {self.min_height} and {self.max_height} m."
            )
        if not (
            0.0 < self.drop_height <= self.max_tolerance and self.min_height <= self.max_tolerance < self.max_height
        ):
            raise InputError(
                "ObstacleParameters needs max_tolerance from min_height to max_height, and drop_height from 0 to it."
            )
        if self.tolerance_range < 0.0 or self.tolerance_slope < 0.0:
            raise InputError("ObstacleParameters needs tolerance_range >= 0 and tolerance_slope >= 0.")
        if self.min_area <= 0.0 or not 1 <= self.min_points <= self.max_points:
            raise InputError("ObstacleParameters needs min_area > 0 and 1 <= min_points <= max_points.")

    def floor_band(self, ground_range: Float[Array, "*shape"]) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"]]:
        """Heights [m] below and above which a point at a horizontal distance [m] is a drop or an obstacle."""
        growth = self.tolerance_slope * jnp.maximum(ground_range - self.tolerance_range, 0.0)
        low, high = (jnp.minimum(limit + growth, self.max_tolerance) for limit in (self.drop_height, self.min_height))
        return -low, high


DEFAULT_OBSTACLES = ObstacleParameters()
"""For a robot 0.66 m tall; what its feet clear is floor (`BODY.step_over`)."""


class PointPlanes(NamedTuple):
    """Points of a depth image as one array per coordinate: on a CPU ten times faster than (height, width, 3).

    Attributes:
        x, y, z: [m] base frame; z is the height above the floor.
        ground_range: [m] horizontal distance from the camera.
        valid: False where there was no return.
    """

    x: Float[Array, "height width"]
    y: Float[Array, "height width"]
    z: Float[Array, "height width"]
    ground_range: Float[Array, "height width"]
    valid: Bool[Array, "height width"]


def point_planes(depth: Float[Array, "height width"], mount: Float[Array, " 5"], intrinsics: Intrinsics) -> PointPlanes:
    """Points of a cleaned depth image, those of `camera.backproject`.

    Args:
        depth: z-depth [m], 0 = no return (`clean_depth`).
        mount: [height, pitch, roll, forward, left] as in `CameraMount`.
        intrinsics: of this image size.

    Raises:
        InputError: if the image has another size.
    """
    check_image_size(depth.shape, intrinsics)
    R_base_camera, p_base_camera = camera_pose(mount.astype(depth.dtype))
    ahead, left, up = offsets_from_camera(depth, intrinsics, R_base_camera)
    x, y, z = (offset + place for offset, place in zip((ahead, left, up), p_base_camera))
    return PointPlanes(x, y, z, jnp.sqrt(ahead**2 + left**2), depth > 0.0)


def classify_points(
    points: PointPlanes, obstacles: ObstacleParameters
) -> tuple[Bool[Array, "height width"], Bool[Array, "height width"], Bool[Array, "height width"]]:
    """(floor, obstacle, drop) masks of points by their height above the floor.

    A drop lies clearly below the floor (a hole, a stair down). Points above max_height are none of the three: the robot
    walks under them.
    """
    low, high = obstacles.floor_band(points.ground_range)
    floor = points.valid & (points.z >= low) & (points.z <= high)
    obstacle = points.valid & (points.z > high) & (points.z < obstacles.max_height)
    drop = points.valid & (points.z < low)
    return floor, obstacle, drop


def flat_cell_index(
    points: PointPlanes, keep: Bool[Array, "height width"], grid: GridSpec
) -> Int[Array, "height width"]:
    """Row-major index of each point's cell; rows * columns (one past the map) where not kept or outside."""
    row = jnp.floor((points.x - grid.x_min) / grid.resolution)
    column = jnp.floor((points.y - grid.y_min) / grid.resolution)
    inside = keep & (row >= 0) & (row < grid.rows) & (column >= 0) & (column < grid.columns)
    return jnp.where(inside, row * grid.columns + column, grid.rows * grid.columns).astype(jnp.int32)


def cell_offsets(
    grid: GridSpec, camera_xy: Float[Array, " 2"]
) -> tuple[Float[Array, "rows 1"], Float[Array, "1 columns"]]:
    """(ahead, left) [m] of the cell centres as seen from the camera; the two broadcast to the map."""
    x = grid.x_min + (jnp.arange(grid.rows) + 0.5) * grid.resolution
    y = grid.y_min + (jnp.arange(grid.columns) + 0.5) * grid.resolution
    return (x - camera_xy[0])[:, None], (y - camera_xy[1])[None, :]


def count_points(index: Int[Array, "*image"], grid: GridSpec) -> Int[Array, "rows columns"]:
    """Number of points in each cell; `index` as from `flat_cell_index`."""
    counts = jnp.zeros(grid.rows * grid.columns, jnp.int32).at[index.ravel()].add(1, mode="drop")
    return counts.reshape(grid.shape)


def points_needed(
    camera_xy: Float[Array, " 2"], intrinsics: Intrinsics, grid: GridSpec, obstacles: ObstacleParameters
) -> Float[Array, "rows columns"]:
    """Number of obstacle points that each cell must show at its distance from the camera.

    An area A at distance r covers f_x f_y A / r^2 pixels, so the number asked for falls with distance,
    between max_points and min_points.
    """
    ahead, left = cell_offsets(grid, camera_xy)
    squared_range = jnp.maximum(ahead**2 + left**2, 1e-4)
    expected = intrinsics.fx * intrinsics.fy * obstacles.min_area / squared_range
    return jnp.clip(expected, obstacles.min_points, obstacles.max_points)


def occupied_cells(
    counts: Int[Array, "rows columns"],
    camera_xy: Float[Array, " 2"],
    intrinsics: Intrinsics,
    grid: GridSpec,
    obstacles: ObstacleParameters,
) -> Bool[Array, "rows columns"]:
    """Cells that hold enough obstacle points for their distance from the camera (`points_needed`).

    The 3 x 3 neighbourhood must hold that many and the cell itself a third of it: a table leg on a cell border stays,
    the thin tail of a wall's range noise does not.
    """
    needed = points_needed(camera_xy, intrinsics, grid, obstacles)
    return (sum_3x3(counts) >= needed) & (3 * counts >= needed)


def occupancy_map(
    depth: Float[Array, "height width"],
    mount: Float[Array, " 5"],
    intrinsics: Intrinsics,
    grid: GridSpec = DEFAULT_GRID,
    obstacles: ObstacleParameters = DEFAULT_OBSTACLES,
) -> Bool[Array, "rows columns"]:
    """Occupied cells of one cleaned depth image: points between the heights of `obstacles` above the floor.

    Args:
        depth: z-depth [m], 0 = no return (`clean_depth`).
        mount: [height, pitch, roll, forward, left] as in `CameraMount`, known or from `fit_floor`.
        intrinsics: of this image size.
        grid: of the map, base frame.
        obstacles: obstacle heights and point counts.
    """
    points = point_planes(depth, mount, intrinsics)
    _, obstacle, _ = classify_points(points, obstacles)
    counts = count_points(flat_cell_index(points, obstacle, grid), grid)
    return occupied_cells(counts, mount[3:5], intrinsics, grid, obstacles)


def published_collision_map(
    depth: Float[Array, "height width"],
    mount: Float[Array, " 5"],
    intrinsics: Intrinsics,
    grid: GridSpec = PUBLISHED_GRID,
) -> Float[Array, "rows columns"]:
    """The paper's collision map: points at about the camera's height, counted, capped and blurred.

    Points deeper than 0.8 m and within 0.2 m of the camera's height add 0.1 to their cell; cells below 0.2 become 0 and
    none exceeds 2; then a Gaussian of 7 x 7 cells with sigma 1.4 cells, mirrored at the border. It grows towards
    obstacles and holds no distance.

    Args:
        depth: z-depth [m], 0 = no return (`clean_depth`).
        mount: [height, pitch, roll, forward, left] as in `CameraMount`.
        intrinsics: of this image size.
        grid: of the map, base frame.
    """
    points = point_planes(depth, mount, intrinsics)
    keep = (depth > 0.8) & (jnp.abs(points.z - mount[0]) < 0.2)
    counts = count_points(flat_cell_index(points, keep, grid), grid)
    values = jnp.where(counts >= 2, jnp.minimum(0.1 * counts, 2.0), 0.0).astype(depth.dtype)
    return _blur(values)


def _blur(values: Float[Array, "rows columns"]) -> Float[Array, "rows columns"]:
    """Separable 7 x 7 Gaussian, sigma 1.4 cells."""
    taps = np.exp(-0.5 * (np.arange(-3, 4) / 1.4) ** 2)
    taps = taps / taps.sum()
    rows, columns = values.shape
    padded = jnp.pad(values, 3, mode="reflect")
    vertical = functools.reduce(jnp.add, [float(w) * padded[k : k + rows] for k, w in enumerate(taps)])
    return functools.reduce(jnp.add, [float(w) * vertical[:, k : k + columns] for k, w in enumerate(taps)])


def sum_3x3(counts: Num[Array, "rows columns"]) -> Num[Array, "rows columns"]:
    """Sum over each cell and its eight neighbours; nothing lies outside the map."""
    rows, columns = counts.shape
    padded = jnp.pad(counts, 1)
    vertical = padded[:rows] + padded[1 : rows + 1] + padded[2:]
    return vertical[:, :columns] + vertical[:, 1 : columns + 1] + vertical[:, 2:]

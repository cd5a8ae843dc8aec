"""Occupancy and distance field that feel every depth pixel: gradual where the hard map decides, the same where it is
sure.

Notation: point k of the depth image, at p_k, counts with a weight w_k from 0 to 1 (is it an obstacle, by its height?)
that is shared among the four cells around it. Cell j gets a mass m_j, the mean place q_j of its share, and a degree of
occupancy o_j from 0 to 1 (is the mass enough?). The distance field is

    d(x) = min_j |x - q_j| + penalty (1 / o_j - 1) - half a cell.

A wall that moves by a centimetre moves the field by a centimetre, whatever cells it lies in, and a cell that comes
into being comes from far. The nearest j is searched for without derivatives; the minimum's derivative is that of its
nearest term (envelope theorem).
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.checks import Scalar, require_plain_numbers
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import safe_norm, smooth_step
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.perception.collision_map import (
    DEFAULT_OBSTACLES,
    ObstacleParameters,
    PointPlanes,
    point_planes,
    points_needed,
    sum_3x3,
)
from iwalker_jax.perception.distance_field import grid_diagonal, signed_distance_field
from iwalker_jax.perception.grid import DEFAULT_GRID, GridSpec

_TRIALS = 16
"""Cells that one loop step of the search tries together."""


@dataclass(frozen=True)
class SoftOccupancy:
    """How gradual the decisions of `ObstacleParameters` are. As the ramps go to zero, occupancy becomes the hard one.

    Attributes:
        height_ramp: [m] of height over which a point turns from floor to obstacle, and at max_height back.
        border_ramp: [cells] over which a point passes from a cell to its neighbour, at most 1.
        count_ramp: share of the points asked for that may be missing until a cell is free, at most 1.
        penalty: [m] added to the distance of a cell that is half occupied.
    """

    height_ramp: float = 0.02
    border_ramp: float = 1.0
    count_ramp: float = 0.5
    penalty: float = 0.05

    def __post_init__(self) -> None:
        require_plain_numbers(self)
        if not min(self.height_ramp, self.border_ramp, self.count_ramp, self.penalty) > 0.0:
            raise InputError("SoftOccupancy needs ramps and penalty above 0; leave it out for the hard map.")
        if not max(self.border_ramp, self.count_ramp) <= 1.0:
            raise InputError("SoftOccupancy needs border_ramp and count_ramp of at most 1.")


DEFAULT_SOFTNESS = SoftOccupancy()
"""Ramps as wide as a cell and as the noise of the floor."""


class SoftMap(NamedTuple):
    """Maps that are differentiable in depth and mount.

    Attributes:
        occupancy: (rows, columns) degree of being occupied, 0 to 1.
        esdf: (rows, columns) [m] signed distance. Cells deeper inside an obstacle than its outermost keep their hard
            distance to free space, which has no derivative: no pixel shows an inside.
    """

    occupancy: Float[Array, "rows columns"]
    esdf: Float[Array, "rows columns"]


def soft_map(
    depth: Float[Array, "height width"],
    mount: Float[Array, " 5"],
    intrinsics: Intrinsics,
    grid: GridSpec = DEFAULT_GRID,
    obstacles: ObstacleParameters = DEFAULT_OBSTACLES,
    soft: SoftOccupancy = DEFAULT_SOFTNESS,
) -> SoftMap:
    """Soft occupancy and distance field of one cleaned depth image.

    Both are continuous in depth and mount as long as the same pixels return, the insides of obstacles apart. The
    field's derivative jumps where another cell becomes the nearest.

    Args:
        depth: z-depth [m], 0 = no return (`clean_depth`).
        mount: [height, pitch, roll, forward, left] as in `CameraMount`, known or from `fit_floor`.
        intrinsics: of this image size.
        grid: of the map, base frame.
        obstacles: obstacle heights and point counts.
        soft: how gradual they are.

    Raises:
        InputError: if the image has another size than its intrinsics.
    """
    points = point_planes(depth, mount, intrinsics)
    # At the camera's own place, where pixels without a return lie, a plain root would have no finite derivative.
    offset = jnp.stack([points.x - mount[3], points.y - mount[4]], axis=-1)
    points = points._replace(ground_range=safe_norm(offset))
    mass, place = _shared(points, _obstacle_weight(points, obstacles, soft), grid, soft)
    needed = points_needed(mount[3:5], intrinsics, grid, obstacles)
    occupancy = _enough(sum_3x3(mass), needed, soft) * _enough(3.0 * mass, needed, soft)
    return SoftMap(occupancy, _soft_distance(occupancy, place, grid, soft))


def _ramp(excess: Float[Array, "*shape"], width: Scalar) -> Float[Array, "*shape"]:
    """0 below -width/2, 1 above width/2, and smooth between (a cubic)."""
    return smooth_step(jnp.clip(excess / width + 0.5, 0.0, 1.0))


def _obstacle_weight(
    points: PointPlanes, obstacles: ObstacleParameters, soft: SoftOccupancy
) -> Float[Array, "height width"]:
    """Degree to which each point is an obstacle by its height above the floor."""
    _, high = obstacles.floor_band(points.ground_range)
    above = _ramp(points.z - high, soft.height_ramp)
    below = _ramp(obstacles.max_height - points.z, soft.height_ramp)
    return jnp.where(points.valid, above * below, 0.0)


def _shared(
    points: PointPlanes, weight: Float[Array, "height width"], grid: GridSpec, soft: SoftOccupancy
) -> tuple[Float[Array, "rows columns"], Float[Array, "rows columns 2"]]:
    """(mass, mean place [m]) of what every cell gets of the points."""
    xy = jnp.stack([points.x, points.y], axis=-1).reshape(-1, 2)
    u = grid.cell_coordinates(xy)
    corner = jnp.floor(lax.stop_gradient(u))
    beyond = _ramp(u - corner - 0.5, soft.border_ramp)
    carried = weight.reshape(-1, 1) * jnp.concatenate([jnp.ones_like(xy[:, :1]), xy], axis=1)
    sums = jnp.zeros((grid.rows * grid.columns, 3), carried.dtype)
    for offset in ((0, 0), (0, 1), (1, 0), (1, 1)):
        row, column = corner[:, 0] + offset[0], corner[:, 1] + offset[1]
        inside = (row >= 0) & (row < grid.rows) & (column >= 0) & (column < grid.columns)
        index = jnp.where(inside, row * grid.columns + column, grid.rows * grid.columns).astype(jnp.int32)
        share = jnp.prod(jnp.where(jnp.asarray(offset) == 1, beyond, 1.0 - beyond), axis=1)
        sums = sums.at[index].add(share[:, None] * carried, mode="drop")
    mass = sums[:, 0]
    filled = mass > 0.0
    place = sums[:, 1:] / jnp.where(filled, mass, 1.0)[:, None]
    return mass.reshape(grid.shape), place.reshape(*grid.shape, 2)


def _enough(
    mass: Float[Array, "rows columns"], needed: Float[Array, "rows columns"], soft: SoftOccupancy
) -> Float[Array, "rows columns"]:
    """1 where the mass suffices, as in the hard map, falling to 0 where the share `count_ramp` of it is missing."""
    return _ramp(mass / needed - 1.0 + 0.5 * soft.count_ramp, soft.count_ramp)


def _soft_distance(
    occupancy: Float[Array, "rows columns"],
    place: Float[Array, "rows columns 2"],
    grid: GridSpec,
    soft: SoftOccupancy,
) -> Float[Array, "rows columns"]:
    """d(x) of the module's docstring, at most the grid's diagonal; deep insides by the hard field."""
    diagonal = grid_diagonal(grid.shape, grid.resolution)
    # Fainter cells are farther than the diagonal from everywhere.
    present = occupancy > soft.penalty / (soft.penalty + diagonal)
    extra = soft.penalty * (1.0 / jnp.where(present, occupancy, 1.0) - 1.0)
    sites = jnp.concatenate([place, extra[..., None]], axis=-1).reshape(-1, 3)
    nearest = _nearest_site(lax.stop_gradient(sites), present, grid)

    site = sites[nearest]
    distance = safe_norm(grid.centres().astype(site.dtype) - site[..., :2]) + site[..., 2] - 0.5 * grid.resolution
    distance = jnp.where(jnp.any(present), jnp.minimum(distance, diagonal), diagonal)
    hard = signed_distance_field(occupancy >= 0.5, grid.resolution).astype(distance.dtype)
    # The outermost cells of an obstacle have half a cell, the next at least 0.9.
    return jnp.where(hard < -0.75 * grid.resolution, hard, distance)


def _nearest_site(
    sites: Float[Array, "cells 3"], present: Bool[Array, "rows columns"], grid: GridSpec
) -> Int[Array, "rows columns"]:
    """Index of the present site (x, y, extra distance) [m] that is nearest to each cell's centre."""
    cells = grid.rows * grid.columns
    order = jnp.nonzero(present.ravel(), size=cells + _TRIALS, fill_value=cells)[0].astype(jnp.int32)
    # The list's unused end names one more site, which is nobody's nearest.
    sites = jnp.concatenate([sites, jnp.asarray([[0.0, 0.0, jnp.inf]], sites.dtype)])
    centres = grid.centres().astype(sites.dtype)

    def step(carry: tuple) -> tuple:
        tried, least, nearest = carry
        for k in [order[tried + n] for n in range(_TRIALS)]:
            x, y, extra = sites[k]
            there = jnp.sqrt((centres[..., 0] - x) ** 2 + (centres[..., 1] - y) ** 2) + extra
            nearest = jnp.where(there < least, k, nearest)
            least = jnp.minimum(there, least)
        return tried + _TRIALS, least, nearest

    start = (
        jnp.asarray(0, jnp.int32),
        jnp.full(grid.shape, jnp.inf, sites.dtype),
        jnp.zeros(grid.shape, jnp.int32),
    )
    return lax.while_loop(lambda carry: carry[0] < jnp.sum(present), step, start)[2]

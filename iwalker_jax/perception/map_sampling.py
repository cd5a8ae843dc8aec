"""Differentiable sampling of a map at points between its cells, well defined on the whole plane.

Notation: u are continuous cell coordinates (a cell's centre is an integer), p are points [m] in the `base` frame.
"""

from typing import Literal

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.perception.grid import GridSpec

Outside = Literal["extend", "clamp"]
"""What a sample means beyond the outermost cell centres: `clamp` continues the border value (occupancy, costs);
`extend` adds the distance [m] to the rectangle of cell centres, which continues a distance field measured in metres."""


def sample_bilinear(
    field: Float[Array, "rows columns"],
    grid: GridSpec,
    points: Float[Array, "*batch 2"],
    outside: Outside = "extend",
) -> Float[Array, "*batch"]:
    """Value of a map at points, interpolated bilinearly between the four nearest cell centres.

    Continuous everywhere and exact at cell centres; the gradient jumps where cell centres line up. Where the field
    is 1-Lipschitz between neighbouring cells, the sample changes by at most 1 per metre along either axis.

    Args:
        field: map, one value a cell.
        grid: where the cells lie.
        points: positions [m] in base; finite (a NaN coordinate gives a NaN value).
        outside: see `Outside`.

    Returns:
        Values in the field's unit; differentiable with respect to `field` and `points`.

    Raises:
        InputError: if the field's shape is not the grid's, or `outside` is unknown.
    """
    _check(field, grid, outside)
    u = grid.cell_coordinates(points)
    u_clamped = _clamp(u, jnp.zeros(2, u.dtype), _last(grid, u.dtype))
    corner = jnp.clip(jnp.floor(u_clamped), 0, _last(grid, u.dtype) - 1)
    t = u_clamped - corner
    weights = jnp.stack([1 - t, t], axis=-1)
    value = _tensor_product(field, corner.astype(jnp.int32), weights)
    if outside == "extend":
        squared = _squared_excess(u, grid)
        positive = squared > 0
        value = value + jnp.where(positive, jnp.sqrt(jnp.where(positive, squared, 1.0)), 0.0)
    return value


def sample_smooth(
    field: Float[Array, "rows columns"],
    grid: GridSpec,
    points: Float[Array, "*batch 2"],
    outside: Outside = "extend",
) -> Float[Array, "*batch"]:
    """Value of a map at points, smoothed by a quadratic B-spline over 3 x 3 cells: continuous first derivatives.

    The weights along an axis are (1/2 - t)^2 / 2, 3/4 - t^2, (1/2 + t)^2 / 2 with t the offset from the nearest cell
    centre (Unser, "Splines: a perfect fit for signal and image processing", 1999). They are positive and sum to one:
    the sample never leaves the range of the nine cells, reproduces linear fields exactly, and rounds kinks off instead
    of interpolating them (at a cell centre by an eighth of the second difference along each axis). The border cells
    repeat outwards, so that the gradient is continuous on the whole plane; `extend` grows quadratically over the first
    cell beyond the border for the same reason.

    Args, returns and errors as in `sample_bilinear`.
    """
    _check(field, grid, outside)
    u = grid.cell_coordinates(points)
    # Two cells beyond the border all nine cells repeat the border, so stopping there changes neither value nor slope.
    u_clamped = _clamp(u, jnp.full(2, -2.0, u.dtype), _last(grid, u.dtype) + 2)
    centre = jnp.floor(u_clamped + 0.5)
    t = u_clamped - centre
    weights = jnp.stack([0.5 * (0.5 - t) ** 2, 0.75 - t**2, 0.5 * (0.5 + t) ** 2], axis=-1)
    value = _tensor_product(field, centre.astype(jnp.int32) - 1, weights)
    if outside == "extend":
        squared = _squared_excess(u, grid)
        width = grid.resolution
        far = squared > width**2
        distance = jnp.sqrt(jnp.where(far, squared, 1.0))
        value = value + jnp.where(far, distance - 0.5 * width, squared / (2 * width))
    return value


def _check(field: Float[Array, "rows columns"], grid: GridSpec, outside: str) -> None:
    if field.shape != grid.shape:
        raise InputError(f"The map has shape {field.shape} but the grid is {grid.shape}; pass the map's own grid.")
    if outside not in ("extend", "clamp"):
        raise InputError(f"outside must be 'extend' or 'clamp', got {outside!r}.")


def _last(grid: GridSpec, dtype: jnp.dtype) -> Float[Array, "2"]:
    return jnp.asarray([grid.rows - 1, grid.columns - 1], dtype)


def _clamp(u: Float[Array, "*batch 2"], low: Float[Array, "2"], high: Float[Array, "2"]) -> Float[Array, "*batch 2"]:
    """Clip whose derivative is one on the limits themselves (jnp.clip halves it there)."""
    return jnp.where(u < low, low, jnp.where(u > high, high, u))


def _squared_excess(u: Float[Array, "*batch 2"], grid: GridSpec) -> Float[Array, "*batch"]:
    """Squared distance [m^2] from points to the rectangle spanned by the cell centres."""
    excess = (u - _clamp(u, jnp.zeros(2, u.dtype), _last(grid, u.dtype))) * grid.resolution
    return jnp.sum(excess**2, axis=-1)


def _tensor_product(
    field: Float[Array, "rows columns"], first: Int[Array, "*batch 2"], weights: Float[Array, "*batch 2 taps"]
) -> Float[Array, "*batch"]:
    """Sum of weight_row x weight_column x cell over the taps that start at `first`; border cells repeat."""
    offsets = jnp.arange(weights.shape[-1])
    rows = jnp.clip(first[..., 0, None] + offsets, 0, field.shape[0] - 1)
    columns = jnp.clip(first[..., 1, None] + offsets, 0, field.shape[1] - 1)
    values = field[rows[..., :, None], columns[..., None, :]]
    along_columns = jnp.sum(values * weights[..., 1, None, :], axis=-1)
    return jnp.sum(along_columns * weights[..., 0, :], axis=-1)

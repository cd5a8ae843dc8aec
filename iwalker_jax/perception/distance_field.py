"""Exact Euclidean distance transforms of occupancy maps: to the nearest obstacle, and two-sided.

Notation: i, j are the row and column of a cell, h(i, j) the distance along column j to the nearest cell of the other
class (occupied or free), D(i, j) the squared distance to the nearest cell of the other class, all in cells. Then

    D(i, j) = min( r(i, j)^2, min_k (j - k)^2 + h(i, k)^2 ),

with r the distance along row i to the nearest cell of the other class (after Saito and Toriwaki, 1994). The class of
cell (i, k) needs no test: where it is the other one, r is already the smaller term. Hence one pass gives the distance
outside and inside obstacles alike.
"""

import jax.numpy as jnp
from jax import lax
from jax.custom_batching import sequential_vmap
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.arrays import as_numbers, is_known
from iwalker_jax.errors import InputError
from iwalker_jax.promotion import usual_promotion
from iwalker_jax.runtime.reading import printable

_TRIALS = 16
"""Columns k that one loop step tries in one fused operation: enough to hide the step's own cost and memory traffic."""

_MAX_CELLS = 16_000
"""Largest rows + columns for which distances fit 16 bits and four times their squares 32 bits."""


@usual_promotion
def distance_transform(occupied: Bool[Array, "rows columns"], resolution: float) -> Float[Array, "rows columns"]:
    """Distance [m] from each cell's centre to the nearest occupied cell's centre; 0 in occupied cells.

    Args:
        occupied: obstacles.
        resolution: [m] side of a cell.

    Returns:
        Distances [m]; the grid's diagonal, `grid_diagonal`, everywhere if no cell is occupied.

    Raises:
        InputError: as `signed_distance_field`.
    """
    occupied = _checked(occupied, resolution)
    squared = jnp.where(occupied, 0, _squared_distance_to_other_class(occupied))
    return _metres(squared, resolution)


@usual_promotion
def signed_distance_field(occupied: Bool[Array, "rows columns"], resolution: float) -> Float[Array, "rows columns"]:
    """Signed distance [m]: positive outside obstacles, negative inside, zero on the faces between cells.

    A free cell's value is its distance to the nearest occupied cell's centre less half a cell, an occupied cell's is
    minus (its distance to the nearest free cell's centre less half a cell): across a face the field goes from +1/2 to
    -1/2 cell, its slope there is one, and it changes by no more than the distance between neighbouring cells anywhere.

    Args:
        occupied: obstacles.
        resolution: [m] side of a cell.

    Returns:
        Distances [m]; plus or minus the grid's diagonal, `grid_diagonal`, if all cells are free or all are occupied.

    Raises:
        InputError: for a map that is not a boolean one of two axes, one whose rows + columns exceed 16000, and a
            resolution that is not positive.
    """
    occupied = _checked(occupied, resolution)
    squared = _squared_distance_to_other_class(occupied)
    to_face = jnp.where(squared < _far(squared.shape), 0.5 * resolution, 0.0)
    magnitude = _metres(squared, resolution) - to_face
    return jnp.where(occupied, -magnitude, magnitude)


def _checked(occupied: Bool[ArrayLike, "rows columns"], resolution: float) -> Bool[Array, "rows columns"]:
    """The map as a JAX array, or InputError; a traced resolution passes."""
    cells = as_numbers(occupied, "The map")
    if cells.dtype != bool or cells.ndim != 2 or 0 in cells.shape:
        raise InputError(
            f"The map holds {cells.dtype} in shape {cells.shape}; give a boolean (rows, columns) map of obstacles, for "
            "example `counts > 0`."
        )
    shape = as_numbers(resolution, "The resolution").shape
    if shape or (is_known(resolution) and not 0 < float(resolution) < jnp.inf):
        raise InputError(f"The resolution is {printable(resolution)}; give one positive number [m].")
    return cells


def grid_diagonal(shape: tuple[int, int], resolution: float) -> float:
    """Length [m] of a map's diagonal: no distance between two of its cells is as long."""
    return resolution * (shape[0] ** 2 + shape[1] ** 2) ** 0.5


def _far(shape: tuple[int, ...]) -> int:
    """Squared length of the diagonal [cells^2]: above every D(i, j), stands for "there is no such cell"."""
    return shape[0] ** 2 + shape[1] ** 2


def _metres(squared: Int[Array, "rows columns"], resolution: float) -> Float[Array, "rows columns"]:
    return resolution * jnp.sqrt(jnp.minimum(squared, _far(squared.shape)).astype(jnp.result_type(float)))


# Mapped one by one, each map of a batch stops at its own distance and stays in the cache; in one batched loop every
# map would wait for the slowest and travel through memory at each step.
@sequential_vmap
def _squared_distance_to_other_class(occupied: Bool[Array, "rows columns"]) -> Int[Array, "rows columns"]:
    """D(i, j) of the module's docstring [cells^2]; at least `_far` if there is one class only.

    Brute force over k in wide integer operations beats the linear-time envelope algorithms here, because those walk
    from cell to cell. Two orders of trying k keep it short: outwards from j until no farther column can help (soon over
    where obstacles are many), and the useful columns one by one (soon over where obstacles are few).
    """
    rows, columns = occupied.shape
    if rows + columns > _MAX_CELLS:
        raise InputError(
            f"A map of {rows} x {columns} cells is too large for exact integer distances; "
            f"rows + columns may be at most {_MAX_CELLS}: split or coarsen the map."
        )
    far = _far(occupied.shape)

    def squared(distance: Int[Array, "a b"]) -> Int[Array, "a b"]:
        wide = distance.astype(jnp.int32)
        return jnp.where(wide > rows + columns, far, wide**2)

    along_column = squared(_distance_to_other_class_above_or_below(occupied))
    along_row = squared(_distance_to_other_class_above_or_below(occupied.T).T)
    useful = jnp.any(occupied != occupied[0], axis=0)
    best, improvable = _try_shifts(jnp.minimum(along_row, along_column), along_column, jnp.sum(useful))
    return lax.cond(improvable, lambda: _try_columns(best, along_column, useful), lambda: best)


def _try_shifts(
    best: Int[Array, "rows columns"], along_column: Int[Array, "rows columns"], useful: Int[Array, ""]
) -> tuple[Int[Array, "rows columns"], Bool[Array, ""]]:
    """Lower D by the columns nearest to each cell; also whether the others could still lower it.

    Gives up when it has tried as many columns as are useful and has more than those still to try: together with
    `_try_columns` this costs at most twice what the better order alone would.
    """
    rows, columns = best.shape
    margin = columns + _TRIALS
    beyond = jnp.full((rows, margin), _far(best.shape), jnp.int32)
    padded = jnp.concatenate([beyond, along_column, beyond], axis=1)
    lowest = jnp.min(along_column, axis=1)

    def reach(best: Int[Array, "rows columns"]) -> Int[Array, ""]:
        """Squared shift from which on no candidate of any row is below any D of that row."""
        return jnp.max(jnp.max(best, axis=1) - lowest)

    def worthwhile(carry: tuple) -> Bool[Array, ""]:
        shift, _, squared_reach = carry
        few_tried, few_left = 2 * shift < useful, 4 * squared_reach < (2 * shift + useful) ** 2
        return (shift**2 < squared_reach) & (few_tried | few_left)

    def step(carry: tuple) -> tuple:
        shift, best, _ = carry
        for d in [shift + n for n in range(_TRIALS)]:
            right = lax.dynamic_slice_in_dim(padded, margin + d, columns, axis=1)
            left = lax.dynamic_slice_in_dim(padded, margin - d, columns, axis=1)
            best = jnp.minimum(best, jnp.minimum(left, right) + d**2)
        return shift + _TRIALS, best, reach(best)

    start = (jnp.asarray(1, jnp.int32), best, reach(best))
    shift, best, squared_reach = lax.while_loop(worthwhile, step, start)
    return best, shift**2 < squared_reach


def _try_columns(
    best: Int[Array, "rows columns"], along_column: Int[Array, "rows columns"], useful: Bool[Array, " columns"]
) -> Int[Array, "rows columns"]:
    """Lower D by every useful column: one that holds cells of both classes."""
    columns = best.shape[1]
    # The list's unused end repeats column 0, which is a valid candidate like any other.
    order = jnp.nonzero(useful, size=columns + _TRIALS, fill_value=0)[0].astype(jnp.int32)
    squares = (lax.broadcasted_iota(jnp.int32, (1, 2 * columns), 1) - columns) ** 2

    def step(carry: tuple) -> tuple:
        tried, best = carry
        for k in [order[tried + n] for n in range(_TRIALS)]:
            along_row = lax.dynamic_slice_in_dim(squares, columns - k, columns, axis=1)
            best = jnp.minimum(best, lax.dynamic_slice_in_dim(along_column, k, 1, axis=1) + along_row)
        return tried + _TRIALS, best

    start = (jnp.asarray(0, jnp.int32), best)
    return lax.while_loop(lambda c: c[0] < jnp.sum(useful), step, start)[1]


def _distance_to_other_class_above_or_below(occupied: Bool[Array, "rows columns"]) -> Int[Array, "rows columns"]:
    """Distance [cells] along each column to the nearest cell of the other class; more than rows + columns if none."""
    rows, columns = occupied.shape
    none = jnp.full(columns, rows + columns + 1, jnp.int16)
    border = occupied[1:] != occupied[:-1]
    no_border = jnp.zeros((1, columns), bool)
    beside_border = jnp.concatenate([no_border, border]) | jnp.concatenate([border, no_border])
    seeds = jnp.where(beside_border, jnp.int16(1), none)

    def line(previous: Int[Array, " columns"], here: Int[Array, " columns"]) -> tuple[Array, Array]:
        nearest = jnp.minimum(previous + jnp.int16(1), here)
        return nearest, nearest

    _, forward = lax.scan(line, none, seeds)
    _, both = lax.scan(line, none, forward, reverse=True)
    return both

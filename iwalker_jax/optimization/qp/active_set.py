"""Dual active-set method (Goldfarb and Idnani 1983) on a swept tableau, many problems side by side.

The dual of the program in scaled rows is  w = w0 - S y,  low <= w <= high,  y > 0 only at high, y < 0 only at low.
Sweeping S at the active rows yields S_AA^-1 and the response of every other row at once, so that adding or dropping a
row costs one rank-one update, as much as one iteration of ADMM, and the end is exact. Problems of a batch that are
done stand still; nothing but the number of iterations is shared.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Num

from iwalker_jax.optimization.qp.factor import fold


class Tableau(NamedTuple):
    """Where a search stands; shapes as in `factor`.

    Attributes:
        matrix: (m, m, *b) S swept at the active rows: -S_AA^-1, S_AA^-1 S_AI and the Schur complement.
        values: (m, *b) y of the active rows, w of the others.
        sides: (m, *b) +1 at high, -1 at low, 0 inactive.
    """

    matrix: Float[Array, "m m *b"]
    values: Float[Array, " m *b"]
    sides: Float[Array, " m *b"]


class RowBounds(NamedTuple):
    """Bounds of w, with what the search asks of them again and again.

    Attributes:
        low, high: (m, *b) bounds.
        equality: (m, *b) whether they are equal.
        rows: (m, *b) number of each row.
    """

    low: Float[Array, " m *b"]
    high: Float[Array, " m *b"]
    equality: Bool[Array, " m *b"]
    rows: Int[Array, " m *b"]


class Thresholds(NamedTuple):
    """What the search takes for rounding.

    Attributes:
        violation: (*b,) violation of a row that counts as none.
        dependent_violation: (*b,) the same in a row that depends on the active ones.
        pivot: (*b,) Schur complements below this count as zero: the row depends on the active ones.
    """

    violation: Float[Array, "*b"]
    dependent_violation: Float[Array, "*b"]
    pivot: Float[Array, "*b"]


class ActiveSet(NamedTuple):
    """Outcome of the search; shapes as in `factor`.

    Attributes:
        sides: (m, *b) +1 at high, -1 at low, 0 inactive.
        y: (m, *b) scaled multipliers.
        matrix: (m, m, *b) the swept tableau.
        solved: (*b,) bool, the rows hold and the multipliers have their signs.
        blocked: (*b,) bool, a violated row cannot be reached: the constraints contradict each other.
        blocker: (*b,) int, where blocked by which row: its number and one more, negative for its lower bound.
        pivots: () int, iterations of the longest search.
    """

    sides: Float[Array, " m *b"]
    y: Float[Array, " m *b"]
    matrix: Float[Array, "m m *b"]
    solved: Bool[Array, "*b"]
    blocked: Bool[Array, "*b"]
    blocker: Int[Array, "*b"]
    pivots: Int[Array, ""]


class _Search(NamedTuple):
    tableau: Tableau
    entering: Array  # row on its way in, else m
    partial: Array  # its multiplier so far
    leaving: Array  # row on its way out, else m
    solved: Array
    blocked: Array
    blocker: Array
    pivots: Array


class _Pivot(NamedTuple):
    """The row that a step acts on, in each problem its own."""

    row: Array
    mask: Array  # (m, *b) one-hot
    drop: Array  # whether it leaves
    resumed: Array  # whether another row was half in before
    column: Array
    schur: Array  # the column's entry of the row itself
    value: Array
    bound: Array
    upward: Array  # whether that is the upper bound
    most_outside: Array  # largest violation of any inactive row


class _Move(NamedTuple):
    """How far the step goes, and why no farther."""

    length: Array
    done: Array  # nothing left to do
    stuck: Array  # nowhere to go
    acting: Array
    cut: Array  # another multiplier gets to zero before
    blocker: Array  # the row of that multiplier
    sign: Array


def row_bounds(low: Float[Array, " m *b"], high: Float[Array, " m *b"]) -> RowBounds:
    """Bounds of the scaled constraint values w."""
    m = low.shape[0]
    rows = jnp.broadcast_to(jnp.arange(m).reshape((m,) + (1,) * (low.ndim - 1)), low.shape)
    return RowBounds(low, high, low == high, rows)


def _first(mask: Bool[Array, " m *b"], rows: Int[Array, " m *b"]) -> Int[Array, "*b"]:
    return fold(jnp.minimum, jnp.where(mask, rows, rows.shape[0]))


def _take_row(values: Array, row: Int[Array, "*b"]) -> Array:
    """Each problem's own row."""
    if row.ndim == 0:
        return values[row]
    where = row.reshape((1,) * (values.ndim - row.ndim) + row.shape)
    return jnp.take_along_axis(values, where, axis=0, mode="clip")[0]


def _sweep(matrix: Array, column: Array, pivot: Array, row: Array, swap: Array, drop: Array) -> Array:
    """Sweep the row that the mask `row` shows where `swap` says so; unsweep it where `drop` does.

    Row and column are cleared before one product writes them anew: nothing cancels, however large the pivot. Of a
    batch two rows at a time are changed where they stand; as one expression they would be copied first.
    """
    m = matrix.shape[0]
    at = row & swap
    keep = jnp.where(at, 0, 1).astype(matrix.dtype)
    edge = jnp.where(at, jnp.where(drop, 1, -1).astype(matrix.dtype), column)
    flux = jnp.where(swap, 1 / jnp.where(pivot == 0, 1, pivot), 0) * edge

    def change(matrix: Array, first: Array | int, count: int) -> Array:
        rows, kept, share = (jax.lax.dynamic_slice_in_dim(a, first, count) for a in (matrix, keep, flux))
        rows = rows * (kept[:, None] * keep[None]) - share[:, None] * edge[None]
        return jax.lax.dynamic_update_slice_in_dim(matrix, rows, first, 0)

    if matrix.ndim == 2 or m == 1:
        return change(matrix, 0, m)
    matrix = jax.lax.fori_loop(0, m // 2, lambda k, t: change(t, 2 * k, 2), matrix)
    return change(matrix, m - 1, 1) if m % 2 else matrix


def _sweep_in(tableau: Tableau, bounds: RowBounds, priority: Array, least: Array) -> tuple[Tableau, Int[Array, ""]]:
    """Sweep in the wanted rows that do not depend on each other, whatever the signs of their multipliers become."""

    def enter(carry: tuple) -> tuple:
        (matrix, values, sides), priority, pivots = carry
        size = jnp.abs(priority)
        most = fold(jnp.maximum, size)
        row = _first(size == most, bounds.rows)
        here = bounds.rows == row
        column = _take_row(matrix, row)
        pivot = _take_row(column, row)
        upward = _take_row(jnp.where(priority > 0, 1, 0), row) > 0
        bound = jnp.where(upward, _take_row(bounds.high, row), _take_row(bounds.low, row))
        swap = (most > 0) & (pivot >= least)
        move = jnp.where(swap, (_take_row(values, row) - bound) / jnp.where(swap, pivot, 1), 0)
        values = jnp.where(here & swap, move, values - column * move)
        sides = jnp.where(here & swap, jnp.where(upward, 1, -1).astype(sides.dtype), sides)
        matrix = _sweep(matrix, column, pivot, here, swap, jnp.zeros_like(swap))
        return Tableau(matrix, values, sides), jnp.where(here, 0, priority), pivots + 1

    carry = jax.lax.while_loop(lambda c: jnp.any(c[1] != 0), enter, (tableau, priority, jnp.asarray(0, jnp.int32)))
    return carry[0], carry[2]


def _choose_row(state: _Search, bounds: RowBounds) -> _Pivot:
    """One row that must leave, one whose multiplier has the wrong sign, one half in, or the most violated."""
    matrix, values, sides = state.tableau
    m = values.shape[0]
    active = sides != 0
    sign_error = jnp.where(active & ~bounds.equality, -values * sides, 0)
    largest_error = fold(jnp.maximum, sign_error)
    outside = jnp.where(active, 0, jnp.maximum(values - bounds.high, bounds.low - values))
    most_outside = fold(jnp.maximum, outside)
    leave, fix, resumed = state.leaving < m, largest_error > 0, state.entering < m
    best = _first(jnp.where(fix, sign_error == largest_error, outside == most_outside), bounds.rows)
    row = jnp.where(leave, state.leaving, jnp.where(fix | ~resumed, best, state.entering))
    drop = leave | fix
    mask = bounds.rows == row
    column = _take_row(matrix, row)
    schur, value, high, low = (_take_row(v, row) for v in (column, values, bounds.high, bounds.low))
    upward = jnp.where(drop, _take_row(sides, row) > 0, value > high)
    bound = jnp.where(upward, high, low)
    return _Pivot(row, mask, drop, resumed, column, schur, value, bound, upward, most_outside)


def _ratio_test(state: _Search, pivot: _Pivot, bounds: RowBounds, thresholds: Thresholds) -> _Move:
    """To the row's bound (or its multiplier to zero), unless another multiplier gets to zero before."""
    _, values, sides = state.tableau
    active, dtype = sides != 0, values.dtype
    huge = jnp.finfo(dtype).max / 4
    dependent = ~pivot.drop & (pivot.schur < thresholds.pivot)
    # What little a dependent row is violated by is rounding: the active rows already hold it.
    allowed = jnp.where(dependent, thresholds.dependent_violation, thresholds.violation)
    done = ~pivot.drop & ~pivot.resumed & (pivot.most_outside <= allowed)
    full = jnp.where(pivot.drop, pivot.value, pivot.value - pivot.bound) / jnp.where(dependent, 1, pivot.schur)
    sign = jnp.where(pivot.upward, 1, -1).astype(dtype)
    falling = pivot.column * sign * sides
    blocking = active & ~bounds.equality & (falling > 0)
    ratio = jnp.where(blocking, values * sides / jnp.where(falling > 0, falling, 1), huge)
    nearest = jnp.maximum(fold(jnp.minimum, ratio), 0)
    cut = ~pivot.drop & (nearest < jnp.where(dependent, huge, jnp.abs(full)))
    stuck = dependent & ~cut & ~done
    acting = ~(state.solved | state.blocked) & ~done & ~stuck
    length = jnp.where(acting, jnp.where(cut, sign * nearest, full), 0)
    return _Move(length, done, stuck, acting, cut, _first((ratio <= nearest) & active, bounds.rows), sign)


def _pivot_step(state: _Search, bounds: RowBounds, thresholds: Thresholds) -> _Search:
    """Let one row of each unfinished problem in or out, as far as the other multipliers allow."""
    matrix, values, sides = state.tableau
    m, running = values.shape[0], ~(state.solved | state.blocked)
    pivot = _choose_row(state, bounds)
    move = _ratio_test(state, pivot, bounds, thresholds)
    row, drop, acting, cut = pivot.row, pivot.drop, move.acting, move.cut
    swap = acting & ~cut
    values = values - pivot.column * move.length
    entered = jnp.where(row == state.entering, state.partial, 0) + move.length
    values = jnp.where(pivot.mask & swap, jnp.where(drop, pivot.bound - move.length, entered), values)
    sides = jnp.where(pivot.mask & swap, jnp.where(drop, 0, move.sign), sides)
    entering = jnp.where(drop, state.entering, jnp.where(cut, row, m))
    return _Search(
        Tableau(_sweep(matrix, pivot.column, pivot.schur, pivot.mask, swap, drop), values, sides),
        jnp.where(acting, entering, state.entering),
        jnp.where(acting & ~drop, jnp.where(cut, entered, 0), state.partial),
        jnp.where(acting, jnp.where(cut, move.blocker, m), state.leaving),
        state.solved | (running & move.done),
        state.blocked | (running & move.stuck),
        jnp.where(running & move.stuck, jnp.where(pivot.upward, row + 1, -row - 1), state.blocker),
        state.pivots + 1,
    )


def contradiction(found: ActiveSet, bounds: RowBounds) -> Float[Array, " m *b"]:
    """The multipliers that grow without limit while the row that blocks a search is pushed in vain; else zero."""
    row = jnp.abs(found.blocker) - 1
    ray = jnp.where(found.sides != 0, -_take_row(found.matrix, jnp.maximum(row, 0)), 0)
    return jnp.where(bounds.rows == row, 1, ray) * jnp.sign(found.blocker).astype(ray.dtype)


def find_active_set(
    tableau: Tableau,
    bounds: RowBounds,
    thresholds: Thresholds,
    priority: Num[Array, " m *b"] | None,
    frozen: Bool[Array, "*b"],
    limit: int,
) -> ActiveSet:
    """Search the active set of the optimum, from scratch or from where another search ended.

    Args:
        tableau: S, w0 and zeros, or as another search left them (y of the active rows, w of the others).
        bounds: of w.
        thresholds: what counts as rounding.
        priority: signs say which rows to start from and on which side, sizes in which order; None starts from the
            tableau's sides.
        frozen: problems to leave as they are.
        limit: most pivots.
    """
    m, dtype, batch = tableau.values.shape[0], tableau.values.dtype, tableau.values.shape[1:]
    pivots = jnp.asarray(0, jnp.int32)
    if priority is not None:
        tableau, pivots = _sweep_in(tableau, bounds, priority, thresholds.pivot)
    none = jnp.full(batch, m)
    state = _Search(
        tableau,
        none,
        jnp.zeros(batch, dtype),
        none,
        frozen,
        jnp.zeros(batch, bool),
        jnp.zeros(batch, bounds.rows.dtype),
        pivots,
    )
    state = jax.lax.while_loop(
        lambda s: jnp.any(~(s.solved | s.blocked)) & (s.pivots < limit),
        lambda s: _pivot_step(s, bounds, thresholds),
        state,
    )
    matrix, values, sides = state.tableau
    y = jnp.where(sides != 0, values, 0)
    return ActiveSet(sides, y, matrix, state.solved, state.blocked, state.blocker, state.pivots)

"""Dual active-set method (Goldfarb and Idnani 1983) on a swept tableau, many problems side by side.

The dual of the program in scaled rows is  w = w0 - S y,  low <= w <= high,  y > 0 only at high, y < 0 only at low.
Sweeping S at the active rows yields S_AA^-1 and the response of every other row at once, so that adding or dropping a
row costs one rank-one update, as much as one iteration of ADMM, and the end is exact. Problems of a batch that are
done stand still; nothing but the number of iterations is shared.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.optimization.qp.factor import fold


class ActiveSet(NamedTuple):
    """Outcome of the search; shapes as in `qp_factor`.

    Attributes:
        sides: (m, *b) +1 at high, -1 at low, 0 inactive.
        y: (m, *b) scaled multipliers.
        tableau: (m, m, *b) S swept at the active rows: -S_AA^-1, S_AA^-1 S_AI and the Schur complement.
        solved: (*b,) bool, the rows hold and the multipliers have their signs.
        blocked: (*b,) bool, a violated row cannot be reached: the constraints contradict each other.
        pivots: () int, iterations of the longest search.
    """

    sides: Float[Array, " m *b"]
    y: Float[Array, " m *b"]
    tableau: Float[Array, "m m *b"]
    solved: Bool[Array, "*b"]
    blocked: Bool[Array, "*b"]
    pivots: Int[Array, ""]


class _Tableau(NamedTuple):
    tableau: Array
    value: Array  # y of active rows, w of the others
    sides: Array


class _Search(NamedTuple):
    at: _Tableau
    entering: Array  # row on its way in, else m
    partial: Array  # its multiplier so far
    leaving: Array  # row on its way out, else m
    solved: Array
    blocked: Array
    pivots: Array


def _first(mask: Bool[Array, " m *b"], index: Int[Array, " m *b"]) -> Int[Array, "*b"]:
    return fold(jnp.minimum, jnp.where(mask, index, index.shape[0]))


def _pick(values: Array, row: Int[Array, "*b"]) -> Array:
    """Each problem's own row."""
    if row.ndim == 0:
        return values[row]
    where = row.reshape((1,) * (values.ndim - row.ndim) + row.shape)
    return jnp.take_along_axis(values, where, axis=0, mode="clip")[0]


def _sweep(tableau: Array, column: Array, pivot: Array, here: Array, swap: Array, drop: Array) -> Array:
    """Sweep the row `here` where `swap` says so; unsweep it where `drop` does.

    Row and column are cleared before one product writes them anew: nothing cancels, however large the pivot. Of a
    batch two rows at a time are changed where they stand; as one expression they would be copied first.
    """
    m = tableau.shape[0]
    at = here & swap
    keep = jnp.where(at, 0, 1).astype(tableau.dtype)
    edge = jnp.where(at, jnp.where(drop, 1, -1).astype(tableau.dtype), column)
    flux = jnp.where(swap, 1 / jnp.where(pivot == 0, 1, pivot), 0) * edge

    def change(tableau: Array, first: Array | int, count: int) -> Array:
        rows, kept, share = (jax.lax.dynamic_slice_in_dim(a, first, count) for a in (tableau, keep, flux))
        rows = rows * (kept[:, None] * keep[None]) - share[:, None] * edge[None]
        return jax.lax.dynamic_update_slice_in_dim(tableau, rows, first, 0)

    if tableau.ndim == 2 or m == 1:
        return change(tableau, 0, m)
    tableau = jax.lax.fori_loop(0, m // 2, lambda k, t: change(t, 2 * k, 2), tableau)
    return change(tableau, m - 1, 1) if m % 2 else tableau


def _start(
    at: _Tableau, low: Array, high: Array, wish: Array, least: Array, index: Array
) -> tuple[_Tableau, Int[Array, ""]]:
    """Sweep in the wished rows that do not depend on each other, whatever the signs of their multipliers become."""

    def enter(carry: tuple) -> tuple:
        (tableau, value, sides), wish, pivots = carry
        appeal = jnp.abs(wish)
        most = fold(jnp.maximum, appeal)
        row = _first(appeal == most, index)
        here = index == row
        column = _pick(tableau, row)
        pivot = _pick(column, row)
        upward = _pick(jnp.where(wish > 0, 1, 0), row) > 0
        bound = jnp.where(upward, _pick(high, row), _pick(low, row))
        swap = (most > 0) & (pivot >= least)
        move = jnp.where(swap, (_pick(value, row) - bound) / jnp.where(swap, pivot, 1), 0)
        value = jnp.where(here & swap, move, value - column * move)
        sides = jnp.where(here & swap, jnp.where(upward, 1, -1).astype(sides.dtype), sides)
        tableau = _sweep(tableau, column, pivot, here, swap, jnp.zeros_like(swap))
        return _Tableau(tableau, value, sides), jnp.where(here, 0, wish), pivots + 1

    carry = jax.lax.while_loop(lambda c: jnp.any(c[1] != 0), enter, (at, wish, jnp.asarray(0, jnp.int32)))
    return carry[0], carry[2]


def find_active_set(
    tableau: Float[Array, "m m *b"],
    value: Float[Array, " m *b"],
    sides: Float[Array, " m *b"],
    low: Float[Array, " m *b"],
    high: Float[Array, " m *b"],
    wish: Float[Array, " m *b"] | None,
    slack: Float[Array, "*b"],
    loose: Float[Array, "*b"],
    least: Float[Array, "*b"],
    still: Bool[Array, "*b"],
    limit: int,
) -> ActiveSet:
    """Search the active set of the optimum, from scratch or from where another search ended.

    Args:
        tableau: S, or as another search left it.
        value: w0, or y of the active rows and w of the others.
        sides: zeros, or as another search left it.
        low, high: bounds of w.
        wish: signs say which rows to start from and on which side, sizes in which order;
            None starts from `sides`.
        slack: violation that counts as none.
        loose: violation that counts as none in a row that depends on the active ones.
        least: Schur complements below this count as zero: the row depends on the active ones.
        still: problems to leave as they are.
        limit: most pivots.
    """
    m = value.shape[0]
    index = jnp.broadcast_to(jnp.arange(m).reshape((m,) + (1,) * (value.ndim - 1)), value.shape)
    equality = low == high
    dtype, batch = value.dtype, value.shape[1:]
    huge = jnp.finfo(dtype).max / 4

    def step(state: _Search) -> _Search:
        tableau, value, sides = state.at
        active = sides != 0
        running = ~(state.solved | state.blocked)

        # Which row: one that must leave, one with the wrong sign, one half in, the most violated.
        wrong = jnp.where(active & ~equality, -value * sides, 0)
        most_wrong = fold(jnp.maximum, wrong)
        outside = jnp.where(active, 0, jnp.maximum(value - high, low - value))
        most_outside = fold(jnp.maximum, outside)
        leave, fix, resume = state.leaving < m, most_wrong > 0, state.entering < m
        best = _first(jnp.where(fix, wrong == most_wrong, outside == most_outside), index)
        row = jnp.where(leave, state.leaving, jnp.where(fix | ~resume, best, state.entering))
        drop = leave | fix
        here = index == row
        column = _pick(tableau, row)
        pivot, own, top, bottom = (_pick(v, row) for v in (column, value, high, low))
        upward = jnp.where(drop, _pick(sides, row) > 0, own > top)
        bound = jnp.where(upward, top, bottom)

        # How far: to the bound (or the multiplier to zero), unless another multiplier gets to zero before.
        dependent = ~drop & (pivot < least)
        # What little a dependent row is violated by is rounding: the active rows already hold it.
        done = ~drop & ~resume & (most_outside <= jnp.where(dependent, loose, slack))
        full = jnp.where(drop, own, own - bound) / jnp.where(dependent, 1, pivot)
        sign = jnp.where(upward, 1, -1).astype(dtype)
        falling = column * sign * sides
        ratio = jnp.where(active & ~equality & (falling > 0), value * sides / jnp.where(falling > 0, falling, 1), huge)
        nearest = jnp.maximum(fold(jnp.minimum, ratio), 0)
        cut = ~drop & (nearest < jnp.where(dependent, huge, jnp.abs(full)))
        stuck = dependent & ~cut & ~done
        acting = running & ~done & ~stuck
        move = jnp.where(acting, jnp.where(cut, sign * nearest, full), 0)
        swap = acting & ~cut

        value = value - column * move
        entered = jnp.where(row == state.entering, state.partial, 0) + move
        value = jnp.where(here & swap, jnp.where(drop, bound - move, entered), value)
        blocker = _first((ratio <= nearest) & active, index)
        sides = jnp.where(here & swap, jnp.where(drop, 0, sign), sides)
        entering = jnp.where(drop, state.entering, jnp.where(cut, row, m))
        return _Search(
            _Tableau(_sweep(tableau, column, pivot, here, swap, drop), value, sides),
            jnp.where(acting, entering, state.entering),
            jnp.where(acting & ~drop, jnp.where(cut, entered, 0), state.partial),
            jnp.where(acting, jnp.where(cut, blocker, m), state.leaving),
            state.solved | (running & done),
            state.blocked | (running & stuck),
            state.pivots + 1,
        )

    at = _Tableau(tableau, value, sides)
    pivots = jnp.asarray(0, jnp.int32)
    if wish is not None:
        at, pivots = _start(at, low, high, wish, least, index)
    none = jnp.full(batch, m)
    state = _Search(at, none, jnp.zeros(batch, dtype), none, still, jnp.zeros(batch, bool), pivots)
    state = jax.lax.while_loop(lambda s: jnp.any(~(s.solved | s.blocked)) & (s.pivots < limit), step, state)
    y = jnp.where(state.at.sides != 0, state.at.value, 0)
    return ActiveSet(state.at.sides, y, state.at.tableau, state.solved, state.blocked, state.pivots)

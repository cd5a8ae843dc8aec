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

from iwalker_jax.optimization.qp_factor import fold


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

    sides: Float[Array, "m *b"]
    y: Float[Array, "m *b"]
    tableau: Float[Array, "m m *b"]
    solved: Bool[Array, "*b"]
    blocked: Bool[Array, "*b"]
    pivots: Int[Array, ""]


class _Search(NamedTuple):
    tableau: Array
    value: Array  # y of active rows, w of the others
    sides: Array
    wish: Array  # the rows to start from, signed, larger = earlier; 0 when dealt with
    entering: Array  # row on its way in, else m
    partial: Array  # its multiplier so far
    leaving: Array  # row on its way out, else m
    solved: Array
    blocked: Array
    pivots: Array


def _first(mask: Bool[Array, "m *b"], index: Int[Array, "m *b"]) -> Int[Array, "*b"]:
    return fold(jnp.minimum, jnp.where(mask, index, index.shape[0]))


def find_active_set(
    tableau: Float[Array, "m m *b"],
    value: Float[Array, "m *b"],
    sides: Float[Array, "m *b"],
    low: Float[Array, "m *b"],
    high: Float[Array, "m *b"],
    wish: Float[Array, "m *b"],
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
        wish: signs say which rows to start from and on which side, sizes in which order.
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
        tableau, value, sides, wish = state.tableau, state.value, state.sides, state.wish
        active = sides != 0
        running = ~(state.solved | state.blocked)

        # Which row: one that must leave, one of the start, one with the wrong sign, one half in, the most violated.
        appeal = jnp.abs(wish)
        most_wished = fold(jnp.maximum, appeal)
        wrong = jnp.where(active & ~equality, -value * sides, 0)
        most_wrong = fold(jnp.maximum, wrong)
        outside = jnp.where(active, 0, jnp.maximum(value - high, low - value))
        most_outside = fold(jnp.maximum, outside)
        leave, start = state.leaving < m, most_wished > 0
        fix, resume = most_wrong > 0, state.entering < m
        score = jnp.where(start, appeal, jnp.where(fix, wrong, outside))
        most = jnp.where(start, most_wished, jnp.where(fix, most_wrong, most_outside))
        best = _first(score == most, index)
        row = jnp.where(leave, state.leaving, jnp.where(start | fix | ~resume, best, state.entering))
        start &= ~leave
        drop = leave | (fix & ~start)
        at = index == row

        def pick(values: Array) -> Array:
            where = row.reshape((1,) * (values.ndim - row.ndim) + row.shape)
            return jnp.take_along_axis(values, where, axis=0, mode="clip")[0] if batch else values[row]

        column = pick(tableau)
        pivot, own, wished = pick(column), pick(value), pick(wish)
        top, bottom, side = pick(high), pick(low), pick(sides)
        begun = start & (top > bottom)
        upward = jnp.where(drop, side > 0, jnp.where(begun, wished > 0, own > top))
        bound = jnp.where(upward, top, bottom)

        # How far: to the bound (or the multiplier to zero), unless another multiplier gets to zero before.
        dependent = ~drop & (pivot < least)
        # What little a dependent row is violated by is rounding: the active rows already hold it.
        done = ~drop & ~start & ~resume & (most_outside <= jnp.where(dependent, loose, slack))
        full = jnp.where(drop, own, own - bound) / jnp.where(dependent, 1, pivot)
        sign = jnp.where(upward, 1, -1).astype(dtype)
        falling = column * sign * sides
        ratio = jnp.where(active & ~equality & (falling > 0), value * sides / jnp.where(falling > 0, falling, 1), huge)
        nearest = jnp.maximum(fold(jnp.minimum, ratio), 0)
        free_move = drop | start
        cut = ~free_move & (nearest < jnp.where(dependent, huge, jnp.abs(full)))
        stuck = dependent & ~free_move & ~cut & ~done
        rejected = dependent & start
        move = jnp.where(cut, sign * nearest, full)
        acting = running & ~done & ~stuck & ~rejected
        move = jnp.where(acting, move, 0)
        swap = acting & ~cut

        value = value - column * move
        entered = state.partial * (row == state.entering) + move
        value = jnp.where(at & swap, jnp.where(drop, bound - move, entered), value)
        blocker = _first((ratio <= nearest) & active, index)

        # Sweep (or, on the way out, unsweep) the row.
        cross = jnp.where(at & swap, 1, 0).astype(dtype)
        inverse = 1 / jnp.where(pivot == 0, 1, pivot)
        edge = jnp.where(at, -inverse / 2, jnp.where(drop, -inverse, inverse) * column)
        flux = jnp.where(swap, inverse, 0) * column
        flux = jnp.where(at & swap, 1, flux)
        swept = (tableau - flux[:, None] * column[None]) * (1 - cross[None])
        swept = swept + cross[:, None] * edge[None] + edge[:, None] * cross[None]
        new_side = jnp.where(drop, 0, sign)
        entering = jnp.where(drop | start, state.entering, jnp.where(cut, row, m))
        return _Search(
            swept,
            value,
            jnp.where(at & swap, new_side, sides),
            jnp.where(at & (swap | rejected) & running, 0, wish),
            jnp.where(acting, entering, state.entering),
            jnp.where(acting & cut, entered, jnp.where(acting & ~free_move, 0, state.partial)),
            jnp.where(acting, jnp.where(cut, blocker, m), state.leaving),
            state.solved | (running & done),
            state.blocked | (running & stuck),
            state.pivots + 1,
        )

    none = jnp.full(batch, m)
    no = jnp.zeros(batch, bool)
    state = _Search(
        tableau, value, sides, wish, none, jnp.zeros(batch, dtype), none, still, no, jnp.asarray(0, jnp.int32)
    )
    state = jax.lax.while_loop(lambda s: jnp.any(~(s.solved | s.blocked)) & (s.pivots < limit), step, state)
    y = jnp.where(state.sides != 0, state.value, 0)
    return ActiveSet(state.sides, y, state.tableau, state.solved, state.blocked, state.pivots)

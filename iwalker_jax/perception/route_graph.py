"""The 16-neighbour graph of `cost_to_go`, and how the costs of its best routes change with what the edges cost.

Notation: V_i is the cost of the best route from cell i, s_i what i pays if it stands for the goal (else infinite),
w_ij the cost of the edge from i to j, linear in the traversal cost c. At a converged field V is the fixed point

    V_i = min( s_i, min_j w_ij(c) + V_j ).

Where one j is best, the implicit function theorem leaves dV_i = dw_ij(c) + dV_j: the sum of the edges' changes along
the best route. As j is nearer to the goal than i, the routes form a tree, and the sums over all of them follow from
doubling: after k rounds, 2^k edges of each route are summed. No sweep is repeated and none is kept.
"""

import math
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

MOVES = tuple((a, b) for a in range(-2, 3) for b in range(-2, 3) if abs(a) + abs(b) == 3 or max(abs(a), abs(b)) == 1)
"""(rows, columns) from a cell to its neighbours: king's and knight's moves."""


def beside(a: int, b: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """The two other cells that a step by (a, b) touches; of a straight step, its ends."""
    if abs(a) == 2:
        return (a // 2, 0), (a // 2, b)
    if abs(b) == 2:
        return (0, b // 2), (a, b // 2)
    return (a, 0), (0, b)


_LENGTHS = np.array([math.hypot(a, b) for a, b in MOVES])
_TOUCHED = np.array([((0, 0), (a, b), *beside(a, b)) for a, b in MOVES])


class _Edges(NamedTuple):
    """The best edge out of every cell of a map with n cells, by row-major index.

    Attributes:
        next_cell: (n + 1,) the cell that it leads to; n where no edge is on a route (the goal, cells without a route)
            and for n itself.
        touched: (n, 4) the cells whose mean cost it pays.
        length: (n,) [m]; 0 where there is none.
    """

    next_cell: Int[Array, " next_cells"]
    touched: Int[Array, "cells 4"]
    length: Float[Array, " cells"]


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def along_routes(
    values: Float[Array, "rows columns"],
    seed: Float[Array, "rows columns"],
    cost: Float[Array, "rows columns"],
    resolution: float,
) -> Float[Array, "rows columns"]:
    """The values themselves, as a function of the seed and the traversal cost by the implicit function theorem.

    Args:
        values: V of the module's docstring, solved; infinite where there is no route.
        seed: s.
        cost: c; infinite where blocked.
        resolution: [m] side of a cell.
    """
    return values


@along_routes.defjvp
def _along_routes_jvp(
    resolution: float, primals: tuple[Array, Array, Array], tangents: tuple[Array, Array, Array]
) -> tuple[Array, Array]:
    values, seed, cost = primals
    _, seed_change, cost_change = tangents
    edges = _best_edges(*lax.stop_gradient((values, seed, cost)), resolution)
    change = edges.length * jnp.mean(cost_change.ravel()[edges.touched], axis=-1)
    change = change + jnp.where(_ends_here(values, seed), seed_change, 0.0).ravel()
    return values, _sum_along(edges.next_cell, change).reshape(values.shape)


def _best_edges(
    values: Float[Array, "rows columns"],
    seed: Float[Array, "rows columns"],
    cost: Float[Array, "rows columns"],
    resolution: float,
) -> _Edges:
    """Of every cell the edge that attains its value; the first of `MOVES` among several.

    Only cells of strictly lower value are led to: whatever rounding does, no edges form a circle.
    """
    rows, columns = values.shape
    wide_values, wide_cost = (jnp.pad(x, 2, constant_values=jnp.inf) for x in (values, cost))

    def moved(x: Float[Array, "wide_rows wide_columns"], by: tuple[int, int]) -> Float[Array, "rows columns"]:
        return x[2 + by[0] : 2 + by[0] + rows, 2 + by[1] : 2 + by[1] + columns]

    least, best = jnp.full(values.shape, jnp.inf, values.dtype), jnp.zeros(values.shape, jnp.int32)
    for k, move in enumerate(MOVES):
        there = moved(wide_values, move)
        paid = (resolution * _LENGTHS[k] / 4) * sum(moved(wide_cost, (int(a), int(b))) for a, b in _TOUCHED[k])
        through = jnp.where(there < values, there + paid, jnp.inf)
        best = jnp.where(through < least, k, best)
        least = jnp.minimum(through, least)

    on_route = jnp.isfinite(least) & jnp.isfinite(values) & ~_ends_here(values, seed)
    cells, best, on_route = values.size, best.ravel(), on_route.ravel()
    index = jnp.arange(cells)
    steps = jnp.asarray(_TOUCHED @ np.array([columns, 1]), index.dtype)[best]
    touched = jnp.where(on_route[:, None], index[:, None] + steps, index[:, None])
    next_cell = jnp.append(jnp.where(on_route, index + steps[:, 1], cells), cells)
    return _Edges(next_cell, touched, jnp.where(on_route, jnp.asarray(resolution * _LENGTHS, values.dtype)[best], 0.0))


def _ends_here(values: Float[Array, "rows columns"], seed: Float[Array, "rows columns"]) -> Bool[Array, "rows columns"]:
    """Where the best route ends: in a cell that stands for the goal and from which no other is cheaper to reach."""
    return jnp.isfinite(seed) & (seed <= values)


def _sum_along(next_cell: Int[Array, " next_cells"], change: Float[Array, " cells"]) -> Float[Array, " cells"]:
    """Sum of `change` over all cells of the route from each cell; linear in it, so that JAX can transpose it."""
    rounds = max(1, math.ceil(math.log2(next_cell.size)))
    _, jumps = lax.scan(lambda jump, _: (jump[jump], jump), next_cell, None, length=rounds)
    total, _ = lax.scan(lambda total, jump: (total + total[jump], None), jnp.append(change, 0.0), jumps)
    return total[:-1]

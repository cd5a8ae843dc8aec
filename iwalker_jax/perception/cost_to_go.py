"""Geodesic cost-to-go: what it costs to walk from every cell of a map to a goal, around what blocks the way.

The graph has 16 neighbours a cell (king's and knight's moves: lengths are at most 2.8 % above Euclid's), and an edge
costs its length times the mean traversal cost of the cells it touches: two for a straight step, the surrounding four
for a diagonal or a knight's step. One blocked cell among them removes the edge, so no step cuts a corner.

Shortest paths are found by line sweeps: front after front in each of the four directions, every cell takes the best
of the five edges that arrive from the two lines before it. A round of four sweeps carries a wave along any stretch
of path that keeps its heading within a quarter turn, so the number of rounds is the number of bends, not of cells.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.arrays import as_floats
from iwalker_jax.checks import Scalar
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import safe_norm
from iwalker_jax.optimization import Solution, Status
from iwalker_jax.perception.grid import GridSpec
from iwalker_jax.perception.route_graph import MOVES, along_routes, beside
from iwalker_jax.runtime.reading import printable

UNREACHABLE = 1e6
"""Cost of cells that are blocked or cut off from the goal; also the traversal cost from which a cell is blocked."""

_FARTHEST = 1e18
"""[m] of a goal that a distance is taken to."""

_BATCH = 16
"""Maps relaxed together: enough to fill vector registers, few enough to stay in the cache."""


class CostToGo(NamedTuple):
    """Cost-to-go and the goal it leads to.

    Attributes:
        cost: (rows, columns) traversal cost integrated along the best route; `UNREACHABLE` where there is none.
        goal: (2,) [m] centre of the free cell nearest to the goal asked for, which stands for it.
        goal_offset: () [m] distance between that centre and the goal asked for; more than a cell's half diagonal
            says that the goal was blocked or outside the map. `UNREACHABLE` if it is not finite.
    """

    cost: Float[Array, "rows columns"]
    goal: Float[Array, "2"]
    goal_offset: Float[Array, ""]


def cost_to_go(
    traversal_cost: Float[Array, "rows columns"],
    goal_xy: Float[Array, "2"],
    grid: GridSpec,
    max_rounds: int | None = None,
    outside_cost: Scalar | None = None,
) -> Solution:
    """Cost of the best route from every cell centre to a goal, on the 16-neighbour graph of the module's docstring.

    A goal that is blocked or outside the map is replaced by the nearest free cell, and every route also pays the
    straight line from that cell's centre to the goal at that cell's cost (so does a goal off its cell's centre). With
    an `outside_cost`, a goal outside the map is instead reached over its border: each free cell of the border stands
    for it and pays the straight line at that cost, so that a blocked stretch of the border, or a pocket behind an
    obstacle there, cuts nobody off from a goal farther on.

    Args:
        traversal_cost: cost per metre, positive; infinite or >= `UNREACHABLE` means blocked.
        goal_xy: goal [m] in base.
        grid: where the cells lie.
        max_rounds: limit on rounds of four sweeps; a bend of the route costs about one. By default as many as the map
            has cells, which always suffice: every round gets each best route right by at least one more cell.
        outside_cost: cost per metre of the ground outside the map, positive.

    Returns:
        Solution with a `CostToGo`. Status: CONVERGED; MAX_ITERATIONS if the last round still lowered a cost (costs
        are then upper bounds, and cells not reached yet are marked `UNREACHABLE`); INFEASIBLE if no cell is free;
        NON_FINITE if the goal is not finite, a cost is NaN or not positive (such cells count as blocked), or a route
        costs `UNREACHABLE` or more (give costs in a larger unit). `trusted_cost` takes all that into account. The
        residual is the largest decrease in the last round, relative to the largest finite cost. `gradient_valid` is
        True where the status is CONVERGED.

    Derivatives are implicit, in forward and reverse mode: nothing is unrolled, and a derivative costs less than a round
    of sweeps (`route_graph`). A cell's cost feels the traversal cost of the cells along its best route, and no others;
    cells marked `UNREACHABLE` feel nothing. The cost is continuous and concave in the traversal cost; its derivative
    jumps where another route becomes the best one, and of routes that cost the same one is taken (so in open, even
    ground, where many do). In the goal it is the derivative of the straight line from the cell's centre to the goal,
    zero in the centre itself; where another cell becomes the one nearest to the goal, the cost itself jumps, by up to
    the price of a cell. For a slope over more than a cell take the field of the start, sampled at the goal: routes
    cost the same both ways.

    Raises:
        InputError: if the map's shape is not the grid's, `max_rounds` is not positive, or what is given are no real
            numbers.
    """
    traversal_cost, goal_xy = as_floats(traversal_cost, "The map of costs"), as_floats(goal_xy, "The goal")
    max_rounds = traversal_cost.size if max_rounds is None else max_rounds
    if not isinstance(grid, GridSpec) or goal_xy.shape != (2,) or not isinstance(max_rounds, (int, np.integer)):
        raise InputError(
            f"cost_to_go needs a GridSpec, a goal of shape (2,) and a whole number of rounds, got a "
            f"{type(grid).__name__}, {goal_xy.shape} and {printable(max_rounds)}."
        )
    if traversal_cost.shape != grid.shape or max_rounds < 1:
        raise InputError(
            f"cost_to_go needs a map of the grid's shape {grid.shape} and max_rounds >= 1, "
            f"got {traversal_cost.shape} and {max_rounds}."
        )
    free = (traversal_cost > 0) & (traversal_cost < UNREACHABLE)
    cost = jnp.where(free, traversal_cost, jnp.inf)
    goal_xy = goal_xy.astype(cost.dtype)
    seed, goal, offset = _seed(cost, free, goal_xy, grid)
    if outside_cost is not None:
        seed = jnp.where(_is_outside(goal_xy, grid), _border_seed(free, goal_xy, grid, outside_cost), seed)

    values, decrease, rounds = _relaxation(grid.resolution, max_rounds)(*lax.stop_gradient((seed, cost)))

    finite = jnp.isfinite(values)
    largest = jnp.max(jnp.where(finite, values, 0.0))
    residual = decrease / jnp.where(largest > 0, largest, 1.0)
    bad = jnp.any(~(traversal_cost > 0)) | ~_is_known_goal(goal_xy) | (largest >= UNREACHABLE)
    status = jnp.where(decrease > 0, Status.MAX_ITERATIONS, Status.CONVERGED)
    status = jnp.where(jnp.any(free), status, Status.INFEASIBLE)
    status = jnp.where(bad, Status.NON_FINITE, status).astype(jnp.int32)
    reachable = values < UNREACHABLE
    value = jnp.where(reachable, along_routes(values, seed, cost, grid.resolution), UNREACHABLE)
    solved, unmeasured = status == Status.CONVERGED, jnp.zeros_like(residual)
    return Solution(CostToGo(value, goal, offset), status, residual, rounds, solved, unmeasured)


def trusted_cost(solution: Solution) -> Float[Array, "*batch rows columns"]:
    """The costs of a `cost_to_go` that converged; of any other no route is claimed: `UNREACHABLE` everywhere."""
    converged = (solution.status == Status.CONVERGED)[..., None, None]
    return jnp.where(converged, solution.value.cost, UNREACHABLE)


def descend(
    cost: Float[Array, "rows columns"], grid: GridSpec, start_xy: Float[Array, "2"], n: int
) -> Float[Array, "n 2"]:
    """Route down a cost-to-go: from the start's cell always to the neighbour (of 16) with the steepest descent.

    Steps only along the edges of `cost_to_go`'s graph, so the route enters no blocked cell and cuts no corner; the
    cost decreases strictly until the goal, where the route stays.

    Args:
        cost: `CostToGo.cost`.
        grid: where the cells lie.
        start_xy: start [m] in base; the nearest cell from which the goal can be reached stands for it.
        n: number of points; shorter than the route means that it ends on the way.

    Returns:
        Cell centres [m] in base. If no cell reaches the goal, the start's own cell, repeated.
    """
    moves = jnp.asarray(MOVES)
    lengths = jnp.linalg.norm(moves.astype(cost.dtype), axis=-1)
    reachable = cost < UNREACHABLE
    squared = jnp.sum((grid.centres().astype(cost.dtype) - start_xy) ** 2, axis=-1)
    distance = jnp.where(reachable | ~jnp.any(reachable), squared, jnp.inf)
    start = jnp.stack(jnp.unravel_index(jnp.argmin(distance), cost.shape))
    padded = jnp.pad(jnp.where(reachable, cost, jnp.inf), 2, constant_values=jnp.inf)

    def step(cell: Array, _: None) -> tuple[Array, Array]:
        window = lax.dynamic_slice(padded, (cell[0], cell[1]), (5, 5))
        slope = jnp.where(_open_edges(window), (window[2, 2] - window[moves[:, 0] + 2, moves[:, 1] + 2]) / lengths, 0.0)
        best = jnp.argmax(slope)
        return jnp.where(slope[best] > 0, cell + moves[best], cell), cell

    _, cells = lax.scan(step, start, None, length=n)
    return grid.centres()[cells[:, 0], cells[:, 1]]


def _open_edges(window: Float[Array, "5 5"]) -> Bool[Array, "16"]:
    """Which of the 16 edges out of the middle of a 5 x 5 window touch finite cells only."""
    finite = jnp.isfinite(window)
    return jnp.stack([finite[2 + a, 2 + b] & _both(finite, beside(a, b)) for a, b in MOVES])


def _both(window: Bool[Array, "5 5"], cells: tuple[tuple[int, int], tuple[int, int]]) -> Bool[Array, ""]:
    (a, b), (c, d) = cells
    return window[2 + a, 2 + b] & window[2 + c, 2 + d]


def _is_known_goal(goal_xy: Float[Array, "2"]) -> Bool[Array, ""]:
    """Whether a goal is finite, and so are the squares of its distances."""
    return jnp.all(jnp.abs(goal_xy) <= _FARTHEST)


def _seed(
    cost: Float[Array, "rows columns"],
    free: Bool[Array, "rows columns"],
    goal_xy: Float[Array, "2"],
    grid: GridSpec,
) -> tuple[Float[Array, "rows columns"], Float[Array, "2"], Float[Array, ""]]:
    """Infinite everywhere but in the free cell nearest to the goal, which pays the straight line to it."""
    centres = grid.centres().astype(cost.dtype)
    squared = jnp.where(free, jnp.sum((centres - goal_xy) ** 2, axis=-1), jnp.inf)
    index = jnp.argmin(squared)
    goal = centres.reshape(-1, 2)[index]
    known = _is_known_goal(goal_xy)
    offset = jnp.where(known, safe_norm(jnp.where(known, goal - goal_xy, 0.0)), UNREACHABLE)
    usable = known & jnp.isfinite(cost.reshape(-1)[index])
    # Selected before they are multiplied: an infinite factor would make NaN of a derivative that is masked afterwards.
    first = jnp.where(usable, offset, 1.0) * jnp.where(usable, cost.reshape(-1)[index], 1.0)
    seed = jnp.full(cost.size, jnp.inf, cost.dtype).at[index].set(jnp.where(usable, first, jnp.inf))
    return seed.reshape(cost.shape), goal, offset


def _is_outside(goal_xy: Float[Array, "2"], grid: GridSpec) -> Bool[Array, ""]:
    """Whether a goal lies off the map."""
    lower, upper = jnp.asarray([grid.x_min, grid.y_min]), jnp.asarray([grid.x_max, grid.y_max])
    return jnp.any((goal_xy < lower) | (goal_xy > upper))


def _border_seed(
    free: Bool[Array, "rows columns"], goal_xy: Float[Array, "2"], grid: GridSpec, outside_cost: Scalar
) -> Float[Array, "rows columns"]:
    """Infinite everywhere but in the free cells of the border, which pay the straight line to the goal."""
    border = np.ones(grid.shape, bool)
    border[1:-1, 1:-1] = False
    known = _is_known_goal(goal_xy)
    ways = safe_norm(jnp.where(known, grid.centres().astype(goal_xy.dtype) - goal_xy, 0.0))
    return jnp.where(border & free & known, outside_cost * ways, jnp.inf)


def _relaxation(resolution: float, max_rounds: int) -> Callable[[Array, Array], tuple[Array, Array, Array]]:
    """Solver from (seed, cost) of one map to its values, the last round's largest decrease and the rounds used."""

    @custom_vmap
    def relax(seed: Float[Array, "rows columns"], cost: Float[Array, "rows columns"]) -> tuple[Array, Array, Array]:
        return jax.tree.map(lambda x: x[0], _relax_batch(seed[None], cost[None], resolution, max_rounds))

    @relax.def_vmap
    def relax_many(size: int, batched: list[bool], seed: Array, cost: Array) -> tuple[tuple, tuple]:
        seed, cost = (x if b else jnp.broadcast_to(x, (size, *x.shape)) for x, b in zip((seed, cost), batched))
        if seed.ndim > 3 or size > _BATCH:
            solved = lax.map(lambda maps: relax(*maps), (seed, cost), batch_size=_BATCH)
        else:
            solved = _relax_batch(seed, cost, resolution, max_rounds)
        return solved, (True, True, True)

    return relax


def _relax_batch(
    seed: Float[Array, "maps rows columns"],
    cost: Float[Array, "maps rows columns"],
    resolution: float,
    max_rounds: int,
) -> tuple[Float[Array, "maps rows columns"], Float[Array, " maps"], Int[Array, " maps"]]:
    """Rounds of sweeps until no value changes in any map.

    Works on (rows, columns, maps) with two infinite cells around: the maps are contiguous, so that sweeps along rows
    and along columns are equally fast without transposing anything.
    """

    def widen(x: Float[Array, "maps rows columns"]) -> Float[Array, "wide_rows wide_columns maps"]:
        return jnp.pad(jnp.moveaxis(x, 0, -1), ((2, 2), (2, 2), (0, 0)), constant_values=jnp.inf)

    wide_cost = widen(cost)

    def sweep_round(carry: tuple) -> tuple:
        before, decrease, rounds = carry
        rounds = rounds + (decrease > 0)
        after = before
        for axis in (0, 1):
            for direction in (1, -1):
                after = _sweep(after, wide_cost, resolution, axis, direction)
        lowered = jnp.where(after < before, jnp.where(jnp.isinf(before), after, before - after), 0.0)
        return after, jnp.max(lowered, axis=(0, 1)), rounds

    maps = seed.shape[0]
    start = (widen(seed), jnp.full(maps, jnp.inf, seed.dtype), jnp.zeros(maps, jnp.int32))
    values, decrease, rounds = lax.while_loop(
        lambda c: jnp.any(c[1] > 0) & (jnp.max(c[2]) < max_rounds), sweep_round, start
    )
    return jnp.moveaxis(values[2:-2, 2:-2], -1, 0), decrease, rounds


def _sweep(
    values: Float[Array, "wide_rows wide_columns maps"],
    cost: Float[Array, "wide_rows wide_columns maps"],
    resolution: float,
    axis: int,
    direction: int,
) -> Float[Array, "wide_rows wide_columns maps"]:
    """Lower every line by the edges from the two lines before it, line by line along an axis, in place."""
    lines, cells, maps = values.shape[axis] - 4, values.shape[1 - axis] - 4, values.shape[2]
    straight, diagonal, knight = resolution / 2, resolution * 2**0.5 / 4, resolution * 5**0.5 / 4

    def line(n: Int[Array, ""], values: Array) -> Array:
        here = 2 + n if direction > 0 else lines + 1 - n
        before, two_before = here - direction, here - 2 * direction

        def take(x: Array, index: Int[Array, ""], aside: int) -> Float[Array, "a b maps"]:
            start, size = ((index, 2 + aside), (1, cells)) if axis == 0 else ((2 + aside, index), (cells, 1))
            return lax.dynamic_slice(x, (*start, 0), (*size, maps))

        cost_here, cost_before = take(cost, here, 0), take(cost, before, 0)
        pair = cost_here + cost_before
        best = _lower(take(values, here, 0), take(values, before, 0) + straight * pair)
        for aside in (-1, 1):
            cost_beside = take(cost, before, aside)
            four = pair + cost_beside + take(cost, here, aside)
            best = _lower(best, take(values, before, aside) + diagonal * four)
            four = pair + cost_beside + take(cost, two_before, aside)
            best = _lower(best, take(values, two_before, aside) + knight * four)
        return lax.dynamic_update_slice(values, best, (here, 2, 0) if axis == 0 else (2, here, 0))

    return lax.fori_loop(0, lines, line, values)


def _lower(a: Float[Array, "*shape"], b: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Minimum without the NaN handling of jnp.minimum, a third of a sweep's time; nothing here can be NaN."""
    return jnp.where(b < a, b, a)

"""The best route on a map towards a goal, as far as the map shows it: what a planner could know from what was seen."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.checks import Scalar
from iwalker_jax.geometry import arc_length, interpolate_along, resample_by_arc_length
from iwalker_jax.perception.cost_to_go import descend
from iwalker_jax.perception.grid import DEFAULT_GRID, GridSpec, halved
from iwalker_jax.perception.map_sampling import sample_bilinear

ROUTE_GRID = halved(DEFAULT_GRID)
"""10 cm cells are fine enough for routes; clearance itself is sampled from the 5 cm distance field."""

ROUTE_POINTS = 50
"""Points of a route."""
_SMOOTHING_PASSES = 6


class Routes(NamedTuple):
    """Evenly spaced points [m] from the start.

    Attributes:
        seen: to the goal, or to where the route would enter unseen space, or to the edge of the map.
        whole: to the goal or the edge of the map, whether it was seen or not.
    """

    seen: Float[Array, "points 2"]
    whole: Float[Array, "points 2"]


def best_routes(
    to_go: Float[Array, "rows columns"],
    unknown: Float[Array, "rows columns"],
    goal: Float[Array, " 2"],
    start: Float[Array, " 2"] | None = None,
    grid: GridSpec = ROUTE_GRID,
    longest: Scalar = np.inf,
) -> Routes:
    """The best route from the robot towards a goal.

    Args:
        to_go: cost-to-go on the grid.
        unknown: degree of being unseen on the grid.
        goal: [m] in the grid's frame, as the start, which is the origin if left out.
        grid: where the cells lie.
        longest: [m] to which both are cut.
    """
    start = jnp.zeros(2, to_go.dtype) if start is None else start
    cells = descend(to_go, grid, start, 2 * max(grid.shape))
    last = cells[-1]
    arrived = jnp.sum((last - goal) ** 2) < grid.resolution**2
    way = jnp.concatenate([start[None], cells[1:], jnp.where(arrived, goal, last)[None]])
    seen = jnp.cumprod(sample_bilinear(unknown, grid, way, outside="clamp") < 0.5).astype(bool)
    end = way[jnp.maximum(jnp.sum(seen) - 1, 0)]
    return Routes(_smoothed(jnp.where(seen[:, None], way, end), longest), _smoothed(way, longest))


def _smoothed(way: Float[Array, "n 2"], longest: Scalar) -> Float[Array, "points 2"]:
    # The grid allows sixteen headings; a moving average of half a metre takes its corners off.
    lengths = arc_length(way)
    even = jnp.linspace(0.0, 1.0, ROUTE_POINTS, dtype=way.dtype) * jnp.minimum(lengths[-1], longest)
    even = interpolate_along(lengths, way, even)
    for _ in range(_SMOOTHING_PASSES):
        middle = 0.25 * even[:-2] + 0.5 * even[1:-1] + 0.25 * even[2:]
        even = jnp.concatenate([even[:1], middle, even[-1:]])
    return resample_by_arc_length(even, ROUTE_POINTS)

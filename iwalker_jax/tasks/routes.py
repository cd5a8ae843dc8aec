"""Ground-truth routes of tasks: whether a goal can be walked to, how long the way is and how long it may take."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.geometry.host import polyline_length
from iwalker_jax.perception import UNREACHABLE, descend
from iwalker_jax.scenes import Scene, SceneArrays, obstacle_distance, scene_grid
from iwalker_jax.scenes.routes import DEFAULT_ROUTE_PARAMETERS, cost_at, route_map

PACE = 0.25
"""[m/s] at which time limits assume a robot to walk."""

_TIME_FACTOR, _TIME_EXTRA = 4.0, 20.0


def time_limit(length: float) -> float:
    """[s] allowed for a route of a length [m]: four times the walk at `PACE`, and some to start, turn and stand."""
    return _TIME_FACTOR * length / PACE + _TIME_EXTRA


def single_precision(scene: Scene) -> SceneArrays:
    """A scene's arrays in single precision whatever JAX's mode, so that a seed gives the same task everywhere."""
    return jax.tree.map(lambda leaf: leaf.astype(jnp.float32), scene.arrays())


def comfortable_route(
    scene: SceneArrays, start: Float[np.ndarray, " 2"], goal: Float[np.ndarray, " 2"]
) -> Float[np.ndarray, "n 2"] | None:
    """The comfortable route [m, world] between two points by `DEFAULT_ROUTE_PARAMETERS`; None without one.

    Args:
        scene: one scene in single precision.
        start, goal: [m, world].
    """
    ends = np.asarray([start, goal], np.float32)
    inside = (ends > np.asarray(scene.bounds[:2])) & (ends < np.asarray(scene.bounds[2:]))
    if not inside.all() or clearances(scene, ends).min() <= DEFAULT_ROUTE_PARAMETERS.inflated_radius:
        return None
    cost, way = _route(scene, jnp.asarray(ends[0]), jnp.asarray(ends[1]))
    if float(cost) >= UNREACHABLE:
        return None
    way = np.asarray(way, np.float64)
    moving = np.append(np.any(np.diff(way, axis=0) != 0, axis=1), True)
    # The cells of both ends stand for the ends themselves.
    return np.concatenate([ends[:1], way[moving][1:-1], ends[1:]]).astype(np.float64)


def leg_lengths(scene: SceneArrays, stops: Float[np.ndarray, "n 2"]) -> list[float | None]:
    """Length [m] of the comfortable route from each stop to the next; None where there is none."""
    routes = [comfortable_route(scene, here, there) for here, there in pairwise(stops)]
    return [None if route is None else polyline_length(route) for route in routes]


def clearances(scene: SceneArrays, points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
    """Plan-view distances [m] of points [m, world] to the nearest obstacle in the body's height band."""
    return np.asarray(_clearance(scene, jnp.asarray(points, jnp.float32)))


_clearance = jax.jit(obstacle_distance)


@jax.jit
def _route(
    scene: SceneArrays, start: Float[Array, " 2"], goal: Float[Array, " 2"]
) -> tuple[Float[Array, ""], Float[Array, "n 2"]]:
    routes, grid = route_map(scene, goal), scene_grid(scene)
    way = descend(routes.cost, grid, start - routes.origin, 2 * max(grid.shape)) + routes.origin
    return cost_at(routes, start), way

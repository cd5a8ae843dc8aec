"""Routes through a scene's ground truth: which goals a walking body can really reach, and along which way."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY
from iwalker_jax.perception import UNREACHABLE, cost_to_go, trusted_cost
from iwalker_jax.scenes.grid_distance import distance_up_to, inside_bounds, occupancy, scene_grid, scene_grid_of
from iwalker_jax.scenes.scene import SceneArrays, obstacle_distance


@dataclass(frozen=True)
class RouteParameters:
    """What counts as a walkable route.

    Attributes:
        inflated_radius: [m] footprint radius with margin; cells nearer than this to an obstacle are blocked.
        comfort: [m] clearance below which a cell costs more than its length.
        discomfort: extra cost per metre at zero clearance beyond the inflated radius.
    """

    inflated_radius: float = BODY.route_radius
    comfort: float = 0.45
    discomfort: float = 2.0

    def __post_init__(self) -> None:
        if not 0 < self.inflated_radius < self.comfort or self.discomfort < 0:
            raise InputError("RouteParameters needs 0 < inflated_radius < comfort and discomfort >= 0.")


DEFAULT_ROUTE_PARAMETERS = RouteParameters()


class RouteMap(NamedTuple):
    """Ground truth of one scene for one goal, on its `scene_grid`.

    Attributes:
        free: (rows, columns) cells where the inflated footprint fits.
        cost: (rows, columns) cost of the best comfortable route to the goal; `UNREACHABLE` where there is none.
        origin: (2,) [m] world position of the grid's lower corner.
    """

    free: Bool[Array, "rows columns"]
    cost: Float[Array, "rows columns"]
    origin: Float[Array, " 2"]


def free_cells(
    scene: SceneArrays, parameters: RouteParameters = DEFAULT_ROUTE_PARAMETERS
) -> Bool[Array, "rows columns"]:
    """Cells of `scene_grid` where the inflated footprint fits."""
    grid = scene_grid(scene)
    return ~occupancy(scene, scene.bounds[:2], grid.resolution, grid.shape, parameters.inflated_radius)


def route_map(
    scene: SceneArrays, goal_xy: Float[Array, " 2"], parameters: RouteParameters = DEFAULT_ROUTE_PARAMETERS
) -> RouteMap:
    """Cost of the best comfortable route to a goal [m, world] from everywhere in the scene."""
    origin, grid = scene.bounds[:2], scene_grid(scene)
    points = grid.centres() + origin
    clearance = distance_up_to(scene, points, parameters.comfort)
    free = inside_bounds(scene, points) & (clearance > parameters.inflated_radius)
    tightness = jnp.clip((parameters.comfort - clearance) / (parameters.comfort - parameters.inflated_radius), 0.0, 1.0)
    traversal = jnp.where(free, 1.0 + parameters.discomfort * tightness**2, jnp.inf)
    solution = cost_to_go(traversal, goal_xy - origin, grid)
    return RouteMap(free, trusted_cost(solution), origin)


def shortest_distance(
    scene: SceneArrays, goal_xy: Float[Array, " 2"], parameters: RouteParameters = DEFAULT_ROUTE_PARAMETERS
) -> RouteMap:
    """Like `route_map`, with length [m] as the only cost: the yardstick of progress and path efficiency."""
    return route_map(scene, goal_xy, replace(parameters, discomfort=0.0))


def cost_at(routes: RouteMap, points_xy: Float[Array, "*batch 2"]) -> Float[Array, "*batch"]:
    """Cost to the goal at world points [m]: the best of the neighbouring cells plus the way there.

    Interpolation would mix reachable with unreachable cells beside a wall; `UNREACHABLE` only if all nine are.
    """
    grid = scene_grid_of(routes.cost.shape[0])
    cell = jnp.round(grid.cell_coordinates(points_xy - routes.origin)).astype(jnp.int32)
    offsets = jnp.asarray([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    around = cell[..., None, :] + offsets
    limits = jnp.asarray(grid.shape) - 1
    inside = ((around >= 0) & (around <= limits)).all(axis=-1)
    around = jnp.clip(around, 0, limits)
    centres = (around + 0.5) * grid.resolution + routes.origin
    way = jnp.sqrt(jnp.sum((centres - points_xy[..., None, :]) ** 2, axis=-1))
    cost = jnp.where(inside, routes.cost[around[..., 0], around[..., 1]], UNREACHABLE)
    return jnp.minimum(jnp.min(cost + way, axis=-1), UNREACHABLE)


def straight_line_clearance(
    scene: SceneArrays, start_xy: Float[Array, " 2"], goal_xy: Float[Array, " 2"], samples: int = 64
) -> Float[Array, ""]:
    """Smallest obstacle distance [m] on the straight line between two world points."""
    fractions = jnp.linspace(0.0, 1.0, samples)[:, None]
    return jnp.min(obstacle_distance(scene, start_xy + fractions * (goal_xy - start_xy)))

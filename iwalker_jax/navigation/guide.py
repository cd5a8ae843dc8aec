"""Which way to go: from what was seen to a path in the world, by the networks, the classical planner, or both."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Bool, Float

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY, arc_length, interpolate_along, resample_by_arc_length, to_base, to_world
from iwalker_jax.navigation.map_memory import MapMemory, MapMemoryParameters, remember, remembered, window_origin
from iwalker_jax.navigation.path_band import BAND_POINTS, BandParameters, safe_path
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.perception.collision_map import DEFAULT_RULES
from iwalker_jax.perception.cost_to_go import UNREACHABLE, cost_to_go
from iwalker_jax.perception.depth_cleanup import clean_depth
from iwalker_jax.perception.distance_field import signed_distance_field
from iwalker_jax.perception.grid import DEFAULT_GRID, GridSpec, halved, pool_2x2, softened
from iwalker_jax.perception.local_map import free_and_occupied
from iwalker_jax.perception.seen_route import best_routes
from iwalker_jax.perception.traversal import TraversalParameters, traversal_cost
from iwalker_jax.planning.planner import Planner

PathSource = Literal["network", "guided", "route"]

_AROUND = 0.3  # [m] about the robot, within which a way must begin


@dataclass(frozen=True)
class GuidanceParameters:
    """How a path comes about.

    Attributes:
        source: `network` asks iPath alone and takes its path as it is; `guided` asks iPath for a way to the next way
            point of the route, `route` takes the route itself, the cheapest way to the goal on the remembered map; both
            are drawn off the remembered obstacles and cut before a collision.
        ahead: [m] along the route to the way point that iPath gets.
        headway: share of the cost to that point that iPath's path must take off the cost-to-go; else the route is used.
        memory, band_parameters, traversal: their numbers; routes keep the sway of the gait off obstacles as well as the
            body.
    """

    source: PathSource = "guided"
    ahead: float = 1.6
    headway: float = 0.3
    memory: MapMemoryParameters = MapMemoryParameters()
    band_parameters: BandParameters = BandParameters()
    traversal: TraversalParameters = TraversalParameters(body_radius=BODY.route_radius)

    def __post_init__(self) -> None:
        if self.source not in get_args(PathSource):
            raise InputError(f"Unknown source of paths {self.source!r}; choose {', '.join(get_args(PathSource))}.")
        if not self.ahead > 0:
            raise InputError(f"The way point must lie ahead of the robot, got {self.ahead} m.")


class Sight(NamedTuple):
    """What a planner gets at a camera frame.

    Attributes:
        depth: (h, w) [m]; mount: (5,) as in `CameraMount`, as the robot believes.
        base: (3,) believed pose of the base frame in the world.
        goal: (2,) [m] world.
    """

    depth: Float[Array, "h w"]
    mount: Float[Array, "5"]
    base: Float[Array, "3"]
    goal: Float[Array, "2"]


class Guidance(NamedTuple):
    """The way to go.

    Attributes:
        path: (BAND_POINTS, 2) [m] world, evenly spaced from the robot on; a point if there is no way.
        look: (2,) [m] world, where to turn to if the path gives no direction.
        detour: () bool, the route took the place of a path of iPath's that led nowhere.
        way: () bool, as far as was seen, a way to the goal may exist.
    """

    path: Float[Array, "k 2"]
    look: Float[Array, "2"]
    detour: Bool[Array, ""]
    way: Bool[Array, ""]


def guide(
    rules: GuidanceParameters,
    planner: tuple[nnx.GraphDef, Any],
    intrinsics: Intrinsics,
    memory: MapMemory,
    sight: Sight,
) -> tuple[MapMemory, Guidance]:
    """The memory with this frame added, and the way to the goal.

    Args:
        planner: graph and parameters of a `Planner`.
        intrinsics: of the depth image.
    """
    network, no = nnx.merge(*planner), jnp.asarray(False)
    if rules.source == "network":
        path = network_path(network, sight, sight.goal)
        return memory, Guidance(resample_by_arc_length(path, BAND_POINTS), sight.goal, no, ~no)
    frame = free_and_occupied(clean_depth(sight.depth), sight.mount, intrinsics, DEFAULT_GRID, DEFAULT_RULES)
    memory = remember(rules.memory, memory, sight.base, *frame)
    grid, coarse = rules.memory.grid, halved(rules.memory.grid)
    origin = window_origin(rules.memory, memory)
    start, goal = sight.base[:2] - origin, sight.goal - origin
    occupied, unknown = remembered(rules.memory, memory)
    esdf = signed_distance_field(occupied, rules.memory.resolution)
    unseen = softened(pool_2x2(unknown.astype(esdf.dtype)))
    to_go = route_costs(rules, occupied, esdf, unseen, goal)
    seen, whole = best_routes(to_go, unseen, goal, start, coarse)
    band, detour = safe_path(rules.band_parameters, seen, esdf, grid)
    if rules.source == "guided":
        route, ahead = band, _on_route(whole, rules.ahead) + origin
        band, cut = safe_path(rules.band_parameters, network_path(network, sight, ahead) - origin, esdf, grid)
        # Where iPath sees no way that leads on, the route does.
        here, there = (_cost_at(to_go, coarse, point) for point in (band[0], band[-1]))
        detour = cut | (here - there < rules.headway * jnp.minimum(here, rules.ahead))
        band = jnp.where(detour, route, band)
    path = resample_by_arc_length(band + origin, BAND_POINTS)
    return memory, Guidance(path, _on_route(whole, 0.5) + origin, detour, _reachable_near(to_go, coarse, start))


def network_path(network: Planner, sight: Sight, goal: Float[Array, "2"]) -> Float[Array, "n 2"]:
    """iPath's path to a goal, world frame."""
    path, _, _ = network.plan_path(sight.depth[None], to_base(sight.base, goal)[None], sight.mount[None])
    return to_world(sight.base, path[0])


def route_costs(
    rules: GuidanceParameters,
    occupied: Bool[Array, "n n"],
    esdf: Float[Array, "n n"],
    unseen: Float[Array, "half half"],
    goal: Float[Array, "2"],
) -> Float[Array, "half half"]:
    """Cost of the cheapest route to the goal from every cell of the window, halved; through no occupied cell."""
    cost = traversal_cost(pool_2x2(esdf), unseen, rules.traversal)
    cost = jnp.where(pool_2x2(occupied.astype(esdf.dtype)) > 0, jnp.inf, cost)
    return cost_to_go(cost, goal, halved(rules.memory.grid)).value.cost


def _reachable_near(to_go: Float[Array, "half half"], grid: GridSpec, point: Float[Array, "2"]) -> Bool[Array, ""]:
    """Whether a way leads on from some cell within a body's width of a point, noise in its own cell or not."""
    near = jnp.sum((grid.centres() - point) ** 2, axis=-1) < _AROUND**2
    return jnp.any(near & (to_go < UNREACHABLE))


def _cost_at(to_go: Float[Array, "half half"], grid: GridSpec, point: Float[Array, "2"]) -> Float[Array, ""]:
    cell = jnp.clip(jnp.round(grid.cell_coordinates(point)).astype(jnp.int32), 0, jnp.asarray(grid.shape) - 1)
    return to_go[cell[0], cell[1]]


def _on_route(route: Float[Array, "points 2"], distance: float) -> Float[Array, "2"]:
    """The point of a route at a distance [m] along it, or its end."""
    return interpolate_along(arc_length(route), route, jnp.full(1, distance, route.dtype))[0]

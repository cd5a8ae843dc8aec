"""Which way to go: from what was seen to a path in the world, by the networks, the classical planner, or both."""

from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.checks import Scalar, require_whole
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY, arc_length, interpolate_along, resample_by_arc_length, to_base, to_world
from iwalker_jax.navigation.memory import (
    MapMemory,
    MapMemoryParameters,
    RouteMemory,
    RouteMemoryParameters,
    ViewPoint,
    WideMemory,
    WideMemoryParameters,
    add_scan,
    empty_memory,
    empty_route_memory,
    empty_wide_memory,
    route_grid,
    update_memory,
    update_route_memory,
    update_wide_memory,
    view_map,
    window_origin,
)
from iwalker_jax.navigation.path_band import BAND_POINTS, BandParameters, safe_path, way_to_room
from iwalker_jax.perception import (
    DEFAULT_OBSTACLES,
    ROUTE_POINTS,
    UNREACHABLE,
    GridSpec,
    Intrinsics,
    MountUncertainty,
    ObstacleParameters,
    ScanParameters,
    TraversalParameters,
    align_to_floor,
    best_routes,
    clean_depth,
    cost_to_go,
    frame_cells,
    range_scan,
    softened,
    strided,
    traversal_cost,
    trusted_cost,
)
from iwalker_jax.planning import MemoryIPath, Planner, choose_path, start_direction, waypoints_to_path

PathSource = Literal["network", "memory", "guided", "route"]


@dataclass(frozen=True)
class GuidanceParameters:
    """How a path comes about.

    Attributes:
        source: `network` asks iPath alone and takes its path as it is; `memory` the iPath that reads the remembered map
            instead of an image, and nothing else either; `guided` asks iPath for a way to the next way
            point of the route, `route` takes the route itself, the cheapest way to the goal on the remembered map; both
            are drawn off the remembered obstacles and cut before a collision.
        lookahead: [m] along the route to the way point that iPath gets.
        min_progress: share of the cost to that point that iPath's path must take off the cost-to-go; else the route
            is used.
        face_distance: [m] along the route to the point that the robot turns to where the path gives no direction.
        start_radius: [m] about the robot, within which a route must begin.
        longest_path: [m] to which routes and paths are cut, so that they stay inside the memory's window.
        memory: of the map.
        scan: how an image is read where the path comes from `memory`; scan_stride: of which every so many pixels; wide:
            of the wider map that is read there.
        routes: of the wider map on which routes are found.
        mount: how wrong the believed mount may be that the floor in view corrects: one degree lifts the floor 0.8 m
            ahead by half the height that the robot steps over.
        obstacles: which points of a frame are obstacles.
        band: how paths are drawn off obstacles.
        required_clearance: [m] to remembered obstacles, body and sway; no route leads through what is narrower.
        committed_distance: [m] about the robot, within which the body alone must fit: a gap that it has walked up to
            does not close before it because a cell of its walls fills up.
        kept_route: share by which ground about the last frame's route is cheaper: of two ways that cost nearly the same
            the robot keeps to the one it is on, rather than turn to and fro beside what stands between them.
        kept_width: [m] on either side of that route, within which the body alone must fit as well.
        traversal: cost of the route; routes keep the sway of the gait off obstacles as well as the body. A gap that the
            body just fits costs as much as a detour of some metres through what was not seen: with a contact cost of 8
            instead of 30, seven of eight walks of a task with such a gap touched its sides, and else none.
    """

    source: PathSource = "guided"
    lookahead: float = 1.6
    min_progress: float = 0.3
    face_distance: float = 0.5
    start_radius: float = 0.3
    longest_path: float = 3.5
    memory: MapMemoryParameters = MapMemoryParameters()
    scan: ScanParameters = ScanParameters()
    scan_stride: int = 2
    wide: WideMemoryParameters = WideMemoryParameters()
    routes: RouteMemoryParameters = RouteMemoryParameters()
    mount: MountUncertainty = MountUncertainty()
    obstacles: ObstacleParameters = DEFAULT_OBSTACLES
    band: BandParameters = BandParameters()
    required_clearance: float = BODY.gap_radius
    committed_distance: float = 0.35
    kept_route: float = 0.2
    kept_width: float = 0.25
    traversal: TraversalParameters = TraversalParameters(body_radius=BODY.route_radius)

    def __post_init__(self) -> None:
        if self.source not in get_args(PathSource):
            raise InputError(f"Unknown source of paths {self.source!r}; choose {', '.join(get_args(PathSource))}.")
        lengths = ("lookahead", "face_distance", "start_radius", "longest_path", "required_clearance")
        if not min(getattr(self, name) for name in lengths) > 0:
            raise InputError(f"GuidanceParameters needs positive {', '.join(lengths)} [m].")
        require_whole(self.scan_stride, "GuidanceParameters.scan_stride")
        if not 1 <= self.scan_stride <= 16:
            raise InputError("GuidanceParameters needs a scan_stride of 1 to 16 pixels.")
        if self.committed_distance < 0:
            raise InputError("GuidanceParameters needs committed_distance >= 0 [m].")
        if not (0 <= self.kept_route < 1 and self.kept_width > 0):
            raise InputError("GuidanceParameters needs 0 <= kept_route < 1 and kept_width > 0 [m].")


class Observation(NamedTuple):
    """What the robot knows at a camera frame.

    Attributes:
        depth: (h, w) [m], 0 = no return.
        mount: (5,) as in `CameraMount`, as the robot believes.
        base: (3,) believed pose of the base frame in the world.
        goal: (2,) [m] world.
    """

    depth: Float[Array, "h w"]
    mount: Float[Array, "5"]
    base: Float[Array, "3"]
    goal: Float[Array, "2"]


class GuideMemory(NamedTuple):
    """What is known from the frames before.

    Attributes:
        cells: of the map near the robot; routes: of a wider, coarser one, None where no route is looked for; wide: of
            one for a network that reads maps, None elsewhere.
        route: (ROUTE_POINTS, 2) [m] world, the last frame's whole route, or its path; without one, that of the frames
            before.
    """

    cells: MapMemory
    routes: RouteMemory | None
    wide: WideMemory | None
    route: Float[Array, "points 2"]


def start_guide(parameters: GuidanceParameters, xy: Float[Array, "2"]) -> GuideMemory:
    """Nothing known around a place [m]."""
    cells = empty_memory(parameters.memory, xy)
    routes = empty_route_memory(parameters.routes, cells) if parameters.source in ("guided", "route") else None
    wide = empty_wide_memory(parameters.wide, parameters.memory, cells) if parameters.source == "memory" else None
    return GuideMemory(cells, routes, wide, jnp.broadcast_to(xy, (ROUTE_POINTS, 2)))


class Guidance(NamedTuple):
    """The way to go.

    Attributes:
        path: (BAND_POINTS, 2) [m] world, evenly spaced from the robot on; a point if there is no way.
        face_point: (2,) [m] world, where to turn to if the path gives no direction.
        detour: () bool, the route took the place of a path of iPath's that led nowhere.
        route_exists: () bool, as far as was seen, a route to the goal may exist.
        room_offset: (2,) [m] world axes, from the robot to where it has room to turn on the spot; zero where it has.
    """

    path: Float[Array, "k 2"]
    face_point: Float[Array, "2"]
    detour: Bool[Array, ""]
    route_exists: Bool[Array, ""]
    room_offset: Float[Array, "2"]


def guide(
    parameters: GuidanceParameters,
    planner: Planner,
    intrinsics: Intrinsics,
    memory: GuideMemory,
    observation: Observation,
    memory_ipath: MemoryIPath | None = None,
) -> tuple[GuideMemory, Guidance]:
    """The memory with this frame added, and the way to the goal.

    Args:
        parameters: where paths come from.
        planner: the networks.
        intrinsics: of the depth image.
        memory: of the frames before.
        observation: of this frame.
        memory_ipath: the network of the source `memory`.

    Raises:
        InputError: if that source has no network.
    """
    observation = observation._replace(depth=clean_depth(observation.depth))
    if parameters.source == "network":
        path = resample_by_arc_length(network_path(planner, observation, observation.goal), BAND_POINTS)
        no_offset = jnp.zeros_like(observation.goal)
        return memory, Guidance(path, observation.goal, jnp.asarray(False), jnp.asarray(True), no_offset)
    if parameters.source == "memory":
        if memory_ipath is None:
            raise InputError("Paths from memory need a MemoryIPath; make the navigator with one.")
        return _memory_path(parameters, memory_ipath, intrinsics, memory, observation)
    assert memory.routes is not None  # as `start_guide` made it
    grid, coarse = parameters.memory.grid, route_grid(parameters.routes, parameters.memory)
    cells = remember(parameters, intrinsics, memory.cells, observation)
    routes, esdf = update_route_memory(parameters.routes, parameters.memory, memory.routes, cells)
    origin = window_origin(parameters.memory, cells)
    start, goal = observation.base[:2] - origin, observation.goal - origin
    to_go = route_costs(parameters, routes, start, goal, memory.route - origin)
    seen, whole = best_routes(to_go, softened(routes.unseen), goal, start, coarse, parameters.longest_path)
    route_exists = _reachable_near(to_go, coarse, start, parameters.start_radius)
    path, detour = safe_path(parameters.band, seen, esdf, grid)
    if parameters.source == "guided":
        route, waypoint = path, _on_route(whole, parameters.lookahead) + origin
        path, cut = safe_path(parameters.band, network_path(planner, observation, waypoint) - origin, esdf, grid)
        # Where iPath sees no way that leads on, the route does.
        here, there = (_cost_at(to_go, coarse, point) for point in (path[0], path[-1]))
        detour = cut | (here - there < parameters.min_progress * jnp.minimum(here, parameters.lookahead))
        path = jnp.where(detour, route, path)
    path = jnp.where(route_exists, path, start)
    # Without a route, `whole` begins beyond what is in the way: the next frame must not keep to that.
    kept = jnp.where(route_exists, whole + origin, memory.route)
    return GuideMemory(cells, routes, None, kept), Guidance(
        path=resample_by_arc_length(path + origin, BAND_POINTS),
        face_point=_on_route(whole, parameters.face_distance) + origin,
        detour=detour,
        route_exists=route_exists,
        room_offset=way_to_room(parameters.band, start, esdf, grid),
    )


def remember(
    parameters: GuidanceParameters, intrinsics: Intrinsics, memory: MapMemory, observation: Observation
) -> MapMemory:
    """The memory with a frame added, from an observation whose depth is cleaned."""
    grid = parameters.memory.frame_grid
    mount = align_to_floor(observation.depth, observation.mount, intrinsics, parameters.mount)
    frame = frame_cells(observation.depth, mount, intrinsics, grid, parameters.obstacles)
    return update_memory(parameters.memory, memory, observation.base, frame, grid)


def _memory_path(
    parameters: GuidanceParameters,
    network: MemoryIPath,
    intrinsics: Intrinsics,
    memory: GuideMemory,
    observation: Observation,
) -> tuple[GuideMemory, Guidance]:
    """The memory with a scan of this frame added, and the path that the network chooses on it."""
    assert memory.wide is not None  # as `start_guide` made it
    stride, base = parameters.scan_stride, observation.base
    depth = observation.depth[::stride, ::stride]
    scan = range_scan(depth, observation.mount, strided(intrinsics, stride), parameters.scan)
    cells = add_scan(parameters.memory, memory.cells, base, scan, observation.mount[3:5])
    wide = update_wide_memory(parameters.wide, parameters.memory, memory.wide, cells, base[:2])
    at = ViewPoint(base, observation.goal, start_direction(memory.route))
    view, bearing = view_map(network.config.view, parameters.memory, cells, wide, at)
    candidates = network(view)
    chosen = choose_path(network.config, candidates, view)
    frame = jnp.append(base[:2], bearing)
    path = to_world(frame, waypoints_to_path(candidates.waypoints[chosen][None], ROUTE_POINTS)[0])
    # Who comes by so often goes round in circles: a place is passed two or three times on a walk that ends at its goal.
    lost = view.visits_here >= network.config.view.most_visits
    guidance = Guidance(
        path=resample_by_arc_length(jnp.where(lost, base[:2], path), BAND_POINTS),
        face_point=_on_route(path, parameters.face_distance),
        detour=jnp.asarray(False),
        route_exists=~lost,
        room_offset=jnp.zeros_like(observation.goal),
    )
    return GuideMemory(cells, None, wide, path), guidance


def network_path(planner: Planner, observation: Observation, goal: Float[Array, "2"]) -> Float[Array, "n 2"]:
    """iPath's path [m] to a goal, both in the world frame, from an observation whose depth is cleaned."""
    depth, mount, base, _ = observation
    path, _, _ = planner.plan_path(depth[None], to_base(base, goal)[None], mount[None], cleaned=True)
    return to_world(base, path[0])


def route_costs(
    parameters: GuidanceParameters,
    routes: RouteMemory,
    start: Float[Array, "2"],
    goal: Float[Array, "2"],
    kept: Float[Array, "points 2"],
) -> Float[Array, "n n"]:
    """Cost of the cheapest route to the goal from every coarse cell, with room for the body all along.

    Args:
        parameters: what routes cost and how much room they need.
        routes: the coarse map.
        start, goal: [m] from its middle.
        kept: (points, 2) [m] from its middle, the last frame's route.
    """
    grid = route_grid(parameters.routes, parameters.memory)
    cost = traversal_cost(routes.clearance, softened(routes.unseen), parameters.traversal)
    on_kept = jnp.any(_squared_distance(grid.centres()[..., None, :], kept) < parameters.kept_width**2, axis=-1)
    cost = cost * jnp.where(on_kept, 1 - parameters.kept_route, 1.0)
    committed = on_kept | (_squared_distance(grid.centres(), start) < parameters.committed_distance**2)
    required = jnp.where(committed, parameters.band.min_clearance, parameters.required_clearance)
    cost = jnp.where(routes.room < required, jnp.inf, cost)
    # What lies beyond the map was not seen.
    return trusted_cost(cost_to_go(cost, goal, grid, outside_cost=1.0 + parameters.traversal.unknown))


def _squared_distance(a: Float[Array, "*#shape 2"], b: Float[Array, "*#shape 2"]) -> Float[Array, "*shape"]:
    return jnp.sum((a - b) ** 2, axis=-1)


def _reachable_near(
    to_go: Float[Array, "n n"], grid: GridSpec, point: Float[Array, "2"], radius: Scalar
) -> Bool[Array, ""]:
    """Whether a way leads on from some cell within a radius [m] of a point, noise in its own cell or not."""
    near = _squared_distance(grid.centres(), point) < radius**2
    return jnp.any(near & (to_go < UNREACHABLE))


def _cost_at(to_go: Float[Array, "n n"], grid: GridSpec, point: Float[Array, "2"]) -> Float[Array, ""]:
    cell = jnp.clip(jnp.round(grid.cell_coordinates(point)).astype(jnp.int32), 0, jnp.asarray(grid.shape) - 1)
    return to_go[cell[0], cell[1]]


def _on_route(route: Float[Array, "points 2"], distance: Scalar) -> Float[Array, "2"]:
    """The point of a route at a distance [m] along it, or its end."""
    return interpolate_along(arc_length(route), route, jnp.full(1, distance, route.dtype))[0]

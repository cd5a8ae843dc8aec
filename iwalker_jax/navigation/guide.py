"""Which way to go: from what was seen to a path in the world, by the network or by the classical route planner."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Bool, Float

from iwalker_jax.errors import InputError
from iwalker_jax.geometry.splines import resample_by_arc_length
from iwalker_jax.navigation.camera import to_base, to_world
from iwalker_jax.navigation.map_memory import MapMemory, MemoryRules, remember, remembered, window_origin
from iwalker_jax.navigation.path_band import BAND_POINTS, BandRules, safe_path
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.perception.collision_map import DEFAULT_RULES
from iwalker_jax.perception.cost_to_go import cost_to_go
from iwalker_jax.perception.depth_cleanup import clean_depth
from iwalker_jax.perception.distance_field import signed_distance_field
from iwalker_jax.perception.grid import DEFAULT_GRID
from iwalker_jax.perception.local_map import free_and_occupied
from iwalker_jax.perception.seen_route import seen_route
from iwalker_jax.perception.traversal import TraversalRules, halved, pool_2x2, softened, traversal_cost

PathSource = Literal["network", "route"]


@dataclass(frozen=True)
class GuideRules:
    """How a path comes about.

    Attributes:
        source: `network` asks iPath, `route` the geodesic planner on the remembered map.
        band: whether the path is drawn off the remembered obstacles and cut before a collision.
        memory, band_rules, traversal: their numbers.
    """

    source: PathSource = "network"
    band: bool = True
    memory: MemoryRules = MemoryRules()
    band_rules: BandRules = BandRules()
    traversal: TraversalRules = TraversalRules()

    def __post_init__(self) -> None:
        if self.source not in ("network", "route"):
            raise InputError(f"Unknown source of paths {self.source!r}; choose 'network' or 'route'.")


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
        cut: () bool, the band had to end the path before an obstacle.
    """

    path: Float[Array, "k 2"]
    look: Float[Array, "2"]
    cut: Bool[Array, ""]


def guide(
    rules: GuideRules, planner: tuple[nnx.GraphDef, Any], intrinsics: Intrinsics, memory: MapMemory, sight: Sight
) -> tuple[MapMemory, Guidance]:
    """The memory with this frame added, and the way to the goal.

    Args:
        planner: graph and parameters of a `Planner`.
        intrinsics: of the depth image.
    """
    uses_map = rules.band or rules.source == "route"
    if uses_map:
        clean = clean_depth(sight.depth)
        frame = free_and_occupied(clean, sight.mount, intrinsics, DEFAULT_GRID, DEFAULT_RULES)
        memory = remember(rules.memory, memory, sight.base, *frame)
    origin = window_origin(rules.memory, memory)
    occupied, unknown = remembered(rules.memory, memory)
    if rules.source == "network":
        network = nnx.merge(*planner)
        goal = to_base(sight.base, sight.goal)
        path, _, _ = network.plan_path(sight.depth[None], goal[None], sight.mount[None])
        path, look = to_world(sight.base, path[0]), sight.goal
    if uses_map:
        esdf = signed_distance_field(occupied, rules.memory.resolution)
    if rules.source == "route":
        path, look = _route(rules, esdf, unknown, sight.base[:2] - origin, sight.goal - origin)
        path, look = path + origin, look + origin
    if not rules.band:
        return memory, Guidance(resample_by_arc_length(path, BAND_POINTS), look, jnp.asarray(False))
    band, cut = safe_path(rules.band_rules, path - origin, esdf, rules.memory.grid)
    return memory, Guidance(resample_by_arc_length(band + origin, BAND_POINTS), look, cut)


def _route(
    rules: GuideRules,
    esdf: Float[Array, "n n"],
    unknown: Bool[Array, "n n"],
    start: Float[Array, "2"],
    goal: Float[Array, "2"],
) -> tuple[Float[Array, "points 2"], Float[Array, "2"]]:
    """The best seen route on the window, and a point of the whole route half a metre on."""
    grid = halved(rules.memory.grid)
    unseen = softened(pool_2x2(unknown.astype(esdf.dtype)))
    cost = traversal_cost(pool_2x2(esdf), unseen, rules.traversal)
    to_go = cost_to_go(cost, goal, grid).value.cost
    whole = seen_route(to_go, jnp.zeros_like(unseen), goal, start, grid)
    far = jnp.sum((whole - start) ** 2, axis=-1) > 0.5**2
    look = jnp.where(jnp.any(far), whole[jnp.argmax(far)], goal)
    return seen_route(to_go, unseen, goal, start, grid), look


def blank_guidance(base: Float[Array, "3"], goal: Float[Array, "2"]) -> Guidance:
    """Guidance before the first image: stay."""
    return Guidance(jnp.broadcast_to(base[:2], (BAND_POINTS, 2)), goal, jnp.asarray(False))

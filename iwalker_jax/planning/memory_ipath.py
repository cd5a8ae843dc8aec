"""iPath with a memory: remembered map and goal -> candidates of a path, each with what it expects to pay for it.

One perceptron proposes several paths, another tells the cost of each from what the map holds along it. They look at
the world and at its mirror image, and both answers are candidates: so the set of candidates of a mirrored world is the
mirrored set, exactly, and a robot that stands before the middle of a box takes one side instead of the mean of both.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from jaxtyping import Array, Bool, Float, Int, Int8

from iwalker_jax.checks import require_whole
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import safe_sqrt
from iwalker_jax.planning.map_view import GOAL_FEATURES, MapCell, MapView, MapViewParameters
from iwalker_jax.planning.planner import waypoints_to_path

_LARGEST_LOG_COST = 5.0
_PLACES = 16  # along a path, by which it is judged
_BESIDE = (-0.24, -0.12, 0.0, 0.12, 0.24)  # [m] to its left: the body's width and some room
_AHEAD = 0.4  # share of a path whose direction tells to which side it goes


@dataclass(frozen=True)
class MemoryIPathConfig:
    """Size of the network and of its paths.

    Attributes:
        view: of the map.
        channels: of each bearing, in the layers that look at neighbouring bearings; reach: bearings to either side.
        hidden: units of each layer; blocks: residual layers after the first.
        judging: units of each layer that judges a path.
        proposals: paths of one look; with those of the mirror image there are twice as many candidates.
        waypoints: of a path, at even distances.
        longest: [m] of a path; shortest: of one whose goal is no nearer.
        keep_side: [m] by which a candidate that starts out like the last path may be dearer than one that turns back;
            so much for every time that the robot has come by.
    """

    view: MapViewParameters = MapViewParameters()
    channels: int = 48
    reach: int = 2
    hidden: int = 256
    blocks: int = 2
    judging: int = 96
    proposals: int = 3
    waypoints: int = 5
    longest: float = 1.6
    shortest: float = 1.2
    keep_side: float = 0.15

    def __post_init__(self) -> None:
        for name in ("channels", "hidden", "blocks", "judging", "proposals", "waypoints"):
            most = 65_536 if name in ("channels", "hidden", "judging") else 100
            require_whole(getattr(self, name), f"MemoryIPathConfig.{name}")
            if not 1 <= getattr(self, name) <= most:
                raise InputError(f"MemoryIPathConfig.{name} must lie in 1..{most}.")
        require_whole(self.reach, "MemoryIPathConfig.reach")
        if not 0 <= 2 * self.reach < self.view.bearings:
            raise InputError("MemoryIPathConfig needs a reach of at least 0 bearings that does not go all round.")
        if not 0 < self.shortest <= self.longest or self.keep_side < 0:
            raise InputError("MemoryIPathConfig needs 0 < shortest <= longest [m] and keep_side >= 0 [m].")


class PathCandidates(NamedTuple):
    """Paths to choose from; the last half are the mirror image's.

    Attributes:
        waypoints: (candidates, k, 2) [m] from the robot, x towards the goal, y to its left.
        log_cost: (candidates,) log(1 + cost [m]) that the robot will pay beyond the best way to the goal.
        fear: (candidates,) logit of the body's meeting an obstacle on the path.
    """

    waypoints: Float[Array, "*batch candidates k 2"]
    log_cost: Float[Array, "*batch candidates"]
    fear: Float[Array, "*batch candidates"]

    @property
    def cost(self) -> Float[Array, "*batch candidates"]:
        """[m], what the robot expects to pay."""
        return jnp.expm1(jnp.clip(self.log_cost, -1.0, _LARGEST_LOG_COST))


class MemoryIPath(nnx.Module):
    """Two residual perceptrons: one proposes paths, one judges each by what the map holds along it."""

    def __init__(self, config: MemoryIPathConfig, rngs: nnx.Rngs) -> None:
        self.config = config
        view, proposals = config.view, config.proposals
        # A gap is a gap in whatever direction: the layers that read rings share their weights between bearings.
        width = 2 * config.reach + 1
        self.read = _linear(width * (2 * view.rings + 2 + 3 * view.wide_rings), config.channels, rngs)
        self.read_again = _linear(width * config.channels, config.channels, rngs)
        self.first = _linear(view.bearings // 2 * 2 * config.channels + GOAL_FEATURES, config.hidden, rngs)
        self.blocks = nnx.List(_linear(config.hidden, config.hidden, rngs) for _ in range(config.blocks))
        # Proposals begin spread to one side of the goal; the mirror image's begin on the other.
        bias = np.zeros((proposals, config.waypoints + 1), np.float32)
        bias[:, 0] = np.linspace(0.0, 0.9, proposals)
        self.last = nnx.Linear(
            config.hidden,
            proposals * (config.waypoints + 1),
            kernel_init=nnx.initializers.variance_scaling(0.02, "fan_in", "normal"),
            bias_init=lambda key, shape, dtype: jnp.asarray(bias.ravel(), dtype),
            rngs=rngs,
        )
        along = _PLACES * (2 * len(_BESIDE) + 1) + 2 * config.waypoints + GOAL_FEATURES + config.judging
        self.summary = _linear(config.hidden, config.judging, rngs)
        self.judge = _linear(along, config.judging, rngs)
        self.judge_again = _linear(config.judging, config.judging, rngs)
        self.verdict = nnx.Linear(config.judging, 2, rngs=rngs)

    def __call__(self, view: MapView) -> PathCandidates:
        """Candidates of one view or of a batch of them."""
        seen, mirrored = self._propose(view), self._propose(view.mirrored())
        flipped = mirrored._replace(waypoints=mirrored.waypoints * jnp.asarray([1.0, -1.0], view.goal.dtype))
        axis = view.goal.ndim - 1
        return PathCandidates(*(jnp.concatenate(pair, axis=axis) for pair in zip(seen, flipped, strict=True)))

    def _propose(self, view: MapView) -> PathCandidates:
        config = self.config
        batch = view.goal.shape[:-1]
        rings = jnp.concatenate([self._rings(view), self._wide_rings(view)], axis=-1)
        read = jax.nn.relu(self.read(_with_neighbours(rings, config.reach)))
        read = read + jax.nn.relu(self.read_again(_with_neighbours(read, config.reach)))
        # Pairs of bearings: what is far away is not sharper.
        pairs = read.reshape(*batch, config.view.bearings // 2, 2, config.channels)
        pairs = jnp.concatenate([pairs.max(axis=-2), pairs.mean(axis=-2)], axis=-1)
        hidden = jax.nn.relu(self.first(jnp.concatenate([pairs.reshape(*batch, -1), view.goal], axis=-1)))
        for block in self.blocks:
            hidden = hidden + jax.nn.relu(block(hidden))
        out = self.last(hidden).reshape(*batch, config.proposals, config.waypoints + 1)
        turns, stretch = out[..., :-1], out[..., -1]
        # A path has a length of its own, so that none is cheap by going nowhere.
        near = 0.5 * config.view.near_goal * (view.goal[..., 1] + 1.0)
        shortest = jnp.minimum(near, config.shortest)[..., None]
        length = shortest + (config.longest - shortest) * jax.nn.sigmoid(stretch)
        heading = jnp.cumsum(turns, axis=-1)
        steps = jnp.stack([jnp.cos(heading), jnp.sin(heading)], axis=-1)
        waypoints = jnp.cumsum(length[..., None, None] / config.waypoints * steps, axis=-2)
        return PathCandidates(waypoints, *self._judge(view, hidden, jax.lax.stop_gradient(waypoints)))

    def _rings(self, view: MapView) -> Float[Array, "*batch bearings features"]:
        """Which rings of each bearing are occupied and free, and how far its first occupied and not free places are."""
        sizes = self.config.view
        batch = view.goal.shape[:-1]
        occupied, free = view.cells == MapCell.OCCUPIED, view.cells == MapCell.FREE
        rings = (*batch, sizes.bearings, sizes.rings, sizes.samples_per_ring)
        dtype = view.goal.dtype
        parts = [
            jnp.max(occupied.reshape(rings), axis=-1).astype(dtype),
            jnp.mean(free.reshape(rings), axis=-1, dtype=dtype),
            _share_before(occupied)[..., None].astype(dtype),
            _share_before(~free)[..., None].astype(dtype),
        ]
        return jnp.concatenate(parts, axis=-1)

    def _wide_rings(self, view: MapView) -> Float[Array, "*batch bearings features"]:
        """Shares of each ring of the wide map, in pairs of bearings, that are occupied, free, and were visited."""
        sizes = self.config.view
        batch = view.goal.shape[:-1]
        rings = (*batch, sizes.bearings // 2, 2, sizes.wide_rings, sizes.wide_samples_per_ring)
        dtype = view.goal.dtype
        maps = (view.wide == MapCell.OCCUPIED, view.wide == MapCell.FREE, view.visits / sizes.most_visits)
        parts = [jnp.mean(polar.astype(dtype).reshape(rings), axis=(-3, -1)) for polar in maps]
        shares = jnp.concatenate(parts, axis=-1)
        return jnp.repeat(shares, 2, axis=-2)

    def _judge(
        self, view: MapView, hidden: Float[Array, "*batch hidden"], waypoints: Float[Array, "*batch proposals k 2"]
    ) -> tuple[Float[Array, "*batch proposals"], Float[Array, "*batch proposals"]]:
        """Expected log cost and fear of each path, from the places on it and beside it."""
        batch, proposals = waypoints.shape[:-3], waypoints.shape[-3]
        rows = waypoints.reshape(-1, *waypoints.shape[-2:])
        path = waypoints_to_path(rows, _PLACES + 1)
        ahead = jnp.diff(path, axis=1)
        ahead = ahead / safe_sqrt(jnp.maximum(jnp.sum(ahead**2, axis=-1, keepdims=True), 1e-12))
        left = jnp.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)
        beside = jnp.asarray(_BESIDE, path.dtype)[:, None]
        places = (path[:, 1:, None] + beside * left[:, :, None]).reshape(*batch, -1, 2)
        sizes = self.config.view
        kind = _cells_at(sizes.spacing, view.cells, places).reshape(*batch, proposals, -1)
        visits = _cells_at(sizes.wide_spacing, view.visits, path[:, 1:].reshape(*batch, -1, 2))
        shared = jnp.broadcast_to(
            jnp.concatenate([jax.nn.relu(self.summary(hidden)), view.goal], axis=-1)[..., None, :],
            (*batch, proposals, self.config.judging + GOAL_FEATURES),
        )
        dtype = view.goal.dtype
        known = [(kind == MapCell.OCCUPIED).astype(dtype), (kind == MapCell.FREE).astype(dtype)]
        known.append(visits.reshape(*batch, proposals, -1).astype(dtype) / sizes.most_visits)
        features = jnp.concatenate([*known, waypoints.reshape(*batch, proposals, -1), shared], axis=-1)
        judged = jax.nn.relu(self.judge(features))
        judged = judged + jax.nn.relu(self.judge_again(judged))
        verdict = self.verdict(judged)
        return verdict[..., 0], verdict[..., 1]


def _linear(inputs: int, outputs: int, rngs: nnx.Rngs) -> nnx.Linear:
    return nnx.Linear(inputs, outputs, kernel_init=nnx.initializers.he_normal(), rngs=rngs)


def _with_neighbours(
    rings: Float[Array, "*batch bearings channels"], reach: int
) -> Float[Array, "*batch bearings features"]:
    """What each bearing and so many to either side of it show, all round."""
    return jnp.concatenate([jnp.roll(rings, shift, axis=-2) for shift in range(-reach, reach + 1)], axis=-1)


def _share_before(mask: Bool[Array, "*batch bearings samples"]) -> Float[Array, "*batch bearings"]:
    """Share of each bearing up to its first true place; 1 without one."""
    samples = mask.shape[-1]
    return jnp.where(mask.any(axis=-1), jnp.argmax(mask, axis=-1), samples) / samples


def _cells_at(
    spacing: float, cells: Int8[Array, "*batch bearings samples"], places: Float[Array, "*batch n 2"]
) -> Int8[Array, "*batch n"]:
    """Of a polar map, the samples `spacing` [m] apart nearest to places [m] in its axes; zero beyond its last ring."""
    bearings, samples = cells.shape[-2:]
    x, y = places[..., 0], places[..., 1]
    # The floor of a number that lies on a bearing's border belongs to either side: the mirror image decides the other
    # way, for which no place lies exactly there but by chance.
    bearing = jnp.floor((jnp.arctan2(y, x) / (2 * math.pi) + 0.5) * bearings).astype(jnp.int32)
    bearing = jnp.clip(bearing, 0, bearings - 1)
    sample = jnp.round(jnp.sqrt(x**2 + y**2) / spacing).astype(jnp.int32) - 1
    flat = bearing * samples + jnp.clip(sample, 0, samples - 1)
    found = jnp.take_along_axis(cells.reshape(*cells.shape[:-2], -1), flat, axis=-1)
    return jnp.where(sample < samples, found, jnp.int8(0))


def choose_path(config: MemoryIPathConfig, candidates: PathCandidates, view: MapView) -> Int[Array, ""]:
    """Index of the cheapest candidate of one view; between ways that cost the same the robot keeps to its side.

    Args:
        config: of the network.
        candidates: without a batch axis.
        view: that they are of.
    """
    directions = jax.vmap(start_direction)(waypoints_to_path(candidates.waypoints))
    # Where it has been before, turning back has not helped.
    keep = config.keep_side * jnp.maximum(view.visits_here, 1)
    return jnp.argmin(candidates.cost + keep * (1.0 - directions @ view.course))


def start_direction(path: Float[Array, "n 2"]) -> Float[Array, "2"]:
    """Unit vector from a path's start to a point on it some way on; zero if it is a point."""
    ahead = path[round(_AHEAD * (path.shape[0] - 1))] - path[0]
    return ahead / safe_sqrt(jnp.maximum(jnp.sum(ahead**2), 1e-12))

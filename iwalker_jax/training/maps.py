"""Maps that the losses sample, made once for each frame from its own depth image: the training's only supervision."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.data.frame_set import DEPTH_UNIT, FrameSet
from iwalker_jax.perception import (
    ROUTE_GRID,
    Intrinsics,
    TraversalParameters,
    best_routes,
    build_local_map,
    cost_to_go,
    pool_2x2,
    softened,
    traversal_cost,
    trusted_cost,
)
from iwalker_jax.runtime.files import digest


class TrainingData(NamedTuple):
    """A frame set with its maps, as arrays with a leading frame axis. Half precision where millimetres suffice.

    Attributes:
        depth: (n, height, width) uint16 [mm].
        mounts: (n, 5) camera mounts as in `CameraMount`.
        goals: (n, g, 2) [m] in base.
        esdf: (n, rows, columns) float16 [m] on `DEFAULT_GRID`.
        unknown: (n, half_rows, half_columns) float16, softened share of unseen cells on `ROUTE_GRID`.
        to_go: (n, g, half_rows, half_columns) float16, cost-to-go to each goal on `ROUTE_GRID`.
        routes: (n, g, points, 2) float16 [m], best seen route to each goal, see `best_routes`.
        published: (n, 100, 100) float16, the paper's collision map.
    """

    depth: Array
    mounts: Array
    goals: Array
    esdf: Array
    unknown: Array
    to_go: Array
    routes: Array
    published: Array


class FrameMaps(NamedTuple):
    """The maps of one frame and one goal, in single precision (see `TrainingData`)."""

    esdf: Float[Array, "*batch rows columns"]
    unknown: Float[Array, "*batch half_rows half_columns"]
    to_go: Float[Array, "*batch half_rows half_columns"]
    route: Float[Array, "*batch points 2"]
    published: Float[Array, "*batch map_rows map_columns"]

    def mirrored(self) -> "FrameMaps":
        """Left and right exchanged (the grids are symmetric about the x axis)."""
        return FrameMaps(
            self.esdf[..., ::-1],
            self.unknown[..., ::-1],
            self.to_go[..., ::-1],
            self.route * jnp.asarray([1.0, -1.0], self.route.dtype),
            self.published[..., ::-1],
        )


def frame_maps(
    depth: Float[Array, "height width"],
    mount: Float[Array, " 5"],
    goals: Float[Array, "g 2"],
    intrinsics: Intrinsics,
    traversal: TraversalParameters,
) -> FrameMaps:
    """Maps of one depth image [m] and its goals [m]; `to_go` and `route` get a leading goal axis. Pure; jit it."""
    local = build_local_map(depth, mount, intrinsics)
    unknown = softened(pool_2x2(local.unknown.astype(jnp.float32)))
    cost = traversal_cost(pool_2x2(local.esdf), unknown, traversal)
    to_go = jax.vmap(lambda goal: trusted_cost(cost_to_go(cost, goal, ROUTE_GRID)))(goals)
    routes = jax.vmap(lambda goal, values: best_routes(values, unknown, goal).seen)(goals, to_go)
    return FrameMaps(local.esdf, unknown, to_go, routes, local.published)


def prepare(
    frames: FrameSet,
    traversal: TraversalParameters,
    batch: int = 16,
    on_progress: Callable[[int], None] = lambda done: None,
) -> TrainingData:
    """Make all maps of a frame set, `batch` frames at a time; `on_progress` hears how many frames are done."""
    camera = frames.camera
    many = jax.jit(
        jax.vmap(lambda depth, mount, goals: _half(frame_maps(depth * DEPTH_UNIT, mount, goals, camera, traversal)))
    )
    n = len(frames)
    parts = []
    for start in range(0, n, batch):
        index = jnp.minimum(jnp.arange(start, start + batch), n - 1)
        # The last batch is filled up with its last frame, so that one program serves all.
        depth = jnp.asarray(frames.depth[index]).astype(jnp.float32)
        maps = many(depth, jnp.asarray(frames.mounts[index]), jnp.asarray(frames.goals[index]))
        parts.append(jax.tree.map(lambda x, keep=min(batch, n - start): x[:keep], maps))
        on_progress(min(start + batch, n))
    maps = jax.tree.map(lambda *x: jnp.concatenate(x), *parts)
    return TrainingData(
        jnp.asarray(frames.depth),
        jnp.asarray(frames.mounts, jnp.float32),
        jnp.asarray(frames.goals, jnp.float32),
        maps.esdf,
        maps.unknown,
        maps.to_go,
        maps.route,
        maps.published,
    )


def data_content(data: TrainingData) -> dict[str, str]:
    """Digests of the frames that the data is made of, by name; the maps follow from them and the configuration."""
    return {name: digest({name: getattr(data, name)}) for name in ("depth", "mounts", "goals")}


def _half(maps: FrameMaps) -> FrameMaps:
    # 60000 keeps the unreachable cost below the largest half-precision number.
    return FrameMaps(*(jnp.clip(field, -60000.0, 60000.0).astype(jnp.float16) for field in maps))

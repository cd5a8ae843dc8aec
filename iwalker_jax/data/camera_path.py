"""One camera path through a scene: a route, base poses and camera mounts along it, noisy depth images, and goals."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32, Int, Key

from iwalker_jax.data.frame_set import FrameSet, depth_to_millimetres
from iwalker_jax.data.goals import cells_that_reach, costs_to_goal, reachable_goals, walkable_cells
from iwalker_jax.data.path_sampling import CameraPathSampling
from iwalker_jax.geometry import host
from iwalker_jax.perception import UNREACHABLE, Intrinsics, descend
from iwalker_jax.scenes import (
    SCENE_RESOLUTION,
    DepthNoise,
    Scene,
    SceneArrays,
    add_depth_noise,
    obstacle_distance,
    render_depth,
    world_camera_pose,
)
from iwalker_jax.scenes.grid_distance import scene_grid_of


def record_camera_path(
    scene: Scene,
    seed: int,
    sampling: CameraPathSampling = CameraPathSampling(),
    intrinsics: Intrinsics = Intrinsics(),
    noise: DepthNoise | None = DepthNoise(),
    route: Float[np.ndarray, "points 2"] | None = None,
) -> FrameSet | None:
    """Frames of one path through a scene, from a random start to a random reachable goal; None without such a route.

    Args:
        scene: to go through.
        seed: of route, sway, goals and noise.
        sampling: camera path and goals.
        intrinsics: camera.
        noise: sensor noise; None for ideal depth.
        route: (n, 2) [m] world polyline to follow instead of a random one; its end is the goal.
    """
    rng = np.random.default_rng(seed)
    arrays = scene.arrays()
    free = np.asarray(walkable_cells(arrays))
    origin = np.asarray(arrays.bounds[:2])
    if free.sum() < 50:
        return None
    if route is None:
        found = _random_route(arrays, free, origin, rng, sampling)
        if found is None:
            return None
        route, reachable = found
    else:
        reachable = cells_that_reach(scene, route[-1])
    poses = _poses_along(route, rng, sampling, arrays)
    mounts = _mounts(len(poses), rng, sampling)
    goals = reachable_goals(poses, route[-1], free & reachable, origin, rng, sampling)
    depth = np.asarray(render_path(arrays, intrinsics, jnp.asarray(poses), jnp.asarray(mounts)))
    if noise is not None:
        keys = jax.random.split(jax.random.key(seed), len(depth))
        depth = np.asarray(add_path_noise(keys, jnp.asarray(depth), noise, intrinsics))
    n = len(poses)
    return FrameSet(depth_to_millimetres(depth), mounts, goals, poses, np.zeros(n, np.int32), (scene.name,), intrinsics)


@jax.jit
def _descend(cost: Float[Array, "rows columns"], start: Float[Array, " 2"]) -> Float[Array, "steps 2"]:
    return descend(cost, scene_grid_of(cost.shape[0]), start, 2 * max(cost.shape))


_clearance = jax.jit(obstacle_distance)


def _render(
    scene: SceneArrays, intrinsics: Intrinsics, poses: Float[Array, "n 3"], mounts: Float[Array, "n 5"]
) -> Float[Array, "n height width"]:
    def one(pose: Float[Array, " 3"], mount: Float[Array, " 5"]) -> Float[Array, "height width"]:
        rotation, position = world_camera_pose(pose, mount)
        return render_depth(scene, intrinsics, rotation, position)

    return jax.vmap(one)(poses, mounts)


render_path = jax.jit(_render, static_argnames="intrinsics")
"""Ideal depth images [m] of one scene from (n, 3) base poses and (n, 5) mounts."""


def _add_noise(
    keys: Key[Array, " n"], depth: Float[Array, "n height width"], noise: DepthNoise, intrinsics: Intrinsics
) -> Float[Array, "n height width"]:
    return jax.vmap(lambda key, image: add_depth_noise(key, image, noise, intrinsics))(keys, depth)


add_path_noise = jax.jit(_add_noise, static_argnames=("noise", "intrinsics"))
"""The same images as a real sensor would see them."""


def _random_route(
    arrays: SceneArrays,
    free: Bool[np.ndarray, "rows columns"],
    origin: Float[np.ndarray, " 2"],
    rng: np.random.Generator,
    sampling: CameraPathSampling,
) -> tuple[Float[np.ndarray, "points 2"], Bool[np.ndarray, "rows columns"]] | None:
    """A smoothed random route [m, world] and the cells from which its goal can be reached."""
    cells = np.argwhere(free)
    for _ in range(5):
        goal = _cell_centre(cells[rng.integers(len(cells))], origin)
        cost = costs_to_goal(arrays, jnp.asarray(goal, jnp.float32))
        values = np.asarray(cost)
        starts = np.argwhere(free & (values > sampling.min_route) & (values < sampling.max_route))
        if len(starts) == 0:
            continue
        # Long routes are rare by area; drawing by rank of cost would need a sort, two draws and the longer is enough.
        drawn = starts[rng.integers(len(starts), size=2)]
        start = max(drawn, key=lambda cell: values[cell[0], cell[1]])
        way = np.asarray(_descend(cost, jnp.asarray(_cell_centre(start, np.zeros(2)), jnp.float32))) + origin
        moving = np.concatenate([[True], np.any(np.diff(way, axis=0) != 0, axis=1)])
        way = way[moving]
        if len(way) < 8:
            continue
        kernel = np.ones(5) / 5
        padded = np.pad(way, ((2, 2), (0, 0)), mode="edge")
        smooth = np.stack([np.convolve(padded[:, k], kernel, mode="valid") for k in range(2)], axis=1)
        smooth[0], smooth[-1] = way[0], goal
        return smooth, values < UNREACHABLE
    return None


def _cell_centre(cell: Int[np.ndarray, " 2"], origin: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " 2"]:
    return origin + (cell + 0.5) * SCENE_RESOLUTION


def _poses_along(
    route: Float[np.ndarray, "points 2"], rng: np.random.Generator, sampling: CameraPathSampling, arrays: SceneArrays
) -> Float32[np.ndarray, "n 3"]:
    """Base poses: evenly along the route with random phase, looking half a metre ahead."""
    n = sampling.frames_per_path
    usable = max(host.arc_length(route)[-1] - sampling.last_frame, 0.1)
    at = (np.arange(n) + rng.uniform(0.0, 1.0)) / n * usable
    along, ahead = host.points_along(route, at), host.points_along(route, at + 0.5)
    heading = np.arctan2(*(ahead - along)[:, ::-1].T)
    heading = heading + rng.normal(0.0, sampling.heading_spread, n)
    position = along.copy()
    # A jittered position must still fit the body; the route itself always does.
    for scale in (1.0, 0.5, 0.25):
        jitter = along + scale * rng.normal(0.0, sampling.lateral_spread, (n, 2))
        fits = np.asarray(_clearance(arrays, jnp.asarray(jitter, jnp.float32))) > sampling.min_clearance
        settled = np.any(position != along, axis=1)
        position = np.where((fits & ~settled)[:, None], jitter, position)
    return np.column_stack([position, heading]).astype(np.float32)


def _mounts(n: int, rng: np.random.Generator, sampling: CameraPathSampling) -> Float32[np.ndarray, "n 5"]:
    """Camera mounts: one height, pitch and roll a path, and the gait's sway in every image."""
    height = rng.normal(sampling.height, sampling.height_spread) + rng.normal(0.0, sampling.sway_height, n)
    pitch = rng.normal(sampling.pitch, sampling.pitch_spread) + rng.normal(0.0, sampling.sway_angle, n)
    roll = rng.normal(0.0, sampling.roll_spread) + rng.normal(0.0, sampling.sway_angle, n)
    place = np.array([sampling.forward, 0.0]) + rng.normal(0.0, sampling.sway_position, (n, 2))
    return np.column_stack([height, pitch, roll, place]).astype(np.float32)

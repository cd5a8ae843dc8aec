"""One camera path through a scene: a route, base poses and camera mounts along it, noisy depth images, and goals."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.data.frame_set import FrameSet, depth_to_millimetres
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import host
from iwalker_jax.geometry.body import BODY
from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.perception.cost_to_go import UNREACHABLE, descend
from iwalker_jax.scenes.depth_noise import DepthNoise, add_depth_noise
from iwalker_jax.scenes.ray_casting import render_depth, world_camera_pose
from iwalker_jax.scenes.routes import SCENE_GRID, free_cells, route_map
from iwalker_jax.scenes.scene import Scene, SceneArrays, obstacle_distance


@dataclass(frozen=True)
class CameraPathSampling:
    """How a camera is carried through a scene, and which goals are asked for.

    Attributes:
        frames_per_path: images along one route.
        goals_per_frame: the route's end plus random reachable points.
        min_route, max_route: [m] route lengths (cost-to-go along the comfortable route).
        last_frame: [m] distance before the goal at which the recording ends.
        height, height_spread: [m] camera height and its standard deviation from path to path.
        pitch, pitch_spread: [rad] downward pitch and its spread from path to path.
        roll_spread: [rad] mounting roll's spread from path to path.
        sway_angle: [rad] gait sway in pitch and roll from image to image.
        sway_height: [m] gait sway of the height.
        forward: [m] of the camera ahead of the COM, and sway_position: [m] of the COM's gait sway about it, both axes.
        heading_spread: [rad] departure of the heading from the route.
        lateral_spread: [m] departure of the position from the route.
        goal_radius: [m] random goals lie at most this far away.
        min_clearance: [m] distance to obstacles at every recorded pose.
    """

    frames_per_path: int = 5
    goals_per_frame: int = 6
    min_route: float = 3.0
    max_route: float = 9.0
    last_frame: float = 1.0
    height: float = CameraMount.height
    height_spread: float = 0.03
    pitch: float = CameraMount.pitch
    pitch_spread: float = 0.06
    roll_spread: float = 0.02
    sway_angle: float = 0.02
    sway_height: float = 0.008
    forward: float = CameraMount.forward
    sway_position: float = 0.012
    heading_spread: float = 0.25
    lateral_spread: float = 0.08
    goal_radius: float = 6.0
    min_clearance: float = BODY.route_radius

    def __post_init__(self) -> None:
        if self.frames_per_path < 1 or self.goals_per_frame < 1:
            raise InputError("A camera path needs at least one frame and one goal per frame.")
        if not 0 < self.last_frame < self.min_route < self.max_route:
            raise InputError("CameraPathSampling needs 0 < last_frame < min_route < max_route [m].")


def record_camera_path(
    scene: Scene,
    seed: int,
    sampling: CameraPathSampling = CameraPathSampling(),
    intrinsics: Intrinsics = Intrinsics(),
    noise: DepthNoise | None = DepthNoise(),
    route: np.ndarray | None = None,
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
    free = np.asarray(_free_cells(arrays))
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
    return FrameSet(depth_to_millimetres(depth), mounts, goals, poses, np.zeros(n, np.int32), (scene.name,))


def cells_that_reach(scene: Scene, goal: np.ndarray) -> np.ndarray:
    """Free cells of `SCENE_GRID` from which a goal [m, world] can be reached."""
    arrays = scene.arrays()
    costs = np.asarray(_route_costs(arrays, jnp.asarray(goal, jnp.float32)))
    return np.asarray(_free_cells(arrays)) & (costs < UNREACHABLE)


@jax.jit
def _free_cells(scene: SceneArrays) -> Array:
    return free_cells(scene)


@jax.jit
def _route_costs(scene: SceneArrays, goal: Float[Array, " 2"]) -> Array:
    return route_map(scene, goal).cost


@jax.jit
def _descend(cost: Float[Array, "rows columns"], start: Float[Array, " 2"]) -> Array:
    return descend(cost, SCENE_GRID, start, 2 * max(SCENE_GRID.shape))


_clearance = jax.jit(obstacle_distance)


def _render(scene: SceneArrays, intrinsics: Intrinsics, poses: Array, mounts: Array) -> Array:
    def one(pose: Array, mount: Array) -> Array:
        rotation, position = world_camera_pose(pose, mount)
        return render_depth(scene, intrinsics, rotation, position)

    return jax.vmap(one)(poses, mounts)


render_path = jax.jit(_render, static_argnames="intrinsics")
"""Ideal depth images [m] of one scene from (n, 3) base poses and (n, 5) mounts."""


def _add_noise(keys: Array, depth: Array, noise: DepthNoise, intrinsics: Intrinsics) -> Array:
    return jax.vmap(lambda key, image: add_depth_noise(key, image, noise, intrinsics))(keys, depth)


add_path_noise = jax.jit(_add_noise, static_argnames=("noise", "intrinsics"))
"""The same images as a real sensor would see them."""


def _random_route(
    arrays: SceneArrays, free: np.ndarray, origin: np.ndarray, rng: np.random.Generator, sampling: CameraPathSampling
) -> tuple[np.ndarray, np.ndarray] | None:
    """A smoothed random route (n, 2) [m, world] and the cells from which its goal can be reached."""
    cells = np.argwhere(free)
    for _ in range(5):
        goal = _cell_centre(cells[rng.integers(len(cells))], origin)
        cost = _route_costs(arrays, jnp.asarray(goal, jnp.float32))
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


def _cell_centre(cell: np.ndarray, origin: np.ndarray) -> np.ndarray:
    return origin + (cell + 0.5) * SCENE_GRID.resolution


def _poses_along(
    route: np.ndarray, rng: np.random.Generator, sampling: CameraPathSampling, arrays: SceneArrays
) -> np.ndarray:
    """(n, 3) base poses: evenly along the route with random phase, looking half a metre ahead."""
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


def _mounts(n: int, rng: np.random.Generator, sampling: CameraPathSampling) -> np.ndarray:
    """(n, 5) camera mounts: one height, pitch and roll a path, and the gait's sway in every image."""
    height = rng.normal(sampling.height, sampling.height_spread) + rng.normal(0.0, sampling.sway_height, n)
    pitch = rng.normal(sampling.pitch, sampling.pitch_spread) + rng.normal(0.0, sampling.sway_angle, n)
    roll = rng.normal(0.0, sampling.roll_spread) + rng.normal(0.0, sampling.sway_angle, n)
    place = np.array([sampling.forward, 0.0]) + rng.normal(0.0, sampling.sway_position, (n, 2))
    return np.column_stack([height, pitch, roll, place]).astype(np.float32)


def reachable_goals(
    poses: np.ndarray,
    end: np.ndarray,
    cells: np.ndarray,
    origin: np.ndarray,
    rng: np.random.Generator,
    sampling: CameraPathSampling,
) -> np.ndarray:
    """(n, g, 2) goals in each frame's base frame: the route's end, then reachable cells, most of them ahead.

    Args:
        poses: (n, 3) base poses in the scene.
        end: (2,) [m] the route's end.
        cells: cells of `SCENE_GRID` that can be reached; origin: (2,) [m] of the grid in the scene.
        rng: of the draws.
        sampling: how many and how far.
    """
    candidates = np.argwhere(cells) * SCENE_GRID.resolution + origin + 0.5 * SCENE_GRID.resolution
    goals = np.zeros((len(poses), sampling.goals_per_frame, 2), np.float32)
    for i, (x, y, yaw) in enumerate(poses):
        offset = candidates - (x, y)
        R_base_world = host.planar_rotation(-yaw)
        goals[i, 0] = R_base_world @ (end - (x, y))
        local = offset @ R_base_world.T
        distance = np.linalg.norm(local, axis=1)
        near = (distance > 0.5) & (distance < sampling.goal_radius)
        ahead = near & (np.abs(np.arctan2(local[:, 1], local[:, 0])) < np.radians(65))
        for g in range(1, sampling.goals_per_frame):
            pool = ahead if rng.uniform() < 0.85 and ahead.any() else near
            if not pool.any():
                goals[i, g] = goals[i, 0]
                continue
            # Area grows with distance; weighting by its inverse spreads the goals evenly over distances.
            index = np.flatnonzero(pool)
            weight = 1.0 / distance[index]
            goals[i, g] = local[rng.choice(index, p=weight / weight.sum())]
    return goals

"""Goals that can be walked to from the frames of a path: where it ends, and others that lie mostly ahead."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32

from iwalker_jax.data.path_sampling import CameraPathSampling
from iwalker_jax.geometry import host
from iwalker_jax.perception import UNREACHABLE
from iwalker_jax.scenes import SCENE_RESOLUTION, Scene, SceneArrays, free_cells, route_map


def cells_that_reach(scene: Scene, goal: Float[np.ndarray, " 2"]) -> Bool[np.ndarray, "rows columns"]:
    """Free cells of the scene's grid from which a goal [m, world] can be reached."""
    arrays = scene.arrays()
    costs = np.asarray(costs_to_goal(arrays, jnp.asarray(goal, jnp.float32)))
    return np.asarray(walkable_cells(arrays)) & (costs < UNREACHABLE)


@jax.jit
def walkable_cells(scene: SceneArrays) -> Bool[Array, "rows columns"]:
    """Cells of the scene's grid where the body fits."""
    return free_cells(scene)


@jax.jit
def costs_to_goal(scene: SceneArrays, goal: Float[Array, " 2"]) -> Float[Array, "rows columns"]:
    """Cost of the comfortable route to a goal [m, world] from every cell of the scene's grid."""
    return route_map(scene, goal).cost


def reachable_goals(
    poses: Float32[np.ndarray, "n 3"],
    end: Float[np.ndarray, " 2"],
    cells: Bool[np.ndarray, "rows columns"],
    origin: Float[np.ndarray, " 2"],
    rng: np.random.Generator,
    sampling: CameraPathSampling,
) -> Float32[np.ndarray, "n g 2"]:
    """(n, g, 2) goals in each frame's base frame: the route's end, then reachable cells, most of them ahead.

    Args:
        poses: (n, 3) base poses in the scene.
        end: (2,) [m] the route's end.
        cells: cells of the scene's grid that can be reached; origin: (2,) [m] of the grid in the scene.
        rng: of the draws.
        sampling: how many and how far.
    """
    candidates = np.argwhere(cells) * SCENE_RESOLUTION + origin + 0.5 * SCENE_RESOLUTION
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

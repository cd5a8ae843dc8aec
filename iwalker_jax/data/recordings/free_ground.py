"""Where one depth image shows ground that the robot can reach: without it a frame can be given no goal."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from iwalker_jax.geometry import BODY
from iwalker_jax.perception import (
    DEFAULT_GRID,
    UNREACHABLE,
    Intrinsics,
    build_local_map,
    cost_to_go,
    halved,
    pool_2x2,
    trusted_cost,
)

FREE_GROUND_GRID = halved(DEFAULT_GRID)
"""The cells of `reachable_ground`."""

NEAREST_GOAL, FARTHEST_GOAL = 0.6, 6.0
"""[m] of goals from the base."""


@partial(jax.jit, static_argnames="camera")
def reachable_ground(
    depth: Float[Array, "height width"], mount: Float[Array, " 5"], camera: Intrinsics
) -> Bool[Array, "rows columns"]:
    """Cells of the coarse grid that the robot can reach without leaving seen free space.

    Args:
        depth: z-depth [m] through `camera`, 0 = no return.
        mount: [height, pitch, roll, forward, left] as in `CameraMount`.
        camera: of the image.
    """
    local = build_local_map(depth, mount, camera)
    free = (pool_2x2(local.known_free.astype(jnp.float32)) > 0.99) & (pool_2x2(local.esdf) > BODY.route_radius)
    to_go = cost_to_go(jnp.where(free, 1.0, jnp.inf), jnp.zeros(2), FREE_GROUND_GRID)
    return free & (trusted_cost(to_go) < UNREACHABLE)


def goal_places(reachable: Bool[np.ndarray, "rows columns"]) -> Float[np.ndarray, "n 2"]:
    """(n, 2) [m] centres of the cells of `reachable_ground` that are neither too near nor too far for a goal."""
    grid = FREE_GROUND_GRID
    centres = np.argwhere(reachable) * grid.resolution + 0.5 * grid.resolution + (grid.x_min, grid.y_min)
    distance = np.linalg.norm(centres, axis=1)
    return centres[(distance > NEAREST_GOAL) & (distance < FARTHEST_GOAL)]

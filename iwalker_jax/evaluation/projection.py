"""Where points on the floor appear in a camera's image; NumPy, for pictures and films."""

import numpy as np
from jaxtyping import Bool, Float

from iwalker_jax.perception import Intrinsics


def floor_pixels(
    points: Float[np.ndarray, "*n 2"],
    R_base_camera: Float[np.ndarray, "3 3"],
    p_base_camera: Float[np.ndarray, " 3"],
    intrinsics: Intrinsics,
    nearest: float,
) -> tuple[Float[np.ndarray, "*n 2"], Float[np.ndarray, "*n"], Bool[np.ndarray, "*n"]]:
    """Pixels (column, row) and z-depths [m] of points on the floor, and which of them lie before the camera.

    Args:
        points: [m] base frame.
        R_base_camera, p_base_camera: pose of the optical frame (x right, y down, z forward) in the base frame.
        intrinsics: of the image.
        nearest: [m] z-depth at which points nearer than it, or behind the camera, are taken to lie.
    """
    floor = np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
    seen = (floor - p_base_camera) @ R_base_camera
    inverse = 1.0 / np.maximum(seen[..., 2], nearest)
    u = intrinsics.fx * seen[..., 0] * inverse + intrinsics.cx
    v = intrinsics.fy * seen[..., 1] * inverse + intrinsics.cy
    return np.stack([u, v], axis=-1), seen[..., 2], seen[..., 2] > nearest

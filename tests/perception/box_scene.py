"""A NumPy ray caster for a floor and axis-aligned boxes, written apart from the library as an oracle for its tests."""

import numpy as np

from iwalker_jax.perception.camera import CameraMount, Intrinsics


def render(
    intrinsics: Intrinsics,
    mount: CameraMount,
    boxes: list[tuple[float, float, float, float, float, float]],
    floor: bool = True,
) -> np.ndarray:
    """z-depth [m] (0 where nothing is hit) of the floor z = 0 and boxes (x0, x1, y0, y1, z0, z1) in the base frame."""
    right, down = np.meshgrid(
        (np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx,
        (np.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy,
    )
    sin, cos = np.sin(mount.roll), np.cos(mount.roll)
    level_right, level_down = cos * right - sin * down, sin * right + cos * down
    sin, cos = np.sin(mount.pitch), np.cos(mount.pitch)
    ray = np.stack([cos - sin * level_down, -level_right, -sin - cos * level_down], axis=-1)
    eye = np.array([mount.forward, mount.left, mount.height])
    depth = np.full(right.shape, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        if floor:
            t = -eye[2] / ray[..., 2]
            depth = np.where(t > 0, t, np.inf)
        for x0, x1, y0, y1, z0, z1 in boxes:
            t_low = (np.array([x0, y0, z0]) - eye) / ray
            t_high = (np.array([x1, y1, z1]) - eye) / ray
            enter = np.minimum(t_low, t_high).max(axis=-1)
            leave = np.maximum(t_low, t_high).min(axis=-1)
            depth = np.where((enter <= leave) & (enter > 0) & (enter < depth), enter, depth)
    return np.where(np.isfinite(depth), depth, 0.0).astype(np.float32)

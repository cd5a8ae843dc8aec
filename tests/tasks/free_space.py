"""Where a robot can walk in a scene, worked out with NumPy and SciPy alone: the oracle of routes."""

import numpy as np
from scipy import ndimage

from iwalker_jax.geometry import BODY
from iwalker_jax.scenes.scene import Scene

CELL = 0.025


def clearance_map(scene: Scene, z_low: float = BODY.step_over, z_high: float = 0.75) -> np.ndarray:
    """Distance [m] of every cell to the nearest obstacle cell, in rows along x from the bounds' lower corner."""
    x_min, y_min, x_max, y_max = scene.bounds
    rows, columns = round((x_max - x_min) / CELL), round((y_max - y_min) / CELL)
    x = x_min + (np.arange(-8, rows + 8) + 0.5)[:, None] * CELL
    y = y_min + (np.arange(-8, columns + 8) + 0.5)[None] * CELL
    solid = np.zeros((rows + 16, columns + 16), bool)
    for cx, cy, cz, hx, hy, hz, yaw in scene.boxes:
        if cz - hz < z_high and cz + hz > z_low:
            turned = (x - cx + 1j * (y - cy)) * np.exp(-1j * yaw)
            solid |= (np.abs(turned.real) <= hx) & (np.abs(turned.imag) <= hy)
    for cx, cy, cz, radius, half in scene.cylinders:
        if cz - half < z_high and cz + half > z_low:
            solid |= np.abs(x - cx + 1j * (y - cy)) <= radius
    return (ndimage.distance_transform_edt(~solid) * CELL)[8:-8, 8:-8]


def cell_of(scene: Scene, point: np.ndarray) -> tuple[int, int]:
    """The cell of a point [m, world]."""
    row, column = np.floor((np.asarray(point) - scene.bounds[:2]) / CELL).astype(int)
    return row, column


def connected(scene: Scene, clearance: np.ndarray, points: np.ndarray, radius: float) -> bool:
    """Whether a disc of a radius [m] can move between all points."""
    regions, _ = ndimage.label(clearance > radius)
    labels = {regions[cell_of(scene, point)] for point in points}
    return len(labels) == 1 and 0 not in labels


def bottleneck(scene: Scene, clearance: np.ndarray, points: np.ndarray) -> float:
    """The largest radius [m] of a disc that can move between all points, to the centimetre."""
    fitting = [radius for radius in np.arange(0.1, 0.8, 0.01) if connected(scene, clearance, points, radius)]
    return max(fitting, default=0.0)

"""Plan-view clearance on a grid, worked out on the host: obstacle by obstacle, and only in the cells near each."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from iwalker_jax.perception import DEFAULT_OBSTACLES
from iwalker_jax.scenes.scene import Scene


@dataclass(frozen=True, eq=False)
class ClearanceGrid:
    """Distances from cell centres to the nearest obstacle, rows along x and columns along y.

    Attributes:
        distance: [m] exact up to the distance asked for, which stands for everything beyond; inside, minus the depth
            as in `obstacle_distance`.
        origin: (2,) [m] world position of the grid's lower corner.
        resolution: [m] side of a cell.
    """

    distance: Float[np.ndarray, "rows columns"]
    origin: Float[np.ndarray, "2"]
    resolution: float

    def centres(self, cells: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Centres [m, world] of cells."""
        return self.origin + (cells + 0.5) * self.resolution


def clearance_grid(scene: Scene, resolution: float, most: float) -> ClearanceGrid:
    """Clearance of every cell inside a scene's bounds, up to `most` [m], from what reaches into the body's height band.

    Args:
        scene: any number of obstacles.
        resolution: [m] side of a cell.
        most: [m] distance beyond which nothing is worked out.
    """
    low, high = np.array(scene.bounds[:2]), np.array(scene.bounds[2:])
    shape = np.maximum(np.round((high - low) / resolution).astype(int), 1)
    distance = np.full(shape, most)
    x, y = (low[axis] + (np.arange(shape[axis]) + 0.5) * resolution for axis in (0, 1))

    def window(centre: Float[np.ndarray, "2"], reach: Float[np.ndarray, "2"]) -> tuple[slice, slice]:
        first = np.clip(np.floor((centre - reach - most - low) / resolution).astype(int), 0, shape)
        last = np.clip(np.ceil((centre + reach + most - low) / resolution).astype(int), 0, shape)
        return slice(first[0], last[0]), slice(first[1], last[1])

    for (cx, cy, cz, hx, hy, hz, yaw), reach in zip(scene.boxes, box_reach(scene.boxes), strict=True):
        if not _in_band(cz, hz):
            continue
        cos, sin = np.cos(yaw), np.sin(yaw)
        rows, columns = window(np.array([cx, cy]), reach)
        dx, dy = x[rows, None] - cx, y[None, columns] - cy
        along, across = np.abs(cos * dx + sin * dy) - hx, np.abs(cos * dy - sin * dx) - hy
        to_box = np.hypot(np.maximum(along, 0), np.maximum(across, 0)) + np.minimum(np.maximum(along, across), 0)
        np.minimum(distance[rows, columns], to_box, out=distance[rows, columns])
    for cx, cy, cz, radius, half in scene.cylinders:
        if _in_band(cz, half):
            rows, columns = window(np.array([cx, cy]), np.full(2, radius))
            to_cylinder = np.hypot(x[rows, None] - cx, y[None, columns] - cy) - radius
            np.minimum(distance[rows, columns], to_cylinder, out=distance[rows, columns])
    return ClearanceGrid(distance, low, resolution)


def box_reach(boxes: Float[np.ndarray, "n 7"]) -> Float[np.ndarray, "n 2"]:
    """Half extents [m] of turned boxes along x and y."""
    cos, sin = np.abs(np.cos(boxes[:, 6])), np.abs(np.sin(boxes[:, 6]))
    return np.column_stack([cos * boxes[:, 3] + sin * boxes[:, 4], sin * boxes[:, 3] + cos * boxes[:, 4]])


def _in_band(centre: float, half: float) -> bool:
    return centre - half < DEFAULT_OBSTACLES.max_height and centre + half > DEFAULT_OBSTACLES.min_height

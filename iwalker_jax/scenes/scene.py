"""Indoor scenes made of boxes, upright cylinders, a floor and a ceiling, and their exact plan-view ground truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import safe_sqrt
from iwalker_jax.perception import DEFAULT_OBSTACLES

BOX_CAPACITY = 128
CYLINDER_CAPACITY = 64
MAX_EXTENT = 16.0
"""[m] longest side of a scene's free-space bounds, so that one grid shape covers every scene."""

_NO_CEILING = 1.0e3
BURIED = -1.0e3
"""[m] height of solids that are not there."""


class SceneArrays(NamedTuple):
    """A scene as fixed-shape arrays, so that one compiled program serves every scene; a pytree.

    Attributes:
        boxes: [cx, cy, cz, hx, hy, hz, yaw] centre and half sizes [m], turn about the vertical [rad].
        cylinders: [cx, cy, cz, radius, half height] of upright cylinders [m].
        ceiling: [m] height of the ceiling plane; 1000 where the scene has none.
        bounds: [x_min, y_min, x_max, y_max] of the free space [m].

    Unused rows are points buried a kilometre below the floor: no ray and no body reaches them.
    """

    boxes: Float[Array, "*batch boxes 7"]
    cylinders: Float[Array, "*batch cylinders 5"]
    ceiling: Float[Array, "*batch"]
    bounds: Float[Array, "*batch 4"]


@dataclass(frozen=True, eq=False)
class Scene:
    """An indoor scene in its world frame: z up, floor at z = 0; obstacles are solid.

    Attributes:
        name: unique name, e.g. "kitchen-17".
        family: the generator that made it.
        boxes: (B, 7) rows [cx, cy, cz, hx, hy, hz, yaw]: centre and half sizes [m], turn about the vertical [rad].
        cylinders: (C, 5) rows [cx, cy, cz, radius, half height] [m], upright.
        bounds: (x_min, y_min, x_max, y_max) [m] inside which the robot may walk.
        ceiling: [m] height of the ceiling, None without one.

    Raises:
        InputError: for arrays of the wrong shape, non-finite values, sizes that are not positive, or empty bounds.
    """

    name: str
    family: str
    boxes: np.ndarray
    cylinders: np.ndarray
    bounds: tuple[float, float, float, float]
    ceiling: float | None = None

    def __post_init__(self) -> None:
        boxes = np.array(self.boxes, np.float64)
        cylinders = np.array(self.cylinders, np.float64)
        if boxes.ndim != 2 or boxes.shape[1] != 7:
            raise InputError(f"Scene {self.name}: boxes must have shape (B, 7), got {boxes.shape}.")
        if cylinders.ndim != 2 or cylinders.shape[1] != 5:
            raise InputError(f"Scene {self.name}: cylinders must have shape (C, 5), got {cylinders.shape}.")
        if not (np.isfinite(boxes).all() and np.isfinite(cylinders).all() and np.isfinite(self.bounds).all()):
            raise InputError(f"Scene {self.name}: every number must be finite; check its boxes and cylinders.")
        if (boxes[:, 3:6] <= 0).any() or (cylinders[:, 3:5] <= 0).any():
            raise InputError(f"Scene {self.name}: half sizes and radii must be positive [m].")
        x_min, y_min, x_max, y_max = self.bounds
        if not (0 < x_max - x_min <= MAX_EXTENT and 0 < y_max - y_min <= MAX_EXTENT):
            raise InputError(
                f"Scene {self.name}: bounds {self.bounds} must be (x_min, y_min, x_max, y_max) with sides between 0 "
                f"and {MAX_EXTENT} m."
            )
        if self.ceiling is not None and not 0 < self.ceiling < _NO_CEILING:
            raise InputError(f"Scene {self.name}: the ceiling must be above the floor, got {self.ceiling} m.")
        boxes.setflags(write=False)
        cylinders.setflags(write=False)
        object.__setattr__(self, "boxes", boxes)
        object.__setattr__(self, "cylinders", cylinders)

    def arrays(self) -> SceneArrays:
        """The scene as padded JAX arrays of JAX's default precision.

        Raises:
            InputError: if it has more geoms than `BOX_CAPACITY` or `CYLINDER_CAPACITY`.
        """
        if len(self.boxes) > BOX_CAPACITY or len(self.cylinders) > CYLINDER_CAPACITY:
            raise InputError(
                f"Scene {self.name} has {len(self.boxes)} boxes and {len(self.cylinders)} cylinders but at most "
                f"{BOX_CAPACITY} and {CYLINDER_CAPACITY} fit; merge or remove some."
            )
        ceiling = _NO_CEILING if self.ceiling is None else self.ceiling
        return SceneArrays(
            jnp.asarray(_padded(self.boxes, BOX_CAPACITY), float),
            jnp.asarray(_padded(self.cylinders, CYLINDER_CAPACITY), float),
            jnp.asarray(ceiling, float),
            jnp.asarray(self.bounds, float),
        )


def _padded(rows: Float[np.ndarray, "n k"], capacity: int) -> Float[np.ndarray, "{capacity} k"]:
    padded = np.zeros((capacity, rows.shape[1]))
    padded[:, 2] = BURIED
    padded[: len(rows)] = rows
    return padded


def stack_scenes(scenes: Sequence[Scene]) -> SceneArrays:
    """The arrays of several scenes with a leading scene axis, ready for `jax.vmap`.

    Raises:
        InputError: for an empty sequence or a scene with too many geoms.
    """
    if not scenes:
        raise InputError("stack_scenes needs at least one scene.")
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *[scene.arrays() for scene in scenes])


def obstacle_distance(
    scene: SceneArrays,
    points_xy: Float[Array, "*batch 2"],
    z_low: float = DEFAULT_OBSTACLES.min_height,
    z_high: float = DEFAULT_OBSTACLES.max_height,
) -> Float[Array, "*batch"]:
    """Signed distance [m] in plan view from points to the nearest obstacle that reaches into the body's height band.

    Outside it is the exact Euclidean distance to the union of oriented rectangles and circles; inside it is negative
    and exact for a single obstacle (where obstacles overlap, the deepest one counts). Differentiable almost everywhere.

    Args:
        scene: one scene (no batch axis).
        points_xy: [m] in the scene's world frame.
        z_low, z_high: [m] the band; a geom counts if its vertical extent meets it.
    """
    dtype = points_xy.dtype
    boxes, cylinders = scene.boxes.astype(dtype), scene.cylinders.astype(dtype)
    far = jnp.asarray(2 * _NO_CEILING, dtype)
    x, y = points_xy[..., 0, None], points_xy[..., 1, None]

    dx, dy = x - boxes[:, 0], y - boxes[:, 1]
    cos, sin = jnp.cos(boxes[:, 6]), jnp.sin(boxes[:, 6])
    qx = jnp.abs(cos * dx + sin * dy) - boxes[:, 3]
    qy = jnp.abs(cos * dy - sin * dx) - boxes[:, 4]
    outside = _length(jnp.maximum(qx, 0), jnp.maximum(qy, 0))
    to_boxes = outside + jnp.minimum(jnp.maximum(qx, qy), 0)
    to_boxes = jnp.where(_in_band(boxes[:, 2], boxes[:, 5], z_low, z_high), to_boxes, far)

    to_cylinders = _length(x - cylinders[:, 0], y - cylinders[:, 1]) - cylinders[:, 3]
    to_cylinders = jnp.where(_in_band(cylinders[:, 2], cylinders[:, 4], z_low, z_high), to_cylinders, far)
    return jnp.minimum(to_boxes.min(axis=-1), to_cylinders.min(axis=-1))


def _in_band(centre: Float[Array, " n"], half: Float[Array, " n"], z_low: float, z_high: float) -> Bool[Array, " n"]:
    return (centre - half < z_high) & (centre + half > z_low)


def _length(x: Float[Array, "*shape"], y: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    return safe_sqrt(x * x + y * y)


def occupancy(
    scene: SceneArrays,
    origin: Float[Array, " 2"],
    resolution: float,
    shape: tuple[int, int],
    inflation: float = 0.0,
) -> Bool[Array, "rows columns"]:
    """Ground-truth map: True where a cell's centre is nearer than `inflation` to an obstacle or outside the bounds.

    Args:
        scene: one scene.
        origin: (x, y) [m] of the map's lowest corner in the world frame; rows run along x, columns along y.
        resolution: [m] side of a cell.
        shape: (rows, columns), fixed under jit; `MAX_EXTENT` / resolution covers any scene from its lowest corner.
        inflation: [m] radius of the robot's footprint.
    """
    x = origin[0] + (jnp.arange(shape[0], dtype=origin.dtype) + 0.5) * resolution
    y = origin[1] + (jnp.arange(shape[1], dtype=origin.dtype) + 0.5) * resolution
    points = jnp.stack(jnp.meshgrid(x, y, indexing="ij"), axis=-1)
    lower, upper = scene.bounds[:2], scene.bounds[2:]
    outside = ((points < lower) | (points > upper)).any(axis=-1)
    return outside | (obstacle_distance(scene, points) <= inflation)

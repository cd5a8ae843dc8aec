"""Indoor scenes made of boxes, upright cylinders, a floor and a ceiling, and their exact plan-view ground truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from iwalker_jax.arrays import as_doubles
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import safe_sqrt
from iwalker_jax.perception import DEFAULT_OBSTACLES


class SceneCapacity(NamedTuple):
    """What fits into scene arrays of one shape.

    Attributes:
        boxes, cylinders: most of them.
        extent: [m] longest side of the bounds.
    """

    boxes: int
    cylinders: int
    extent: float


SCENE_CAPACITIES = (
    SceneCapacity(128, 64, 16.0),
    SceneCapacity(512, 256, 51.2),
    SceneCapacity(2048, 512, 51.2),
    SceneCapacity(8192, 1024, 51.2),
)
"""Shapes of scene arrays from small to large: programs are compiled for each, and rooms do not pay for halls."""

SMALL = SCENE_CAPACITIES[0]
"""The smallest capacity of a scene's arrays."""
LARGEST = SCENE_CAPACITIES[-1]
"""The largest capacity of a scene's arrays."""

_NO_CEILING = 1.0e3
BURIED = -1.0e3
"""[m] height of solids that are not there."""
_OUT_OF_BAND = 2 * _NO_CEILING


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
        rows = {name: as_doubles(getattr(self, name), f"Scene {self.name}: {name}") for name in ("boxes", "cylinders")}
        boxes, cylinders = rows["boxes"], rows["cylinders"]
        if boxes.ndim != 2 or boxes.shape[1] != 7:
            raise InputError(f"Scene {self.name}: boxes must have shape (B, 7), got {boxes.shape}.")
        if cylinders.ndim != 2 or cylinders.shape[1] != 5:
            raise InputError(f"Scene {self.name}: cylinders must have shape (C, 5), got {cylinders.shape}.")
        bounds = as_doubles(self.bounds, f"Scene {self.name}: bounds")
        if bounds.shape != (4,):
            raise InputError(f"Scene {self.name}: bounds must be (x_min, y_min, x_max, y_max) [m], got {self.bounds}.")
        if not (np.isfinite(boxes).all() and np.isfinite(cylinders).all() and np.isfinite(bounds).all()):
            raise InputError(f"Scene {self.name}: every number must be finite; check its boxes and cylinders.")
        if (boxes[:, 3:6] <= 0).any() or (cylinders[:, 3:5] <= 0).any():
            raise InputError(f"Scene {self.name}: half sizes and radii must be positive [m].")
        x_min, y_min, x_max, y_max = self.bounds
        if not (0 < x_max - x_min <= LARGEST.extent and 0 < y_max - y_min <= LARGEST.extent):
            raise InputError(
                f"Scene {self.name}: bounds {self.bounds} must be (x_min, y_min, x_max, y_max) with sides between 0 "
                f"and {LARGEST.extent} m."
            )
        ceiling = as_doubles(1.0 if self.ceiling is None else self.ceiling, f"Scene {self.name}: the ceiling")
        if ceiling.shape != () or not 0 < ceiling < _NO_CEILING:
            raise InputError(f"Scene {self.name}: the ceiling must be above the floor, got {self.ceiling} m.")
        boxes.setflags(write=False)
        cylinders.setflags(write=False)
        object.__setattr__(self, "boxes", boxes)
        object.__setattr__(self, "cylinders", cylinders)

    @property
    def capacity(self) -> SceneCapacity:
        """The smallest of `SCENE_CAPACITIES` that holds it.

        Raises:
            InputError: if none does.
        """
        side = max(self.bounds[2] - self.bounds[0], self.bounds[3] - self.bounds[1])
        for capacity in SCENE_CAPACITIES:
            fits = len(self.boxes) <= capacity.boxes and len(self.cylinders) <= capacity.cylinders
            if fits and side <= capacity.extent:
                return capacity
        raise InputError(
            f"Scene {self.name} has {len(self.boxes)} boxes and {len(self.cylinders)} cylinders but at most "
            f"{LARGEST.boxes} and {LARGEST.cylinders} fit; merge or remove some."
        )

    def arrays(self, capacity: SceneCapacity | None = None) -> SceneArrays:
        """The scene as padded JAX arrays of JAX's default precision.

        Args:
            capacity: one that holds it; by default the smallest that does.

        Raises:
            InputError: if it has more geoms than fit.
        """
        capacity = self.capacity if capacity is None else capacity
        ceiling = _NO_CEILING if self.ceiling is None else self.ceiling
        return SceneArrays(
            jnp.asarray(_padded(self.boxes, capacity.boxes), float),
            jnp.asarray(_padded(self.cylinders, capacity.cylinders), float),
            jnp.asarray(ceiling, float),
            jnp.asarray(self.bounds, float),
        )


def _padded(rows: Float[np.ndarray, "n k"], capacity: int) -> Float[np.ndarray, "{capacity} k"]:
    padded = np.zeros((capacity, rows.shape[1]))
    padded[:, 2] = BURIED
    padded[: len(rows)] = rows
    return padded


def common_capacity(scenes: Sequence[Scene]) -> SceneCapacity:
    """The smallest of `SCENE_CAPACITIES` that holds every one of at least one scene.

    Raises:
        InputError: for a scene with too many geoms.
    """
    return max((scene.capacity for scene in scenes), key=SCENE_CAPACITIES.index)


def stack_scenes(scenes: Sequence[Scene], capacity: SceneCapacity | None = None) -> SceneArrays:
    """The arrays of several scenes with a leading scene axis, ready for `jax.vmap`.

    Args:
        scenes: at least one.
        capacity: one that holds them all; by default the smallest that does.

    Raises:
        InputError: for an empty sequence or a scene with too many geoms.
    """
    if not scenes:
        raise InputError("stack_scenes needs at least one scene.")
    capacity = common_capacity(scenes) if capacity is None else capacity
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *[scene.arrays(capacity) for scene in scenes])


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
    x, y = points_xy[..., 0, None], points_xy[..., 1, None]
    to_boxes = plan_distance_to_boxes(boxes, x, y, z_low, z_high)
    to_cylinders = plan_distance_to_cylinders(cylinders, x, y, z_low, z_high)
    return jnp.minimum(to_boxes.min(axis=-1), to_cylinders.min(axis=-1))


def plan_distance_to_boxes(
    boxes: Float[Array, "n 7"], x: Float[Array, "*batch 1"], y: Float[Array, "*batch 1"], z_low: float, z_high: float
) -> Float[Array, "*batch n"]:
    """Signed distance [m] in plan view from (x, y) to each box; 2 km to those outside a height band."""
    dx, dy = x - boxes[:, 0], y - boxes[:, 1]
    cos, sin = jnp.cos(boxes[:, 6]), jnp.sin(boxes[:, 6])
    qx = jnp.abs(cos * dx + sin * dy) - boxes[:, 3]
    qy = jnp.abs(cos * dy - sin * dx) - boxes[:, 4]
    outside = _length(jnp.maximum(qx, 0), jnp.maximum(qy, 0))
    to_boxes = outside + jnp.minimum(jnp.maximum(qx, qy), 0)
    return jnp.where(_in_band(boxes[:, 2], boxes[:, 5], z_low, z_high), to_boxes, jnp.asarray(_OUT_OF_BAND, x.dtype))


def plan_distance_to_cylinders(
    cylinders: Float[Array, "n 5"],
    x: Float[Array, "*batch 1"],
    y: Float[Array, "*batch 1"],
    z_low: float,
    z_high: float,
) -> Float[Array, "*batch n"]:
    """Signed distance [m] in plan view from (x, y) to each cylinder; 2 km to those outside a height band."""
    to_cylinders = _length(x - cylinders[:, 0], y - cylinders[:, 1]) - cylinders[:, 3]
    in_band = _in_band(cylinders[:, 2], cylinders[:, 4], z_low, z_high)
    return jnp.where(in_band, to_cylinders, jnp.asarray(_OUT_OF_BAND, x.dtype))


def _in_band(centre: Float[Array, " n"], half: Float[Array, " n"], z_low: float, z_high: float) -> Bool[Array, " n"]:
    return (centre - half < z_high) & (centre + half > z_low)


def _length(x: Float[Array, "*shape"], y: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    return safe_sqrt(x * x + y * y)

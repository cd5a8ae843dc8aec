"""The robot's body as a cloud of spheres, and how far it is from a scene's obstacles."""

import math
from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import jax.numpy as jnp
import mujoco
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY, safe_sqrt
from iwalker_jax.robot import RobotModel, body_poses
from iwalker_jax.scenes import BURIED, SCENE_CAPACITIES, SceneArrays

TOLERANCE = 0.01
"""[m] by which spheres may stand out of the body or fall short of its surface, at most."""

NEAR_BOXES, NEAR_CYLINDERS = 32, 16
"""Obstacles that a clearance looks at; more than the densest small scenes have within a step of the body."""

NEAR_BOXES_OF_MANY = 192
"""Of scenes beyond the small ones, whose scanned surfaces consist of many boxes as small as a voxel."""

_VOLUME_GROUP = 2
_MOST_CELLS = 24


class BodyVolume(NamedTuple):
    """Spheres fixed to the robot's bodies; a pytree.

    Attributes:
        bodies: (n,) MuJoCo's number of the body that carries each sphere.
        offsets: (n, 3) [m] centres in the body's frame.
        radii: (n,) [m].
    """

    bodies: Int[Array, " n"]
    offsets: Float[Array, "n 3"]
    radii: Float[Array, " n"]


def load_body_volume(model: mujoco.MjModel) -> BodyVolume:
    """Spheres for every geom of the model's volume (group 2) and for the feet's contact geoms.

    The surfaces of spheres and geoms are at most `TOLERANCE` apart, so distances to obstacles are too.

    Raises:
        InputError: the robot has no such geoms, or one that spheres cannot fill within the tolerance.
    """
    bodies: list[int] = []
    spheres: list[np.ndarray] = []
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        touches = bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
        if body == 0 or not (model.geom_group[geom] == _VOLUME_GROUP or touches):
            continue
        filling = _filling(mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom], model.geom(geom).name or geom)
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        filling[:, :3] = filling[:, :3] @ rotation.reshape(3, 3).T + model.geom_pos[geom]
        bodies += [body] * len(filling)
        spheres.append(filling)
    if not spheres:
        raise InputError(f"The robot has no geoms in group {_VOLUME_GROUP}; put the body's volume there.")
    rows, owners = np.concatenate(spheres), np.asarray(bodies)
    kept = _outermost(rows, owners)
    return BodyVolume(
        jnp.asarray(owners[kept], jnp.int32), jnp.asarray(rows[kept, :3], float), jnp.asarray(rows[kept, 3], float)
    )


def body_clearance(
    volume: BodyVolume,
    body_positions: Float[Array, "nbody 3"],
    body_rotations: Float[Array, "nbody 3 3"],
    scene: SceneArrays,
) -> Float[Array, ""]:
    """Least signed distance [m] between the body and the scene's boxes and cylinders; negative where they overlap.

    Exact for the spheres, among the `NEAR_BOXES` boxes (in large scenes `NEAR_BOXES_OF_MANY`) and `NEAR_CYLINDERS`
    cylinders nearest to the body's middle; floor and ceiling do not count, nor what ends at `BODY.step_over` or below.
    Inside an obstacle it is minus the way out of that obstacle.

    Args:
        volume: the body's spheres.
        body_positions: [m] world frame, in MuJoCo's order (`xpos`).
        body_rotations: from body to world axes (`xmat`).
        scene: one scene.
    """
    centres = body_positions[volume.bodies] + jnp.einsum("nij,nj->ni", body_rotations[volume.bodies], volume.offsets)
    middle = lax.stop_gradient(centres.mean(axis=0, keepdims=True))
    boxes, cylinders = (
        _without_low(rows.astype(centres.dtype), half) for rows, half in ((scene.boxes, 5), (scene.cylinders, 4))
    )
    near = NEAR_BOXES if len(boxes) < SCENE_CAPACITIES[1].boxes else NEAR_BOXES_OF_MANY
    boxes = boxes[lax.top_k(-_to_boxes(middle, boxes)[0], near)[1]]
    cylinders = cylinders[lax.top_k(-_to_cylinders(middle, cylinders)[0], NEAR_CYLINDERS)[1]]
    nearest = jnp.minimum(_to_boxes(centres, boxes).min(axis=1), _to_cylinders(centres, cylinders).min(axis=1))
    return jnp.min(nearest - volume.radii)


def body_clearance_at(
    robot: RobotModel, volume: BodyVolume, scene: SceneArrays, qpos: Float[Array, " nq"]
) -> Float[Array, ""]:
    """`body_clearance` [m] of a robot in a state.

    Args:
        robot: that the volume was read from.
        volume: the body's spheres.
        scene: one scene.
        qpos: (nq,) base position [m] and quaternion (wxyz), joint positions [rad].
    """
    return body_clearance(volume, *body_poses(robot.model, qpos), scene)


def _without_low(solids: Float[Array, "n k"], half: int) -> Float[Array, "n k"]:
    """Solids of which those that count as floor are buried; column 2 is the centre's height, `half` half the height."""
    low = solids[:, 2] + solids[:, half] <= BODY.step_over
    return solids.at[:, 2].set(jnp.where(low, BURIED, solids[:, 2]))


def _to_boxes(points: Float[Array, "n 3"], boxes: Float[Array, "boxes 7"]) -> Float[Array, "n boxes"]:
    """Signed distances [m] from points to boxes."""
    dx, dy, dz = (points[:, axis, None] - boxes[:, axis] for axis in range(3))
    cos, sin = jnp.cos(boxes[:, 6]), jnp.sin(boxes[:, 6])
    along, across = jnp.abs(cos * dx + sin * dy), jnp.abs(cos * dy - sin * dx)
    return _outside(along - boxes[:, 3], across - boxes[:, 4], jnp.abs(dz) - boxes[:, 5])


def _to_cylinders(points: Float[Array, "n 3"], cylinders: Float[Array, "cylinders 5"]) -> Float[Array, "n cylinders"]:
    """Signed distances [m] from points to upright cylinders."""
    dx, dy, dz = (points[:, axis, None] - cylinders[:, axis] for axis in range(3))
    return _outside(safe_sqrt(dx**2 + dy**2) - cylinders[:, 3], jnp.abs(dz) - cylinders[:, 4])


def _outside(*excess: Array) -> Array:
    """Signed distance to a solid from how far a point lies beyond its faces, one number an axis."""
    squared = jnp.zeros_like(excess[0])
    deepest = excess[0]
    for one in excess:
        squared = squared + jnp.maximum(one, 0) ** 2
        deepest = jnp.maximum(deepest, one)
    return safe_sqrt(squared) + jnp.minimum(deepest, 0)


def _filling(kind: mujoco.mjtGeom, size: np.ndarray, name: object) -> Float[np.ndarray, "n 4"]:
    """Centres and radii [m] of spheres that fill a geom in its own frame."""
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.array([[0.0, 0.0, 0.0, size[0]]])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return _capsule(size[0], size[1])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _cells(size[[0, 0, 1]], lambda cell: (min(size[0], cell[2]), math.hypot(size[0], cell[2])), name, (0, 1))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return _cells(size, lambda cell: (min(cell), math.hypot(*cell)), name)
    raise InputError(
        f"The robot's geom {name} is a {kind.name}; build its volume of boxes, spheres, capsules, cylinders."
    )


def _capsule(radius: float, half: float) -> Float[np.ndarray, "n 4"]:
    # Between two neighbours the surface sinks by radius - sqrt(radius^2 - (gap / 2)^2).
    gap = 2 * math.sqrt(radius**2 - max(radius - TOLERANCE, 0.0) ** 2)
    along = np.linspace(-half, half, 1 + math.ceil(2 * half / gap))
    return np.stack([0 * along, 0 * along, along, np.full_like(along, radius)], axis=1)


def _cells(
    half: np.ndarray, reach: Callable[[np.ndarray], tuple[float, float]], name: object, whole: tuple[int, ...] = ()
) -> Float[np.ndarray, "n 4"]:
    """A sphere in each cell of the coarsest grid over a box that keeps the tolerance.

    `reach` gives the distances from a cell's centre to its nearest face and its farthest corner for the cell's half
    sizes; axes in `whole` are not cut.
    """
    counts = [range(1, 2 if axis in whole else _MOST_CELLS) for axis in range(3)]
    for count in sorted(product(*counts), key=lambda count: (math.prod(count), max(count))):
        cell = half / count
        near, far = reach(cell)
        if far - near <= 2 * TOLERANCE:
            axes = [side * (2 * np.arange(n) + 1 - n) for side, n in zip(cell, count)]
            centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
            return np.column_stack([centres, np.full(len(centres), (near + far) / 2)])
    raise InputError(f"The robot's geom {name} is too thick to be filled with spheres; split it into smaller geoms.")


def _outermost(spheres: Float[np.ndarray, "n 4"], owners: Int[np.ndarray, " n"]) -> Int[np.ndarray, " kept"]:
    """Indices of the spheres that no other sphere of the same body contains."""
    kept = list(range(len(spheres)))
    for i in sorted(kept, key=lambda i: spheres[i, 3]):
        others = [j for j in kept if j != i and owners[j] == owners[i]]
        gaps = np.linalg.norm(spheres[others, :3] - spheres[i, :3], axis=1) + spheres[i, 3] - spheres[others, 3]
        if (gaps <= 1e-9).any():
            kept.remove(i)
    return np.asarray(kept)

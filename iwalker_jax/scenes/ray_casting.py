"""Depth images of a scene by analytic ray casting against boxes, upright cylinders, floor and ceiling."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.perception import Intrinsics, camera_pose
from iwalker_jax.scenes.scene import SceneArrays

_TINY = 1e-12
_FAR = 1e6


class _Solids(NamedTuple):
    """What a ray may hit besides the floor; the rows that are looked at come first.

    Attributes:
        boxes, cylinders: rows as in `Scene`.
        ceiling: [m] its height.
    """

    boxes: Float[Array, "boxes 7"]
    cylinders: Float[Array, "cylinders 5"]
    ceiling: Float[Array, ""]


class _Counts(NamedTuple):
    """How many of the first rows to look at."""

    boxes: Int[Array, ""]
    cylinders: Int[Array, ""]


_Hits = tuple[Float[Array, " rays"], Int[Array, " rays"]]


def world_camera_pose(
    base_pose: Float[Array, " 3"], mount: Float[Array, " 5"]
) -> tuple[Float[Array, "3 3"], Float[Array, " 3"]]:
    """R_world_camera and p_world_camera [m] of a camera on a robot that stands at (x, y, yaw) in the scene.

    Args:
        base_pose: (x [m], y [m], yaw [rad]) of the robot's `base` frame.
        mount: [height, pitch, roll, forward, left] as in `CameraMount`.
    """
    R_base_camera, p_base = camera_pose(mount)
    cos, sin = jnp.cos(base_pose[2]), jnp.sin(base_pose[2])
    zero, one = jnp.zeros_like(cos), jnp.ones_like(cos)
    R_world_base = jnp.stack([jnp.stack([cos, -sin, zero]), jnp.stack([sin, cos, zero]), jnp.stack([zero, zero, one])])
    p_world_base = jnp.stack([base_pose[0], base_pose[1], zero])
    return R_world_base @ R_base_camera, R_world_base @ p_base + p_world_base


def render_depth(
    scene: SceneArrays,
    intrinsics: Intrinsics,
    R_world_camera: Float[Array, "3 3"],
    p_world_camera: Float[Array, " 3"],
    max_depth: float | Float[Array, ""] = 10.0,
) -> Float[Array, "height width"]:
    """Ideal z-depth image [m] of one scene from one pose; 0 where nothing lies within `max_depth`.

    Surfaces are seen from both sides: a camera inside an obstacle sees that obstacle's inner face. Derivatives with
    respect to pose and geoms are those of the surface each pixel sees; silhouettes, where pixels jump between
    surfaces, contribute nothing. vmap over poses and scenes.

    Args:
        scene: one scene.
        intrinsics: of the image.
        R_world_camera, p_world_camera: camera pose (optical frame: x right, y down, z forward) in the scene's frame.
        max_depth: [m] along the optical axis.
    """
    dtype = p_world_camera.dtype
    # Rays are scaled to z = 1 in the optical frame, so the ray parameter is the z-depth itself.
    rays = R_world_camera.astype(dtype) @ intrinsics.rays().astype(dtype).reshape(-1, 3).T
    boxes, cylinders = scene.boxes.astype(dtype), scene.cylinders.astype(dtype)
    box_seen, cylinder_seen = _in_view(
        boxes, cylinders, *_view_planes(intrinsics, R_world_camera.astype(dtype), max_depth), p_world_camera
    )
    solids = _Solids(boxes[jnp.argsort(~box_seen)], cylinders[jnp.argsort(~cylinder_seen)], scene.ceiling.astype(dtype))
    depth = _first_hit(solids, p_world_camera, rays, _Counts(box_seen.sum(), cylinder_seen.sum()))
    return jnp.where(depth <= max_depth, depth, 0).reshape(intrinsics.height, intrinsics.width)


def _view_planes(
    intrinsics: Intrinsics, R_world_camera: Float[Array, "3 3"], max_depth: float | Float[Array, ""]
) -> tuple[Float[Array, "6 3"], Float[Array, " 6"]]:
    # The view volume is {x: normal . (x - p) + offset >= 0 for all six planes}: sides, near and far.
    left, right = -intrinsics.cx / intrinsics.fx, (intrinsics.width - 1 - intrinsics.cx) / intrinsics.fx
    top, bottom = -intrinsics.cy / intrinsics.fy, (intrinsics.height - 1 - intrinsics.cy) / intrinsics.fy
    normals = jnp.asarray(
        [[1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom], [0, 0, 1], [0, 0, -1]], R_world_camera.dtype
    )
    # A millimetre of slack keeps rounding from culling what a border pixel just sees.
    offsets = jnp.full(6, 1e-3, R_world_camera.dtype).at[5].add(max_depth)
    return normals @ R_world_camera.T, offsets


def _in_view(
    boxes: Float[Array, "boxes 7"],
    cylinders: Float[Array, "cylinders 5"],
    normals: Float[Array, "6 3"],
    offsets: Float[Array, " 6"],
    origin: Float[Array, " 3"],
) -> tuple[Bool[Array, " boxes"], Bool[Array, " cylinders"]]:
    # A convex geom is out of view if its support point along some plane's normal lies behind that plane.
    n_x, n_y, n_z = normals[:, 0, None], normals[:, 1, None], normals[:, 2, None]
    cos, sin = jnp.cos(boxes[:, 6]), jnp.sin(boxes[:, 6])
    box_reach = (
        jnp.abs(n_x * cos + n_y * sin) * boxes[:, 3]
        + jnp.abs(n_y * cos - n_x * sin) * boxes[:, 4]
        + jnp.abs(n_z) * boxes[:, 5]
    )
    cylinder_reach = jnp.hypot(n_x, n_y) * cylinders[:, 3] + jnp.abs(n_z) * cylinders[:, 4]
    box_seen = normals @ (boxes[:, :3] - origin).T + box_reach + offsets[:, None] >= 0
    cylinder_seen = normals @ (cylinders[:, :3] - origin).T + cylinder_reach + offsets[:, None] >= 0
    return box_seen.all(axis=0), cylinder_seen.all(axis=0)


@jax.custom_jvp
def _first_hit(
    solids: _Solids, origin: Float[Array, " 3"], rays: Float[Array, "3 rays"], counts: _Counts
) -> Float[Array, " rays"]:
    """Ray parameter of the first surface along each ray, looking at the first rows alone."""
    return _search(solids, origin, rays, counts)[0]


@_first_hit.defjvp
def _first_hit_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    # A loop of dynamic length has no reverse mode, and needs none: the derivative is that of the geom that was hit.
    depth, winner = _search(*primals)
    box_rows, cylinder_rows = len(primals[0].boxes), len(primals[0].cylinders)

    def hit_by_winner(
        solids: _Solids, origin: Float[Array, " 3"], rays: Float[Array, "3 rays"]
    ) -> Float[Array, " rays"]:
        box = solids.boxes[jnp.clip(winner, 0, box_rows - 1)].T
        cylinder = solids.cylinders[jnp.clip(winner - box_rows, 0, cylinder_rows - 1)].T
        solid = jnp.where(
            winner < box_rows, _box_hit(_seen_from(box, origin), rays), _cylinder_hit(cylinder, origin, rays)
        )
        return jnp.where(winner >= 0, solid, _floor_or_ceiling_hit(solids.ceiling, origin, rays))

    _, tangent = jax.jvp(hit_by_winner, primals[:3], tangents[:3])
    return depth, tangent


def _search(solids: _Solids, origin: Float[Array, " 3"], rays: Float[Array, "3 rays"], counts: _Counts) -> _Hits:
    # Also returns what was hit: box row, number of boxes + cylinder row, or -1 for floor and ceiling.
    local_boxes = _seen_from(solids.boxes.T, origin)

    def closer(best: _Hits, hit: Float[Array, " rays"], index: Int[Array, ""]) -> _Hits:
        depth, winner = best
        return jnp.minimum(hit, depth), jnp.where(hit < depth, index, winner)

    def add_box(i: Int[Array, ""], best: _Hits) -> _Hits:
        return closer(best, _box_hit(local_boxes[:, i], rays), i)

    def add_cylinder(i: Int[Array, ""], best: _Hits) -> _Hits:
        return closer(best, _cylinder_hit(solids.cylinders[i], origin, rays), i + len(solids.boxes))

    best = (_floor_or_ceiling_hit(solids.ceiling, origin, rays), jnp.full(rays.shape[1], -1))
    best = lax.fori_loop(0, counts.boxes, add_box, best)
    return lax.fori_loop(0, counts.cylinders, add_cylinder, best)


def _seen_from(boxes: Float[Array, "7 n"], origin: Float[Array, " 3"]) -> Float[Array, "8 n"]:
    # Ray origin in each box's own axes, half sizes, cosine and sine of yaw: everything that does not depend on the ray.
    cos, sin = jnp.cos(boxes[6]), jnp.sin(boxes[6])
    dx, dy, dz = origin[0] - boxes[0], origin[1] - boxes[1], origin[2] - boxes[2]
    return jnp.stack([cos * dx + sin * dy, cos * dy - sin * dx, dz, boxes[3], boxes[4], boxes[5], cos, sin])


def _nonzero(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    # A ray parallel to a face then meets that face's plane a trillion metres away instead of giving 0 / 0.
    return jnp.where(jnp.abs(x) < _TINY, _TINY, x)


def _slab(
    start: Float[Array, "..."], half: Float[Array, "..."], direction: Float[Array, " rays"]
) -> tuple[Float[Array, " rays"], Float[Array, " rays"]]:
    inverse = 1 / _nonzero(direction)
    middle, reach = -start * inverse, half * jnp.abs(inverse)
    return middle - reach, middle + reach


def _first_positive(enter: Float[Array, " rays"], leave: Float[Array, " rays"]) -> Float[Array, " rays"]:
    # The solid is the interval [enter, leave]; from inside, the ray meets the far face.
    hit = jnp.where(enter > 0, enter, leave)
    return jnp.where((enter <= leave) & (leave > 0), hit, _FAR)


def _box_hit(local_box: Float[Array, "8 ..."], rays: Float[Array, "3 rays"]) -> Float[Array, " rays"]:
    x, y, z, hx, hy, hz, cos, sin = local_box
    enter_x, leave_x = _slab(x, hx, cos * rays[0] + sin * rays[1])
    enter_y, leave_y = _slab(y, hy, cos * rays[1] - sin * rays[0])
    enter_z, leave_z = _slab(z, hz, rays[2])
    enter = jnp.maximum(jnp.maximum(enter_x, enter_y), enter_z)
    leave = jnp.minimum(jnp.minimum(leave_x, leave_y), leave_z)
    return _first_positive(enter, leave)


def _cylinder_hit(
    cylinder: Float[Array, "5 ..."], origin: Float[Array, " 3"], rays: Float[Array, "3 rays"]
) -> Float[Array, " rays"]:
    x, y, z = origin[0] - cylinder[0], origin[1] - cylinder[1], origin[2] - cylinder[2]
    # A vertical ray never crosses the side; tilted by a millionth it does so far away.
    is_vertical = rays[0] ** 2 + rays[1] ** 2 < _TINY
    dx, dy = jnp.where(is_vertical, _TINY**0.5, rays[0]), jnp.where(is_vertical, 0, rays[1])
    # |o + t d|^2 = r^2 in plan view: a t^2 + 2 b t + c = 0.
    a, b = dx**2 + dy**2, x * dx + y * dy
    # The discriminant by the cross product (Lagrange's identity): b^2 - a c would cancel at a distance.
    cross = x * dy - y * dx
    discriminant = a * cylinder[3] ** 2 - cross**2
    root = jnp.sqrt(jnp.where(discriminant > 0, discriminant, 1))
    enter_z, leave_z = _slab(z, cylinder[4], rays[2])
    enter = jnp.maximum((-b - root) / a, enter_z)
    leave = jnp.minimum((-b + root) / a, leave_z)
    return jnp.where(discriminant > 0, _first_positive(enter, leave), _FAR)


def _floor_or_ceiling_hit(
    ceiling: Float[Array, ""], origin: Float[Array, " 3"], rays: Float[Array, "3 rays"]
) -> Float[Array, " rays"]:
    # Planes are one-sided: the floor is seen from above, the ceiling from below.
    inverse = 1 / _nonzero(rays[2])
    hit = jnp.where(rays[2] < 0, -origin[2], ceiling - origin[2]) * inverse
    return jnp.where((hit > 0) & (hit < _FAR), hit, _FAR)

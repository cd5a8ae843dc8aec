"""Footsteps about a path: nominal placement, and where a footstep stands in the path's own frame.

With y to the left, a left foot lies at +width/2 of the path and a right foot at -width/2.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.geometry import arc_length, footstep_signs, interpolate_along, path_tangents
from iwalker_jax.planning.robot_state import StepGeometry


def nominal_footsteps(
    path: Float[Array, "n 2"], stance_sign: Float[Array, ""], geometry: StepGeometry
) -> tuple[Float[Array, "m 2"], Float[Array, "m 2"]]:
    """Footsteps [m] at even advances along the path, left ones at +width/2, and the path's unit tangents there.

    A path shorter than `count * length` ends in stepping on the spot beside its end point.
    """
    lengths = arc_length(path)
    advance = geometry.length * (jnp.arange(geometry.count, dtype=path.dtype) + 1.0)
    values = interpolate_along(lengths, jnp.concatenate([path, path_tangents(path)], axis=-1), advance)
    centres = values[:, :2]
    tangents = values[:, 2:] / jnp.sqrt(jnp.sum(values[:, 2:] ** 2, axis=-1, keepdims=True) + 1e-12)
    signs = footstep_signs(stance_sign, geometry.count)[:, None]
    normals = jnp.stack([-tangents[:, 1], tangents[:, 0]], axis=-1)
    return centres + signs * geometry.width / 2 * normals, tangents


class PathProgress(NamedTuple):
    """How far along a path footsteps lie.

    Attributes:
        along: (m,) [m] arc length of the path's point closest to each footstep.
        total: () [m] length of the path.
    """

    along: Float[Array, " m"]
    total: Float[Array, ""]


def closest_on_path(
    path: Float[Array, "n 2"], footsteps: Float[Array, "m 2"]
) -> tuple[Float[Array, " m"], PathProgress]:
    """Lateral offset [m] (left positive) and progress of each footstep relative to the path's closest point.

    The closest point is found among the path's points and refined along the tangent there, so both values are
    differentiable with respect to footsteps and path while the choice of the point is held fixed. Eqs. 12-14.
    """
    tangents = path_tangents(path)
    lengths = arc_length(path)
    squared = jnp.sum((footsteps[:, None, :] - path[None, :, :]) ** 2, axis=-1)
    nearest = jnp.argmin(squared, axis=1)
    offset = footsteps - path[nearest]
    tangent = tangents[nearest]
    along = lengths[nearest] + jnp.sum(offset * tangent, axis=-1)
    lateral = tangent[:, 0] * offset[:, 1] - tangent[:, 1] * offset[:, 0]
    return lateral, PathProgress(along, lengths[-1])

"""Plain geometry that every other room stands on: the plane, rotations, splines, lengths, and the two feet."""

from iwalker_jax.geometry.body import BODY, BodyParameters
from iwalker_jax.geometry.norms import safe_norm, safe_sqrt
from iwalker_jax.geometry.planar import to_base, to_world, turn
from iwalker_jax.geometry.rotations import (
    angle_between,
    quaternion_product,
    rotation_matrix,
    tilt_error,
    turn_about_vertical,
    turn_in_body,
    wrap_angle,
    yaw_of,
)
from iwalker_jax.geometry.sides import Side, footstep_signs, other_side, side_of_step, side_sign
from iwalker_jax.geometry.splines import (
    arc_length,
    hermite_path,
    interpolate_along,
    path_tangents,
    resample_by_arc_length,
    smooth_step,
)

__all__ = [
    "BODY",
    "BodyParameters",
    "Side",
    "angle_between",
    "arc_length",
    "footstep_signs",
    "hermite_path",
    "interpolate_along",
    "other_side",
    "path_tangents",
    "quaternion_product",
    "resample_by_arc_length",
    "rotation_matrix",
    "safe_norm",
    "safe_sqrt",
    "side_of_step",
    "side_sign",
    "smooth_step",
    "tilt_error",
    "to_base",
    "to_world",
    "turn",
    "turn_about_vertical",
    "turn_in_body",
    "wrap_angle",
    "yaw_of",
]

"""Where the next foot may land: bounds on each step in its heading frame, and which COM states they can catch."""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Num

from iwalker_jax.checks import Scalar, field_values, require_range
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import footstep_signs

_LEAST = 1e-3  # room [m] below which two bounds count as contradicting


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class StepReach:
    """Bounds on a step, foot to foot, in the frame of its heading; a pytree, so that any of them may be traced.

    Attributes:
        sagittal: largest step forward or backward [m].
        lateral_min: smallest sideways distance, on the swing foot's own side, so that the legs never cross [m].
        lateral_max: largest sideways distance on that side [m].
    """

    sagittal: Scalar = 0.20
    lateral_min: Scalar = 0.04
    lateral_max: Scalar = 0.20

    def __post_init__(self) -> None:
        require_range(self, "sagittal", 0.001, 10.0, "m")
        require_range(self, "lateral_min", -10.0, 10.0, "m")
        require_range(self, "lateral_max", -10.0, 10.0, "m")
        plain = [x for x in (self.lateral_min, self.lateral_max) if isinstance(x, (int, float))]
        if len(plain) == 2 and plain[1] - plain[0] < _LEAST:
            raise InputError(
                f"StepReach.lateral_min {plain[0]} m is not 1 mm below lateral_max {plain[1]} m; widen them."
            )


def sanitise_reach(reach: StepReach, dtype: Any) -> tuple[StepReach, Bool[Array, ""], Bool[Array, ""]]:
    """Bounds that leave room, whether all were finite, and whether they contradicted each other.

    Contradicting traced bounds are moved as little as leaves a millimetre; non-finite ones become the defaults.
    """
    limits = jnp.stack([jnp.asarray(x, dtype) for x in field_values(reach)])
    finite = jnp.all(jnp.isfinite(limits))
    sagittal, nearest, farthest = jnp.where(finite, limits, jnp.asarray(field_values(StepReach()), dtype))
    empty = (sagittal < _LEAST) | (farthest - nearest < _LEAST)
    middle = (nearest + farthest) / 2
    nearest = jnp.where(farthest - nearest < _LEAST, middle - _LEAST / 2, nearest)
    farthest = jnp.maximum(farthest, nearest + _LEAST)
    return StepReach(jnp.maximum(sagittal, _LEAST), nearest, farthest), finite, empty


def step_bounds(
    reach: StepReach, stance: Num[Array, ""], horizon: int
) -> tuple[Float[Array, "n 2"], Float[Array, "n 2"]]:
    """Lowest and highest (sagittal, lateral) size of steps u_0..u_{N-1} [m].

    Args:
        stance: `side_sign` of the CURRENT stance foot; +1 if it is the left one: step 0 then moves the right foot,
            whose lateral step is negative (y to the left).
    """
    signs = footstep_signs(stance, horizon)
    near, far = signs * reach.lateral_min, signs * reach.lateral_max
    forward = jnp.broadcast_to(reach.sagittal, near.shape)
    return (
        jnp.stack([-forward, jnp.minimum(near, far)], axis=1),
        jnp.stack([forward, jnp.maximum(near, far)], axis=1),
    )


def heading_axes(headings: Float[Array, " n"]) -> Float[Array, "n 2 2"]:
    """Rows are the sagittal and the lateral (left) axis of each heading [rad]."""
    cos, sin = jnp.cos(headings), jnp.sin(headings)
    return jnp.stack([jnp.stack([cos, sin], -1), jnp.stack([-sin, cos], -1)], axis=-2)


def capture_margin(
    pole: Float[Array, ""],
    axes: Float[Array, "n 2 2"],
    low: Float[Array, "n 2"],
    high: Float[Array, "n 2"],
    divergent: Float[Array, "2"],
) -> tuple[Float[Array, ""], Float[Array, "2"]]:
    """How far the divergent component lies out in the set that steps within reach can catch, and the set's centre.

    The COM stays bounded if and only if xi_0 = sum_k pole^-k u_k, so the set is the Minkowski sum of the turned and
    shrunken boxes: a zonotope, whose facets are normal to the boxes' own axes. After the last step the walk goes on
    in its last heading with alternating feet.

    Returns:
        The ratio, 0 at the centre and 1 on the boundary; the centre (2,) [m].
    """
    decay = pole ** -jnp.arange(axes.shape[0] + 1, dtype=low.dtype)
    middle, half = (low + high) / 2, (high - low) / 2
    # The tail alternates the last step's mirror image and itself.
    tail_middle = middle[-1] * jnp.stack([1 / (1 - 1 / pole), -1 / (1 + 1 / pole)])
    all_axes = jnp.concatenate([axes, axes[-1:]])
    middles = decay[:, None] * jnp.concatenate([middle, tail_middle[None]])
    halves = decay[:, None] * jnp.concatenate([half, half[-1:] / (1 - 1 / pole)])
    centre = jnp.einsum("kij,ki->j", all_axes, middles)
    normals = axes.reshape(-1, 2)
    width = jnp.einsum("ki,dki->d", halves, jnp.abs(jnp.einsum("dj,kij->dki", normals, all_axes)))
    return jnp.max(jnp.abs(normals @ (divergent - centre)) / width), centre

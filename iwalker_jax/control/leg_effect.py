"""What the massless-leg pendulum mispredicts, and how a walk learns the rest of it.

A prediction error is an array (plane, position or velocity), [m] and [m/s], in the frame of the stance foot; those of
predictions made at touchdown and at the freeze are stacked as (touchdown/freeze, plane, position/velocity).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from iwalker_jax.control.gait_state import GaitState, Posture
from iwalker_jax.control.parameters import GaitParameters, LegEffect
from iwalker_jax.control.stepping import SteppingGains
from iwalker_jax.geometry import Side, other_side, side_sign, turn


def initial_residual(effect: LegEffect, dtype: DTypeLike) -> Float[Array, "2 2 2 2"]:
    """The leg effect as the residuals of a right and a left stance foot that learning starts from."""
    feet = []
    for outward in side_sign(np.asarray(Side, float)):
        full = [effect.sagittal_full, tuple(outward * x for x in effect.lateral_full)]
        late = [effect.sagittal_late, tuple(outward * x for x in effect.lateral_late)]
        feet.append([full, late])
    return jnp.asarray(feet, dtype)


def expected_error(gait: GaitParameters, gains: SteppingGains, state: GaitState) -> Float[Array, "2 2"]:
    """Error to expect of a prediction made now, less the shift of the walking orbit that such errors cause."""
    by_stride = _stride_error(gait.leg_effect, state.stride)
    own, other = state.residual[state.stance] + by_stride, state.residual[other_side(state.stance)] + by_stride
    shift = own[0] @ gains.orbit_own.T + other[0] @ gains.orbit_other.T
    freeze_phase = 1 - gait.freeze_time / gait.hlip.single_support_time
    share = jnp.minimum(state.phase / freeze_phase, 1.0)
    return own[0] + share * (own[1] - own[0]) - shift


def learned_residual(gait: GaitParameters, posture: Posture, state: GaitState) -> Float[Array, "2 2 2 2"]:
    """Residuals with the present stance side's moved towards this step's errors of the pendulums' predictions."""
    stance = posture.feet[state.stance, :2]
    actual = jnp.stack([posture.com[:2] - stance, posture.com_velocity[:2]])
    yaw = posture.foot_yaws[state.stance]
    error = jnp.swapaxes(turn(-yaw, actual - jnp.swapaxes(state.pendulum, 1, 2)), 1, 2)
    error = error - _stride_error(gait.leg_effect, state.stride)
    limit = jnp.asarray(gait.residual_limit, error.dtype)
    own = jax.nn.one_hot(state.stance, 2, dtype=error.dtype)[:, None, None, None]
    moved = state.residual + own * gait.residual_rate * (error[None] - state.residual)
    return jnp.clip(moved, -limit, limit)


def _stride_error(effect: LegEffect, stride: Float[Array, ""]) -> Float[Array, "2 2 2"]:
    """The part of the prediction errors that a step's length explains."""
    zero = (0.0, 0.0)
    return stride * jnp.asarray([[effect.stride_full, zero], [effect.stride_late, zero]], stride.dtype)

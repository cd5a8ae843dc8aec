"""When the step clock changes what it does: start shifting, lift the first foot, exchange the feet, or stop."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.control.footstep_plan import FootstepPlan
from iwalker_jax.control.gait_state import GaitMode, GaitState, Posture, foot_poses, mean_yaw, planned_footsteps
from iwalker_jax.control.leg_effect import learned_residual
from iwalker_jax.control.parameters import GaitParameters
from iwalker_jax.control.swing import TrajectoryPoint
from iwalker_jax.geometry import Side, angle_between, other_side, side_of_step, turn

SWING_OVER = 0.999
"""Phase at which a swing counts as over."""


class _Due(NamedTuple):
    """What is to change at this tick; () bool each.

    Attributes:
        tips: a robot that does not walk tips over and must step at once.
        start: begin to shift the weight.
        lift: lift the first foot.
        land: the swing foot has touched down.
    """

    tips: Bool[Array, ""]
    start: Bool[Array, ""]
    lift: Bool[Array, ""]
    land: Bool[Array, ""]


def change_mode(
    gait: GaitParameters, rate: Float[Array, ""], posture: Posture, plan: FootstepPlan, state: GaitState
) -> GaitState:
    """Start shifting, lift the first foot, exchange the feet at touchdown, or stop, if it is time to.

    A standing robot that tips lifts the less loaded foot at once, or the one whose footstep is due.

    Args:
        rate: pendulum rate lambda [1/s].
    """
    divergent = _between_feet(posture, posture.com[:2] + posture.com_velocity[:2] / rate)
    due = _what_is_due(gait, divergent, posture, plan, state)
    tips, start, lift, land = due

    learned = learned_residual(gait, posture, state)
    offset = _moved_plan(gait, posture, plan, state)
    step = jnp.minimum(state.step + 1, plan.count)
    caught = (jnp.abs(divergent[0]) < gait.stop_forward) & (jnp.abs(divergent[1]) < gait.stop_sideways)
    stop = land & (step >= plan.count) & caught

    stance = _next_stance(due, divergent, plan, state)
    swing = other_side(stance)
    lifted = posture.feet[swing]
    begin = lift | (land & ~stop)  # a swing begins
    changed = start | lift | land
    rest = jnp.zeros_like(state.swing.position)
    base = posture.feet[stance]
    com = jnp.stack([posture.com[:2] - base[:2], posture.com_velocity[:2]], axis=1)
    moved = state._replace(
        step=jnp.where(land, step, state.step).astype(jnp.int32),
        stance=stance,
        offset=jnp.where(land, offset, state.offset),
    )
    aim, _, _ = planned_footsteps(plan, moved, 1)
    stride = turn(-posture.foot_yaws[stance], aim[0] - lifted[:2])[0] / 2
    mode = jnp.where(
        start, GaitMode.SHIFT, jnp.where(begin, GaitMode.WALK, jnp.where(stop, GaitMode.STAND, state.mode))
    ).astype(jnp.int32)
    return moved._replace(
        mode=mode,
        time=jnp.where(changed, 0.0, state.time),
        phase=jnp.where(changed, 0.0, state.phase),
        late=jnp.where(changed, 0.0, state.late),
        stride=jnp.where(begin, stride, state.stride),
        swing=TrajectoryPoint(
            jnp.where(begin, lifted[:2], state.swing.position),
            jnp.where(begin, rest, state.swing.velocity),
            jnp.where(begin, rest, state.swing.acceleration),
        ),
        lift_off=jnp.where(begin, jnp.stack([lifted[2] - base[2], posture.foot_yaws[swing]]), state.lift_off),
        heading=jnp.where(changed, _reference_heading(posture, state), state.heading),
        com_start=jnp.where(changed, posture.com[:2], state.com_start),
        residual=jnp.where(land, learned, state.residual),
        pendulum=jnp.where(begin, jnp.stack([com, com]), state.pendulum),
        home=jnp.where(tips, foot_poses(posture), state.home),
    )


def _what_is_due(
    gait: GaitParameters, divergent: Float[Array, "2"], posture: Posture, plan: FootstepPlan, state: GaitState
) -> _Due:
    """Changes whose time has come; `divergent` says where the divergent component lies between the feet."""
    planned = state.step < plan.count
    outside = (jnp.abs(divergent[0]) > gait.tip_forward) | (jnp.abs(divergent[1]) > 1 + gait.tip_sideways)
    tips = (state.mode != GaitMode.WALK) & outside
    start = (state.mode == GaitMode.STAND) & planned & (state.time >= gait.stand_time) & ~tips
    lift = ((state.mode == GaitMode.SHIFT) & (state.time >= gait.shift_time + gait.settle_time)) | tips
    touches = posture.touching[other_side(state.stance)]
    over = (state.phase >= SWING_OVER) & (touches | (state.late >= gait.late_touchdown))
    land = (state.mode == GaitMode.WALK) & (over | (touches & (state.phase > 0.5) & gait.early_touchdown))
    return _Due(tips, start, lift, land)


def _next_stance(due: _Due, divergent: Float[Array, "2"], plan: FootstepPlan, state: GaitState) -> Int[Array, ""]:
    """The stance foot after the changes; a robot without a plan that tips stands on the foot that it tips towards."""
    planned = state.step < plan.count
    loaded = jnp.where(divergent[1] > 0, Side.LEFT, Side.RIGHT)
    first = jnp.where(planned, other_side(side_of_step(plan.first_swing, state.step)), loaded)
    after = jnp.where(due.land, other_side(state.stance), state.stance)
    return jnp.where(due.start | due.tips, first, after).astype(jnp.int32)


def _moved_plan(gait: GaitParameters, posture: Posture, plan: FootstepPlan, state: GaitState) -> Float[Array, "2"]:
    """Offset of the plan [m] if the swing foot lands now: it moves if it cannot be kept, and returns step by step."""
    wanted, _, _ = planned_footsteps(plan, state, 1)
    error = posture.feet[other_side(state.stance), :2] - wanted[0]
    size = jnp.sqrt(jnp.sum(error**2) + 1e-12)
    offset = state.offset + error * jnp.maximum(1 - gait.governor / size, 0)
    length = jnp.sqrt(jnp.sum(offset**2) + 1e-12)
    return offset * jnp.maximum(1 - gait.return_step / length, 0)


def _reference_heading(posture: Posture, state: GaitState) -> Float[Array, ""]:
    """Where the torso's reference has arrived: between the stance foot and the footstep just aimed at."""
    landed = posture.foot_yaws[state.stance] + angle_between(state.target[2], posture.foot_yaws[state.stance]) / 2
    return jnp.where(state.mode == GaitMode.WALK, landed, mean_yaw(posture.foot_yaws))


def _between_feet(posture: Posture, point: Float[Array, "2"]) -> Float[Array, "2"]:
    """A point [m] by how far it lies ahead of the line between the feet [m] and sideways, +1 left foot, -1 right."""
    yaw = mean_yaw(posture.foot_yaws)
    half = turn(-yaw, posture.feet[Side.LEFT, :2] - posture.feet[Side.RIGHT, :2]) / 2
    along = turn(-yaw, point - jnp.mean(posture.feet[:, :2], axis=0))
    sideways = along[1] / jnp.maximum(half[1], 1e-3)
    return jnp.stack([along[0] - jnp.clip(sideways, -1, 1) * half[0], sideways])

"""The swing of a walking robot at this tick: where its foot shall land, when, and how it moves there."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.control.footstep_plan import FootstepPlan
from iwalker_jax.control.gait_modes import SWING_OVER
from iwalker_jax.control.gait_state import GaitMode, GaitState, Posture, planned_footsteps
from iwalker_jax.control.leg_effect import expected_error
from iwalker_jax.control.parameters import GaitParameters
from iwalker_jax.control.stepping import SteppingGains, choose_step
from iwalker_jax.control.swing import TrajectoryPoint, advance_towards, rise_and_fall
from iwalker_jax.geometry import angle_between, other_side, side_sign


class SwingReference(NamedTuple):
    """What the swing foot shall do at this tick, world frame; of no meaning while the robot does not walk.

    Attributes:
        foot: (3,) motion of the swing foot; foot_yaw: () of its yaw; level: (2,) its horizontal part without the rest.
        target: (3,) x, y [m] and yaw [rad] of the footstep.
        heading: () [rad] of the step, midway between the stance foot and the footstep.
        phase_rate: () [1/s] at which the swing advances; late: () [s] since the foot should have met the floor.
        frozen: () whether the footstep is no longer changed.
        pendulum: (2, 2) the COM by plane, position [m] from the stance foot and velocity [m/s].
    """

    foot: TrajectoryPoint
    foot_yaw: TrajectoryPoint
    level: TrajectoryPoint
    target: Float[Array, "3"]
    heading: Float[Array, ""]
    phase_rate: Float[Array, ""]
    late: Float[Array, ""]
    frozen: Bool[Array, ""]
    pendulum: Float[Array, "2 2"]


def swing_reference(
    gait: GaitParameters,
    gains: SteppingGains,
    time_step: float,
    posture: Posture,
    plan: FootstepPlan,
    state: GaitState,
) -> SwingReference:
    """Choose the footstep and the time left, and move the swing foot's reference."""
    stance_foot = posture.feet[state.stance]
    swing_foot = posture.feet[other_side(state.stance)]
    wanted, yaws, _ = planned_footsteps(plan, state, gait.horizon)
    com = posture.com[:2] - stance_foot[:2], posture.com_velocity[:2]
    nominal = gait.hlip.single_support_time * (1 - state.phase)
    stance_yaw = posture.foot_yaws[state.stance]
    target_yaw = stance_yaw + angle_between(yaws[0], stance_yaw)
    heading = (stance_yaw + target_yaw) / 2
    choice = choose_step(
        gait,
        gains,
        wanted - stance_foot[:2],
        com,
        expected_error(gait, gains, state),
        heading,
        side_sign(other_side(state.stance)).astype(posture.com.dtype),
        swing_foot[:2] - stance_foot[:2],
        nominal,
    )
    frozen = nominal < gait.freeze_time
    remaining = jnp.where(frozen, jnp.maximum(nominal, 1e-3), choice.remaining)
    place = jnp.concatenate([choice.footstep + stance_foot[:2], target_yaw[None]])
    target = jnp.where(frozen, state.target, place)
    phase_rate = (1 - state.phase) / remaining
    level = advance_towards(state.swing, target[:2], remaining, time_step)
    overdue = state.phase >= SWING_OVER
    late = jnp.where((state.mode == GaitMode.WALK) & overdue, state.late + time_step, 0.0)
    return SwingReference(
        foot=_foot(gait, level, phase_rate, stance_foot[2], late, overdue, state),
        foot_yaw=_foot_yaw(target[2], phase_rate, state),
        level=level,
        target=target,
        heading=heading,
        phase_rate=phase_rate,
        late=late,
        frozen=frozen,
        pendulum=jnp.stack(com, axis=1),
    )


def _foot(
    gait: GaitParameters,
    level: TrajectoryPoint,
    phase_rate: Float[Array, ""],
    floor: Float[Array, ""],
    late: Float[Array, ""],
    overdue: Bool[Array, ""],
    state: GaitState,
) -> TrajectoryPoint:
    """Motion (3,) of the swing foot over a floor of a height [m]; one that is overdue goes on down."""
    vertical = rise_and_fall(
        state.phase,
        phase_rate,
        state.lift_off[0],
        gait.swing_height,
        gait.landing_speed,
        gait.hlip.single_support_time,
    )
    return TrajectoryPoint(
        jnp.append(level.position, vertical.position + floor - gait.descent_speed * late),
        jnp.append(level.velocity, jnp.where(overdue, -gait.descent_speed, vertical.velocity)),
        jnp.append(level.acceleration, vertical.acceleration),
    )


def _foot_yaw(target: Float[Array, ""], phase_rate: Float[Array, ""], state: GaitState) -> TrajectoryPoint:
    """Motion () of the swing foot's yaw: a quintic of the phase from lift-off to the footstep's [rad]."""
    s = state.phase
    turned = angle_between(target, state.lift_off[1])
    return TrajectoryPoint(
        state.lift_off[1] + turned * s**3 * (10 - 15 * s + 6 * s**2),
        turned * phase_rate * 30 * s**2 * (1 - s) ** 2,
        turned * phase_rate**2 * 60 * s * (1 - s) * (1 - 2 * s),
    )

"""Step clock: stand, shift, walk, stop; what each foot, the COM and the torso shall do at this tick."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.checks import Scalar
from iwalker_jax.control.footstep_plan import FootstepPlan
from iwalker_jax.control.gait_modes import change_mode
from iwalker_jax.control.gait_state import (
    GaitMode,
    GaitReference,
    GaitState,
    Posture,
    foot_poses,
    mean_yaw,
    planned_footsteps,
)
from iwalker_jax.control.gait_swing import SwingReference, swing_reference
from iwalker_jax.control.leg_effect import initial_residual
from iwalker_jax.control.parameters import GaitParameters
from iwalker_jax.control.stepping import SteppingGains
from iwalker_jax.control.swing import TrajectoryPoint
from iwalker_jax.geometry import Side, angle_between, other_side, smooth_step, turn
from iwalker_jax.optimization import pendulum_flow


def initial_gait(gait: GaitParameters, posture: Posture) -> GaitState:
    """Standing on both feet as they are."""
    dtype = posture.com.dtype
    zero, none = jnp.zeros((), dtype), jnp.zeros((), jnp.int32)
    return GaitState(
        mode=none + GaitMode.STAND,
        time=zero,
        phase=zero,
        late=zero,
        stance=none + Side.RIGHT,
        step=none,
        swing=TrajectoryPoint(posture.feet[Side.LEFT, :2], jnp.zeros(2, dtype), jnp.zeros(2, dtype)),
        lift_off=jnp.zeros(2, dtype),
        target=jnp.zeros(3, dtype),
        heading=mean_yaw(posture.foot_yaws),
        com_start=posture.com[:2],
        home=foot_poses(posture),
        offset=jnp.zeros(2, dtype),
        residual=initial_residual(gait.leg_effect, dtype),
        stride=zero,
        pendulum=jnp.zeros((2, 2, 2), dtype),
    )


def advance_gait(
    gait: GaitParameters,
    gains: SteppingGains,
    capture_gain: Scalar,
    time_step: float,
    posture: Posture,
    plan: FootstepPlan,
    state: GaitState,
) -> tuple[GaitState, GaitReference]:
    """One tick of the step clock: finish steps and modes that are due, then say what to do now.

    Args:
        gait, gains: parameters, and the stepping feedback's gains that follow from them.
        capture_gain: standing, how fast the divergent component is pulled to its place, in pendulum rates.
        time_step: [s] to the next tick.
        posture: of the robot now.
        plan: footsteps to take.
        state: memory of the last tick.
    """
    rate = gains.rate
    state = change_mode(gait, rate, posture, plan, state)
    walking = state.mode == GaitMode.WALK
    swing = swing_reference(gait, gains, time_step, posture, plan, state)
    blend = smooth_step(jnp.clip(state.time / gait.shift_time, 0, 1))

    stance_foot = posture.feet[state.stance]
    pressure = _standing_pressure(gait, rate, capture_gain, blend, posture, plan, state)
    pressure = jnp.where(walking, stance_foot[:2], pressure)
    height = jnp.where(walking, stance_foot[2], jnp.mean(posture.feet[:, 2])) + gait.hlip.com_height
    one_foot = jax.nn.one_hot(state.stance, 2, dtype=posture.com.dtype)
    reference = GaitReference(
        stance=jnp.where(walking, one_foot, jnp.ones_like(one_foot)),
        foot=swing.foot,
        foot_yaw=swing.foot_yaw,
        com_acceleration=rate**2 * (posture.com[:2] - pressure),
        com_height=height,
        heading=_heading(walking, swing, blend, posture, state),
    )
    return _advanced(rate, time_step, walking, swing, state), reference


def _standing_pressure(
    gait: GaitParameters,
    rate: Float[Array, ""],
    capture_gain: Scalar,
    blend: Float[Array, ""],
    posture: Posture,
    plan: FootstepPlan,
    state: GaitState,
) -> Float[Array, "2"]:
    """Centre of pressure [m] that pulls the divergent component to the feet's middle, or to the first step's start.

    Args:
        blend: 0..1 through the COM's way there.
    """
    middle = (posture.feet[Side.RIGHT, :2] + posture.feet[Side.LEFT, :2]) / 2
    goal = jnp.where(state.mode == GaitMode.SHIFT, _first_stance_point(gait, rate, posture, plan, state), middle)
    reference = state.com_start + blend * (goal - state.com_start)
    divergent = posture.com[:2] + posture.com_velocity[:2] / rate
    return divergent + capture_gain * (divergent - reference)


def _first_stance_point(
    gait: GaitParameters, rate: Float[Array, ""], posture: Posture, plan: FootstepPlan, state: GaitState
) -> Float[Array, "2"]:
    """Where the COM must rest so that the planned footsteps, taken from here, keep it bounded.

    xi_0 = s_0 + sum_k g^-(k+1) (s_{k+1} - s_k - w_k) with growth g a step and w the legs' effect on the divergent
    component, which alternates with the stance side.
    """
    stance = posture.feet[state.stance, :2]
    footsteps, _, _ = planned_footsteps(plan, state, gait.horizon)
    steps = jnp.diff(footsteps, axis=0, prepend=stance[None])
    growth = jnp.exp(rate * gait.hlip.single_support_time)
    shrink = growth ** -(1.0 + jnp.arange(gait.horizon))
    full = state.residual[:, 0]
    effect = full[..., 0] + full[..., 1] / rate
    effect = turn(posture.foot_yaws[state.stance], effect)
    own, other = effect[state.stance], effect[other_side(state.stance)]
    return stance + shrink @ steps - (own + other / growth) / (growth - 1 / growth)


def _heading(
    walking: Bool[Array, ""], swing: SwingReference, blend: Float[Array, ""], posture: Posture, state: GaitState
) -> TrajectoryPoint:
    """Motion () of the torso's yaw: to the step's heading with the swing, to that of the standing feet with `blend`."""
    end = jnp.where(walking, swing.heading, mean_yaw(posture.foot_yaws))
    way = angle_between(end, state.heading)
    zero = jnp.zeros_like(way)
    return TrajectoryPoint(
        state.heading + way * jnp.where(walking, state.phase, blend),
        jnp.where(walking, way * swing.phase_rate, zero),
        zero,
    )


def _advanced(
    rate: Float[Array, ""], time_step: float, walking: Bool[Array, ""], swing: SwingReference, state: GaitState
) -> GaitState:
    """The memory a tick later: clock, swing and pendulums move on."""
    # The second pendulum is the robot itself until the footstep is frozen.
    pendulum = state.pendulum.at[1].set(jnp.where(swing.frozen, state.pendulum[1], swing.pendulum))
    step = jnp.asarray(time_step, swing.pendulum.dtype)
    position, velocity = pendulum_flow(rate, pendulum[..., 0], pendulum[..., 1], step)
    return state._replace(
        time=state.time + time_step,
        late=swing.late,
        phase=jnp.where(walking, jnp.minimum(state.phase + swing.phase_rate * time_step, 1.0), 0.0),
        swing=jax.tree.map(lambda new, old: jnp.where(walking, new, old), swing.level, state.swing),
        target=jnp.where(walking, swing.target, state.target),
        pendulum=jnp.stack([position, velocity], axis=-1),
    )

"""Step clock: stand, shift, walk, stop; what each foot, the COM and the torso shall do at this tick."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from iwalker_jax.control.footstep_plan import FootstepPlan
from iwalker_jax.control.gait_state import GaitMode, GaitReference, GaitState, Posture
from iwalker_jax.control.parameters import GaitParameters, LegEffect
from iwalker_jax.control.stepping import SteppingGains, choose_step
from iwalker_jax.control.swing import Motion, advance_towards, rise_and_fall
from iwalker_jax.geometry.planar import turn
from iwalker_jax.geometry.rotations import angle_between
from iwalker_jax.geometry.sides import Side, other_side, side_of_step, side_sign
from iwalker_jax.optimization import pendulum_flow

_DONE = 0.999  # phase at which a swing counts as over


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
        swing=Motion(posture.feet[Side.LEFT, :2], jnp.zeros(2, dtype), jnp.zeros(2, dtype)),
        lift_off=jnp.zeros(2, dtype),
        target=jnp.zeros(3, dtype),
        heading=_mean_yaw(posture.foot_yaws),
        com_start=posture.com[:2],
        home=_places(posture),
        offset=jnp.zeros(2, dtype),
        residual=_first_residual(gait.leg_effect, dtype),
        stride=zero,
        pendulum=jnp.zeros((2, 2, 2), dtype),
    )


def _places(posture: Posture) -> Float[Array, "2 3"]:
    """x, y [m] and yaw [rad] of both feet."""
    return jnp.concatenate([posture.feet[:, :2], posture.foot_yaws[:, None]], axis=1)


def _first_residual(effect: LegEffect, dtype: DTypeLike) -> Float[Array, "2 2 2 2"]:
    """The leg effect as learned residuals of a right and a left stance foot."""
    feet = []
    for outward in side_sign(np.asarray(Side, float)):
        full = [effect.sagittal_full, tuple(outward * x for x in effect.lateral_full)]
        late = [effect.sagittal_late, tuple(outward * x for x in effect.lateral_late)]
        feet.append([full, late])
    return jnp.asarray(feet, dtype)


def planned_footsteps(
    plan: FootstepPlan, state: GaitState, count: int
) -> tuple[Float[Array, "n 2"], Float[Array, " n"], Float[Array, " n"]]:
    """The next footsteps: positions (n, 2) [m], yaws (n,) [rad] and whether each is still in the plan (n,).

    Beyond its end the plan repeats its last step of either foot; without a plan the feet keep their places.
    """
    ahead = state.step + jnp.arange(count)
    foot = side_of_step(other_side(state.stance), jnp.arange(count))
    last = plan.count - 1
    last = last - (side_of_step(plan.first_swing, last) != foot)
    row = jnp.clip(jnp.where(ahead < plan.count, ahead, last), 0, plan.yaws.shape[0] - 1)
    planned = plan.count > 0
    positions = jnp.where(planned, plan.positions[row] + state.offset, state.home[foot, :2])
    return positions, jnp.where(planned, plan.yaws[row], state.home[foot, 2]), ahead < plan.count


def advance_gait(
    gait: GaitParameters,
    gains: SteppingGains,
    capture_gain: float,
    time_step: float,
    posture: Posture,
    plan: FootstepPlan,
    state: GaitState,
) -> tuple[GaitState, GaitReference]:
    """One tick of the step clock: finish steps and modes that are due, then say what to do now."""
    state = _change_mode(gait, gains, posture, plan, state)
    walking = state.mode == GaitMode.WALK
    stance_foot = posture.feet[state.stance]
    swing_foot = posture.feet[other_side(state.stance)]
    rate = gains.rate

    # Walking: choose the footstep and the time left, move the swing reference.
    wanted, yaws, _ = planned_footsteps(plan, state, gait.horizon)
    com = posture.com[:2] - stance_foot[:2], posture.com_velocity[:2]
    swing_sign = side_sign(other_side(state.stance)).astype(posture.com.dtype)
    nominal = gait.hlip.single_support_time * (1 - state.phase)
    stance_yaw = posture.foot_yaws[state.stance]
    target_yaw = stance_yaw + angle_between(yaws[0], stance_yaw)
    frame = (stance_yaw + target_yaw) / 2
    expected = _expected_error(gait, gains, state)
    choice = choose_step(
        gait,
        gains,
        wanted - stance_foot[:2],
        com,
        expected,
        frame,
        swing_sign,
        swing_foot[:2] - stance_foot[:2],
        nominal,
    )
    frozen = nominal < gait.freeze_time
    remaining = jnp.where(frozen, jnp.maximum(nominal, 1e-3), choice.remaining)
    place = jnp.concatenate([choice.footstep + stance_foot[:2], target_yaw[None]])
    target = jnp.where(frozen, state.target, place)
    phase_rate = (1 - state.phase) / remaining
    swing = advance_towards(state.swing, target[:2], remaining, time_step)
    vertical = rise_and_fall(
        state.phase,
        phase_rate,
        state.lift_off[0],
        gait.swing_height,
        gait.landing_speed,
        gait.hlip.single_support_time,
    )
    overdue = state.phase >= _DONE
    late = jnp.where(walking & overdue, state.late + time_step, 0.0)
    foot = Motion(
        jnp.append(swing.position, vertical.position + stance_foot[2] - gait.descent_speed * late),
        jnp.append(swing.velocity, jnp.where(overdue, -gait.descent_speed, vertical.velocity)),
        jnp.append(swing.acceleration, vertical.acceleration),
    )
    s = state.phase
    turned = angle_between(target[2], state.lift_off[1])
    foot_yaw = Motion(
        state.lift_off[1] + turned * s**3 * (10 - 15 * s + 6 * s**2),
        turned * phase_rate * 30 * s**2 * (1 - s) ** 2,
        turned * phase_rate**2 * 60 * s * (1 - s) * (1 - 2 * s),
    )

    # Standing: the divergent component is pulled to the middle of the feet, or to where the first step starts.
    middle = (posture.feet[Side.RIGHT, :2] + posture.feet[Side.LEFT, :2]) / 2
    goal = jnp.where(state.mode == GaitMode.SHIFT, _first_stance_point(gait, rate, posture, plan, state), middle)
    share = jnp.clip(state.time / gait.shift_time, 0, 1)
    blend = share**2 * (3 - 2 * share)
    reference = state.com_start + blend * (goal - state.com_start)
    divergent = posture.com[:2] + posture.com_velocity[:2] / rate
    pressure = divergent + capture_gain * (divergent - reference)
    pressure = jnp.where(walking, stance_foot[:2], pressure)

    heading_end = jnp.where(walking, frame, _mean_yaw(posture.foot_yaws))
    way = angle_between(heading_end, state.heading)
    zero = jnp.zeros_like(way)
    heading = Motion(
        state.heading + way * jnp.where(walking, s, blend),
        jnp.where(walking, way * phase_rate, zero),
        zero,
    )
    height = jnp.where(walking, stance_foot[2], jnp.mean(posture.feet[:, 2])) + gait.hlip.com_height
    one_foot = jax.nn.one_hot(state.stance, 2, dtype=posture.com.dtype)
    out = GaitReference(
        stance=jnp.where(walking, one_foot, jnp.ones_like(one_foot)),
        foot=foot,
        foot_yaw=foot_yaw,
        com_acceleration=rate**2 * (posture.com[:2] - pressure),
        com_height=height,
        heading=heading,
    )
    # The second pendulum is the robot itself until the footstep is frozen.
    actual = jnp.stack(com, axis=1)
    pendulum = state.pendulum.at[1].set(jnp.where(frozen, state.pendulum[1], actual))
    position, velocity = pendulum_flow(rate, pendulum[..., 0], pendulum[..., 1], jnp.asarray(time_step, com[0].dtype))
    state = state._replace(
        time=state.time + time_step,
        late=late,
        phase=jnp.where(walking, jnp.minimum(state.phase + phase_rate * time_step, 1.0), 0.0),
        swing=jax.tree.map(lambda new, old: jnp.where(walking, new, old), swing, state.swing),
        target=jnp.where(walking, target, state.target),
        pendulum=jnp.stack([position, velocity], axis=-1),
    )
    return state, out


def _mean_yaw(yaws: Float[Array, "2"]) -> Float[Array, ""]:
    return yaws[Side.RIGHT] + angle_between(yaws[Side.LEFT], yaws[Side.RIGHT]) / 2


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


def _change_mode(
    gait: GaitParameters, gains: SteppingGains, posture: Posture, plan: FootstepPlan, state: GaitState
) -> GaitState:
    """Start shifting, lift the first foot, exchange the feet at touchdown, or stop, if it is time to.

    A standing robot that tips lifts the less loaded foot at once, or the one whose footstep is due.
    """
    divergent = _between_feet(posture, posture.com[:2] + posture.com_velocity[:2] / gains.rate)
    planned = state.step < plan.count
    outside = (jnp.abs(divergent[0]) > gait.tip_forward) | (jnp.abs(divergent[1]) > 1 + gait.tip_sideways)
    tips = (state.mode != GaitMode.WALK) & outside
    start = (state.mode == GaitMode.STAND) & planned & (state.time >= gait.stand_time) & ~tips
    lift = ((state.mode == GaitMode.SHIFT) & (state.time >= gait.shift_time + gait.settle_time)) | tips
    touches = posture.touching[other_side(state.stance)]
    due = (state.phase >= _DONE) & (touches | (state.late >= gait.late_touchdown))
    land = (state.mode == GaitMode.WALK) & (due | (touches & (state.phase > 0.5) & gait.early_touchdown))

    # Touchdown: learn, move the plan if it cannot be kept, exchange the feet.
    learned = _learn(gait, posture, state)
    wanted, _, _ = planned_footsteps(plan, state, 1)
    error = posture.feet[other_side(state.stance), :2] - wanted[0]
    size = jnp.sqrt(jnp.sum(error**2) + 1e-12)
    offset = state.offset + error * jnp.maximum(1 - gait.governor / size, 0)
    length = jnp.sqrt(jnp.sum(offset**2) + 1e-12)
    offset = offset * jnp.maximum(1 - gait.return_step / length, 0)
    step = jnp.minimum(state.step + 1, plan.count)
    stance = other_side(state.stance)
    caught = (jnp.abs(divergent[0]) < gait.stop_forward) & (jnp.abs(divergent[1]) < gait.stop_sideways)
    stop = land & (step >= plan.count) & caught

    due_stance = other_side(side_of_step(plan.first_swing, state.step))
    loaded = jnp.where(divergent[1] > 0, Side.LEFT, Side.RIGHT)
    first_stance = jnp.where(planned, due_stance, loaded)
    new_stance = jnp.where(start | tips, first_stance, jnp.where(land, stance, state.stance)).astype(jnp.int32)
    lifted = posture.feet[other_side(new_stance)]
    begin = lift | (land & ~stop)  # a swing begins
    changed = start | lift | land
    rest = jnp.zeros_like(state.swing.position)
    base = posture.feet[new_stance]
    com = jnp.stack([posture.com[:2] - base[:2], posture.com_velocity[:2]], axis=1)
    moved = state._replace(
        step=jnp.where(land, step, state.step).astype(jnp.int32),
        stance=new_stance,
        offset=jnp.where(land, offset, state.offset),
    )
    aim, _, _ = planned_footsteps(plan, moved, 1)
    stride = turn(-posture.foot_yaws[new_stance], aim[0] - lifted[:2])[0] / 2
    mode = jnp.where(
        start, GaitMode.SHIFT, jnp.where(begin, GaitMode.WALK, jnp.where(stop, GaitMode.STAND, state.mode))
    ).astype(jnp.int32)
    return moved._replace(
        mode=mode,
        time=jnp.where(changed, 0.0, state.time),
        phase=jnp.where(changed, 0.0, state.phase),
        late=jnp.where(changed, 0.0, state.late),
        stride=jnp.where(begin, stride, state.stride),
        swing=Motion(
            jnp.where(begin, lifted[:2], state.swing.position),
            jnp.where(begin, rest, state.swing.velocity),
            jnp.where(begin, rest, state.swing.acceleration),
        ),
        lift_off=jnp.where(
            begin, jnp.stack([lifted[2] - base[2], posture.foot_yaws[other_side(new_stance)]]), state.lift_off
        ),
        heading=jnp.where(changed, _reference_heading(posture, state), state.heading),
        com_start=jnp.where(changed, posture.com[:2], state.com_start),
        residual=jnp.where(land, learned, state.residual),
        pendulum=jnp.where(begin, jnp.stack([com, com]), state.pendulum),
        home=jnp.where(tips, _places(posture), state.home),
    )


def _reference_heading(posture: Posture, state: GaitState) -> Float[Array, ""]:
    """Where the torso's reference has arrived: between the stance foot and the footstep just aimed at."""
    landed = posture.foot_yaws[state.stance] + angle_between(state.target[2], posture.foot_yaws[state.stance]) / 2
    return jnp.where(state.mode == GaitMode.WALK, landed, _mean_yaw(posture.foot_yaws))


def _stride_error(effect: LegEffect, stride: Float[Array, ""]) -> Float[Array, "2 2 2"]:
    """The part of the prediction errors that a step's length explains: (full/late, plane, position/velocity)."""
    zero = (0.0, 0.0)
    return stride * jnp.asarray([[effect.stride_full, zero], [effect.stride_late, zero]], stride.dtype)


def _expected_error(gait: GaitParameters, gains: SteppingGains, state: GaitState) -> Float[Array, "2 2"]:
    """Error to expect of a prediction made now, less the shift of the walking orbit that such errors cause."""
    by_stride = _stride_error(gait.leg_effect, state.stride)
    own, other = state.residual[state.stance] + by_stride, state.residual[other_side(state.stance)] + by_stride
    shift = own[0] @ gains.orbit_own.T + other[0] @ gains.orbit_other.T
    freeze_phase = 1 - gait.freeze_time / gait.hlip.single_support_time
    share = jnp.minimum(state.phase / freeze_phase, 1.0)
    return own[0] + share * (own[1] - own[0]) - shift


def _learn(gait: GaitParameters, posture: Posture, state: GaitState) -> Float[Array, "2 2 2 2"]:
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


def _between_feet(posture: Posture, point: Float[Array, "2"]) -> Float[Array, "2"]:
    """A point [m] by how far it lies ahead of the line between the feet [m] and sideways, +1 left foot, -1 right."""
    yaw = _mean_yaw(posture.foot_yaws)
    half = turn(-yaw, posture.feet[Side.LEFT, :2] - posture.feet[Side.RIGHT, :2]) / 2
    along = turn(-yaw, point - jnp.mean(posture.feet[:, :2], axis=0))
    sideways = along[1] / jnp.maximum(half[1], 1e-3)
    return jnp.stack([along[0] - jnp.clip(sideways, -1, 1) * half[0], sideways])

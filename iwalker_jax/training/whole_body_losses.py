"""Losses of footsteps under the whole-body controller: torques, accelerations and placement, through its QP's optimum.

A footstep is judged as if it had been known when its swing began: the robot stands on one foot with its COM on the
pendulum's arc and its swing foot on the quintic to the footstep, and the whole-body QP is asked for the motion's next
instant. Limp legs satisfy the QP's limits, so it is always feasible: what a footstep asks too much of shows as torques
near their limits and accelerations that fall short. The walk's disturbances, impacts and turns stay outside.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from bruce_model import load_mujoco
from iwalker_jax.constants import GRAVITY
from iwalker_jax.control import (
    Controller,
    GaitParameters,
    GaitReference,
    TrajectoryPoint,
    advance_towards,
    choose_step,
    make_controller,
    rise_and_fall,
    solve_whole_body,
)
from iwalker_jax.geometry import Side, other_side
from iwalker_jax.optimization import pendulum_flow
from iwalker_jax.planning import PlannerConfig, RobotState
from iwalker_jax.robot import RobotModel, load_robot_model, place_robot, rigid_body_terms

SWING_PHASES = (0.25, 0.75)
"""Of a swing at which the QP is solved: near the swing foot's largest acceleration and deceleration."""

JUDGED_STEPS = 2
"""Footsteps that are judged: on the second the pendulum arrives as the first has left it."""

FREE_TORQUE_SHARE = 0.35
"""Of a motor's largest torque up to which it costs nothing: what a walk on the spot takes."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ControlledRobot:
    """The robot that shall take the footsteps and the controller that shall make it."""

    robot: RobotModel
    controller: Controller


class WholeBodyLosses(NamedTuple):
    """Terms for one frame, unweighted (see `LossWeights`).

    Attributes:
        torque_margin: squared excess of each leg motor's share of its largest torque over `FREE_TORQUE_SHARE`, summed
            over the motors, mean over the instants.
        shortfall: log(1 + squared accelerations that swing foot and COM miss, in units of gravity), mean over the
            instants; the logarithm keeps a leg that is nearly straight from drowning all others.
        placement: [m^2] squared distance by which the walk's stepping feedback would move the first footstep.
        solved: share of the instants whose posture exists and whose QP converged; the others count for nothing.
    """

    torque_margin: Float[Array, ""]
    shortfall: Float[Array, ""]
    placement: Float[Array, ""]
    solved: Float[Array, ""]


class SwingInstant(NamedTuple):
    """One instant of a swing, in axes of the base frame with the stance foot at the origin.

    Attributes:
        stance: () the `Side` of the stance foot.
        com, com_velocity: (2,) [m, m/s].
        lift_off, footstep: (2,) [m] ends of the swing.
        phase: () 0..1 through it.
    """

    stance: Int[Array, ""]
    com: Float[Array, "2"]
    com_velocity: Float[Array, "2"]
    lift_off: Float[Array, "2"]
    footstep: Float[Array, "2"]
    phase: Float[Array, ""]


class InstantSolution(NamedTuple):
    """What the whole-body QP makes of an instant.

    Attributes:
        torque_shares: (10,) of the leg motors, signed.
        swing_shortfall, com_shortfall: (3,) [m/s^2] accelerations asked for less those of the QP.
        converged: () whether the posture exists, the QP converged and its derivative may be trusted.
    """

    torque_shares: Float[Array, " legs"]
    swing_shortfall: Float[Array, "3"]
    com_shortfall: Float[Array, "3"]
    converged: Bool[Array, ""]


def load_controlled_robot(planner: PlannerConfig = PlannerConfig()) -> ControlledRobot:
    """BRUCE and the controller that walks on a planner's footsteps, in JAX's present precision."""
    robot = load_robot_model(load_mujoco())
    return ControlledRobot(robot, make_controller(robot, GaitParameters(hlip=planner.hlip, mpc=planner.step_weights)))


def whole_body_losses(
    controlled: ControlledRobot, footsteps: Float[Array, "m 2"], state: RobotState, width: float
) -> WholeBodyLosses:
    """Terms of the first footsteps.

    Args:
        controlled: the robot that shall take them.
        footsteps: (m, 2) [m] predicted, base frame; m at least the gait's horizon.
        state: of this robot.
        width: [m] desired distance between the feet's tracks, at which the swing foot is taken to have stood.
    """
    instants = swing_instants(controlled, footsteps, state, width)
    solutions = jax.vmap(lambda instant: solve_instant(controlled, instant))(instants)
    usable = solutions.converged.astype(footsteps.dtype)

    def mean(values: Array) -> Array:
        return jnp.sum(jnp.where(solutions.converged, values, 0.0)) / usable.size

    excess = jnp.maximum(jnp.abs(solutions.torque_shares) - FREE_TORQUE_SHARE, 0.0)
    missed = jnp.sum(solutions.swing_shortfall**2 + solutions.com_shortfall**2, axis=1) / GRAVITY**2
    return WholeBodyLosses(
        torque_margin=mean(jnp.sum(excess**2, axis=1)),
        shortfall=mean(jnp.log1p(missed)),
        placement=jnp.sum(footstep_correction(controlled, footsteps, state) ** 2),
        solved=jnp.mean(usable),
    )


def swing_instants(
    controlled: ControlledRobot, footsteps: Float[Array, "m 2"], state: RobotState, width: float
) -> SwingInstant:
    """The instants `SWING_PHASES` of the first `JUDGED_STEPS` swings, stacked.

    Where the first swing began is not part of the state. Its length is taken from the pendulum's velocity at mid-stance
    v, which a walk at a constant speed crosses with steps of 2 v sinh(lambda T / 2) / lambda.
    """
    gait, rate = controlled.controller.gait, controlled.controller.gains.rate.astype(footsteps.dtype)
    time = gait.hlip.single_support_time

    def at(moment: float | Array) -> tuple[Array, Array]:
        return pendulum_flow(rate, state.com_from_stance, state.com_velocity, moment - state.time_in_step)

    places = footsteps[:JUDGED_STEPS] + state.com_from_stance
    stride = 2 * jnp.sinh(rate * time / 2) / rate * at(time / 2)[1][0]
    lift_off = jnp.stack([-stride, -state.stance_sign * width])
    base = jnp.zeros(2, footsteps.dtype)
    com = at(0.0)
    stance = jnp.where(state.stance_sign > 0, Side.LEFT, Side.RIGHT)
    instants = []
    for k in range(JUDGED_STEPS):
        for phase in SWING_PHASES:
            position, velocity = pendulum_flow(rate, *com, jnp.asarray(phase * time, footsteps.dtype))
            phase_array = jnp.asarray(phase, footsteps.dtype)
            instants.append(SwingInstant(stance, position, velocity, lift_off - base, places[k] - base, phase_array))
        position, velocity = pendulum_flow(rate, *com, jnp.asarray(time, footsteps.dtype))
        com = position + base - places[k], velocity
        lift_off, base, stance = base, places[k], other_side(stance)
    return jax.tree.map(lambda *parts: jnp.stack(parts), *instants)


def solve_instant(controlled: ControlledRobot, instant: SwingInstant) -> InstantSolution:
    """Put the robot into an instant and solve the whole-body QP there."""
    robot, controller = controlled.robot, controlled.controller
    gait = controller.gait
    dtype = instant.com.dtype
    rate = controller.gains.rate.astype(dtype)
    swing = _swing(controller, instant)
    zero, none = jnp.zeros((), dtype), jnp.zeros(3, dtype)
    height = jnp.asarray(gait.hlip.com_height, dtype)
    feet = _right_and_left(instant.stance, none, swing.position)
    state = place_robot(
        robot,
        jnp.append(instant.com, height),
        jnp.append(instant.com_velocity, 0.0),
        feet,
        _right_and_left(instant.stance, none, swing.velocity),
    )
    terms = rigid_body_terms(robot, state.qpos, state.qvel)
    stance = jax.nn.one_hot(instant.stance, 2, dtype=dtype)
    still = TrajectoryPoint(zero, zero, zero)
    reference = GaitReference(stance, swing, still, rate**2 * instant.com, height, still)
    arms = jnp.zeros_like(controller.actuation.arm_pose, dtype)
    dynamics, _, solution = solve_whole_body(controller, terms, reference, arms)

    x = solution.value.x
    acceleration = dynamics.acceleration @ x + dynamics.acceleration_offset
    # Not clipped as on the robot: the QP keeps the limits, and clipping would stop the derivatives there.
    motors = controller.actuation.motors_from_torques @ (dynamics.torque @ x + dynamics.torque_offset)
    foot = other_side(instant.stance)
    moved = terms.foot_jacobians[foot, :3] @ acceleration + terms.foot_bias_accelerations[foot, :3]
    com = terms.com_jacobian @ acceleration + terms.com_bias_acceleration
    return InstantSolution(
        torque_shares=(motors / controller.actuation.limits)[: robot.leg_count],
        swing_shortfall=swing.acceleration - moved,
        com_shortfall=jnp.append(reference.com_acceleration, 0.0) - com,
        converged=state.converged & solution.gradient_valid,
    )


def footstep_correction(
    controlled: ControlledRobot, footsteps: Float[Array, "m 2"], state: RobotState
) -> Float[Array, "2"]:
    """By how much [m] the walk's stepping feedback, which knows the pendulum and the legs' reach, moves a footstep."""
    gait, gains = controlled.controller.gait, controlled.controller.gains
    dtype = footsteps.dtype
    places = footsteps[: gait.horizon] + state.com_from_stance
    remaining = jnp.maximum(gait.hlip.single_support_time - state.time_in_step, 1e-3)
    choice = choose_step(
        gait,
        jax.tree.map(lambda leaf: leaf.astype(dtype), gains),
        places,
        (state.com_from_stance, state.com_velocity),
        jnp.zeros((2, 2), dtype),
        jnp.zeros((), dtype),
        -state.stance_sign,
        # The swing foot itself is left out of the choice of time: it is on its way already.
        places[0],
        remaining,
    )
    return choice.footstep - places[0]


def _swing(controller: Controller, instant: SwingInstant) -> TrajectoryPoint:
    """Motion (3,) of the swing foot."""
    gait = controller.gait
    time = gait.hlip.single_support_time
    nothing = jnp.zeros_like(instant.com)
    level = advance_towards(
        TrajectoryPoint(instant.lift_off, nothing, nothing),
        instant.footstep,
        jnp.asarray(time, nothing.dtype),
        instant.phase * time,
    )
    upward = rise_and_fall(
        instant.phase,
        jnp.asarray(1 / time, nothing.dtype),
        jnp.zeros_like(instant.phase),
        gait.swing_height,
        gait.landing_speed,
        time,
    )
    return jax.tree.map(jnp.append, level, upward)


def _right_and_left(side: Int[Array, ""], stance: Float[Array, "3"], swing: Float[Array, "3"]) -> Float[Array, "2 3"]:
    """Values of both feet, in their order, from those of the stance foot, of given side, and of the swing foot."""
    return jnp.where(side == Side.LEFT, jnp.stack([swing, stance]), jnp.stack([stance, swing]))

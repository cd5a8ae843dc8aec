"""The walking controller: robot state and footstep plan in, motor torques out, as one pure function of its memory."""

from dataclasses import dataclass, field
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from iwalker_jax.constants import GRAVITY, TIME_STEP
from iwalker_jax.control.footstep_plan import FootstepPlan
from iwalker_jax.control.gait import advance_gait, initial_gait
from iwalker_jax.control.gait_state import GaitReference, GaitState, Posture
from iwalker_jax.control.parameters import GaitParameters, WholeBodyParameters
from iwalker_jax.control.stepping import SteppingGains, stepping_gains
from iwalker_jax.control.tasks import WholeBodyTask, angular_momentum_task, com_task, foot_task, stack, torso_task
from iwalker_jax.control.whole_body import (
    FRICTION_ROWS,
    Actuation,
    Dynamics,
    motor_torques,
    reduced_dynamics,
    whole_body_program,
)
from iwalker_jax.geometry import Side
from iwalker_jax.optimization import QpPoint, QpSettings, QuadraticProgram, Solution, control_settings, solve_qp
from iwalker_jax.robot import RigidBodyTerms, RobotModel


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Controller:
    """Everything constant about a walking controller; made by `make_controller`.

    Attributes:
        gains: of the stepping feedback.
        actuation: motors, their limits and the arms' posture.
        ankles_roll: whether swing feet can be kept level sideways.
        time_step: control period [s].
        gait, tasks, solver: parameters, static under jit.
    """

    gains: SteppingGains
    actuation: Actuation
    ankles_roll: bool = field(metadata={"static": True}, default=False)
    time_step: float = field(metadata={"static": True}, default=TIME_STEP)
    gait: GaitParameters = field(metadata={"static": True}, default=GaitParameters())
    tasks: WholeBodyParameters = field(metadata={"static": True}, default=WholeBodyParameters())
    solver: QpSettings = field(metadata={"static": True}, default=control_settings())


class ControllerState(NamedTuple):
    """Memory of the controller.

    Attributes:
        gait: of the step clock.
        warm: the last QP's solution, where the next one starts.
    """

    gait: GaitState
    warm: QpPoint


class ControlInfo(NamedTuple):
    """What the controller decided at one tick.

    Attributes:
        reference: of the step clock.
        program: the quadratic program.
        solution: its solution.
        forces: (c, 3) [N] planned contact forces, world frame.
    """

    reference: GaitReference
    program: QuadraticProgram
    solution: Solution
    forces: Float[Array, "c 3"]


def posture_of(terms: RigidBodyTerms, touching: Bool[Array, "2"]) -> Posture:
    """What the step clock needs of the rigid-body terms; `touching` (2,) says which feet press on the floor."""
    forward = terms.foot_rotations[:, :, 0]
    yaws = jnp.arctan2(forward[:, 1], forward[:, 0])
    return Posture(terms.com, terms.com_velocity, terms.foot_positions, yaws, touching)


def initial_controller(controller: Controller, terms: RigidBodyTerms) -> ControllerState:
    """Memory of a robot that stands on both feet."""
    dtype = terms.com.dtype
    legs, contacts = controller.actuation.leg_count, terms.contact_positions.shape[0]
    share = jnp.asarray([0.0, 0.0, 1.0], dtype) * terms.mass * GRAVITY / contacts
    rows = jnp.zeros(FRICTION_ROWS * contacts + legs, dtype)
    warm = QpPoint(
        x=jnp.concatenate([jnp.zeros(legs, dtype), jnp.tile(share, contacts)]),
        y=rows,
        sides=rows.astype(jnp.int32),
        violation=rows,
        block_violation=jnp.zeros(2, dtype),
    )
    return ControllerState(initial_gait(controller.gait, posture_of(terms, jnp.ones(2, bool))), warm)


def control_step(
    controller: Controller,
    terms: RigidBodyTerms,
    arms: tuple[Float[Array, " na"], Float[Array, " na"]],
    touching: Bool[Array, "2"],
    plan: FootstepPlan,
    state: ControllerState,
) -> tuple[Float[Array, " nu"], ControllerState, ControlInfo]:
    """One control tick.

    Args:
        controller: the constants.
        terms: rigid-body quantities of the robot as it is believed to be.
        arms: positions [rad] and velocities [rad/s] of the arms' joints.
        touching: (2,) bool, feet that press on the floor (used if the gait reacts to early touchdown).
        plan: footsteps to take.
        state: memory of the last tick.

    Returns:
        Motor torques (nu,) [N m], the new memory, and what was decided.
    """
    p = controller.tasks
    gait_state, reference = advance_gait(
        controller.gait,
        controller.gains,
        p.capture_gain,
        controller.time_step,
        posture_of(terms, touching),
        plan,
        state.gait,
    )
    arm_acceleration = p.arm_kp * (controller.actuation.arm_pose - arms[0]) - p.arm_kd * arms[1]
    dynamics, program, solution = solve_whole_body(controller, terms, reference, arm_acceleration, state.warm)
    torques = motor_torques(controller.actuation, dynamics, solution.value.x)
    forces = solution.value.x[controller.actuation.leg_count :].reshape(-1, 3)
    return torques, ControllerState(gait_state, solution.value), ControlInfo(reference, program, solution, forces)


class WholeBodySolution(NamedTuple):
    """The whole-body QP at an instant.

    Attributes:
        dynamics: accelerations and torques as functions of the program's unknowns.
        program: the quadratic program.
        solution: its solution.
    """

    dynamics: Dynamics
    program: QuadraticProgram
    solution: Solution


def solve_whole_body(
    controller: Controller,
    terms: RigidBodyTerms,
    reference: GaitReference,
    arm_acceleration: Float[Array, " na"],
    start: QpPoint | None = None,
) -> WholeBodySolution:
    """Set up the whole-body QP for what the robot shall do, and solve it.

    Args:
        controller: the constants.
        terms: rigid-body quantities of the robot.
        reference: what feet, COM and torso shall do.
        arm_acceleration: (na,) [rad/s^2] prescribed.
        start: guess of the solution.
    """
    tasks = whole_body_tasks(controller, terms, reference)
    carrying = jnp.repeat(reference.stance, terms.contact_positions.shape[0] // 2)
    dynamics = reduced_dynamics(terms, carrying, arm_acceleration)
    program = whole_body_program(controller.tasks, controller.actuation, dynamics, tasks, carrying, terms.mass)
    return WholeBodySolution(dynamics, program, solve_qp(program, start, controller.solver))


def whole_body_tasks(controller: Controller, terms: RigidBodyTerms, reference: GaitReference) -> WholeBodyTask:
    """The tasks of one tick, stacked."""
    p = controller.tasks
    return stack(
        [
            *(
                foot_task(
                    p, terms, foot, controller.ankles_roll, reference.stance[foot], reference.foot, reference.foot_yaw
                )
                for foot in Side
            ),
            torso_task(p, terms, reference.heading),
            com_task(p, terms, reference.com_acceleration, reference.com_height),
            angular_momentum_task(p, terms),
        ]
    )


def make_controller(
    robot: RobotModel,
    gait: GaitParameters | None = None,
    tasks: WholeBodyParameters | None = None,
    solver: QpSettings | None = None,
) -> Controller:
    """A controller for a robot, ticking at the physics' time step; computes the stepping gains on the host."""
    gait = gait or GaitParameters()
    moments = np.asarray(robot.motor_moments, np.float64)[:, 6:]
    dtype = robot.home.dtype
    actuation = Actuation(
        motors_from_torques=jnp.asarray(np.linalg.inv(moments.T), dtype),
        limits=jnp.min(jnp.abs(robot.motor_limits), axis=1),
        arm_pose=robot.home[robot.arm_positions],
    )
    return Controller(
        stepping_gains(gait, dtype),
        actuation,
        robot.ankles_roll,
        robot.time_step,
        gait,
        tasks or WholeBodyParameters(),
        solver or control_settings(),
    )

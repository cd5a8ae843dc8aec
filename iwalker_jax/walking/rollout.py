"""Roll-outs of the walking robot: sensors, estimator, controller and physics as one pure function, scanned.

One tick is one control period and one physics step. A robot that has fallen or turned non-finite is frozen where it is,
so that it can touch neither its batch neighbours nor their speed.
"""

from dataclasses import dataclass, field
from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.constants import GRAVITY
from iwalker_jax.control import (
    ControlInfo,
    Controller,
    ControllerState,
    FootstepPlan,
    GaitMode,
    control_step,
    initial_controller,
)
from iwalker_jax.estimation import (
    EstimatorParameters,
    EstimatorState,
    SensorNoise,
    SensorState,
    estimate_step,
    estimated_qpos_qvel,
    initial_estimate,
    initial_sensors,
    simulate_sensors,
)
from iwalker_jax.optimization import Status
from iwalker_jax.robot import (
    ContactSettings,
    LegKinematics,
    PhysicsState,
    RigidBodyTerms,
    RobotModel,
    complete_step,
    complete_step_by_mjx,
    initial_state,
    rigid_body_terms,
    smooth_stages,
    terms_from_data,
    vary,
)

PhysicsStep = Literal["own", "mjx.step"]
"""Whose step moves the robot: ours, which has gradients, or MJX's own, whose values it equals."""

MAX_DELAY = 4
"""Longest delay of the torques, in ticks."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Walker:
    """A robot with everything that makes it walk.

    Attributes:
        robot: as the controller knows it.
        controller: its constants.
        legs: kinematics for the estimator.
        noise: of the simulated sensors; None feeds the true state back.
        estimator: the filter's parameters.
        contacts: settings of our step's contact solver.
        physics: whose step moves the robot.
        fall_tilt: tilt of the base [rad], and fall_height: its height as a share of the nominal, that count as a fall.
    """

    robot: RobotModel
    controller: Controller
    legs: LegKinematics
    noise: SensorNoise | None = field(metadata={"static": True}, default=None)
    estimator: EstimatorParameters = EstimatorParameters()
    contacts: ContactSettings = field(metadata={"static": True}, default=ContactSettings())
    physics: PhysicsStep = field(metadata={"static": True}, default="own")
    fall_tilt: float = field(metadata={"static": True}, default=0.785)
    fall_height: float = field(metadata={"static": True}, default=0.5)


class Conditions(NamedTuple):
    """What is particular to one simulated robot and its world; the controller is told none of it.

    Attributes:
        friction: () coefficient of all contacts.
        mass_scale: () factor of all masses and inertias.
        push_force: (3,) [N] on the torso, world frame, during the push.
        push_start: () [s]; push_time: () [s].
        delay: () int32, ticks by which the torques come late, at most MAX_DELAY.
        qpos, qvel: state at the start.
        key: of the sensors' noise.
        images_lost: () bool, visual odometry gives no poses.
    """

    friction: Float[Array, "*batch"]
    mass_scale: Float[Array, "*batch"]
    push_force: Float[Array, "*batch 3"]
    push_start: Float[Array, "*batch"]
    push_time: Float[Array, "*batch"]
    delay: Int[Array, "*batch"]
    qpos: Float[Array, "*batch nq"]
    qvel: Float[Array, "*batch nv"]
    key: Array
    images_lost: Bool[Array, "*batch"]


class Sensing(NamedTuple):
    """Sensors and what is made of them.

    Attributes:
        sensors: their state; estimate: the filter's.
        specific_force: (3,) [m/s^2] of the last period, base frame.
    """

    sensors: SensorState
    estimate: EstimatorState
    specific_force: Float[Array, "3"]


class ControllerMemory(NamedTuple):
    """What a robot remembers between two ticks.

    Attributes:
        controller: the controller's memory.
        sensing: sensors and estimate, or None with the true state fed back.
        torques: (MAX_DELAY + 1, nu) last motor torques, newest first [N m].
        touching: (2,) bool, feet pressed on the floor in the last step.
    """

    controller: ControllerState
    sensing: Sensing | None
    torques: Float[Array, "d nu"]
    touching: Bool[Array, "2"]


class WalkState(NamedTuple):
    """Everything that a roll-out carries from tick to tick.

    Attributes:
        physics: the true robot.
        memory: what its controller remembers.
        fallen: () bool, the robot lies or its state is not finite; it is frozen.
    """

    physics: PhysicsState
    memory: ControllerMemory
    fallen: Bool[Array, ""]


class Sample(NamedTuple):
    """What a roll-out records, at the beginning of a recording interval or over it.

    Attributes:
        time: () [s]; qpos: (nq,).
        com, com_velocity: (3,) true; believed_velocity: (3,) as the controller believes [m, m/s].
        feet: (2, 3) [m] and foot_yaws: (2,) [rad], true; heading: () [rad] of the torso.
        mode, stance, step: of the step clock.
        torques: (nu,) largest motor torques in size over the interval [N m].
        forces: (c, 3) [N] on the contact points.
        qp_residual: () largest and qp_failures: () number of ticks whose QP did not converge, over the interval.
        fallen: () bool.
    """

    time: Float[Array, "*n"]
    qpos: Float[Array, "*n nq"]
    com: Float[Array, "*n 3"]
    com_velocity: Float[Array, "*n 3"]
    believed_velocity: Float[Array, "*n 3"]
    feet: Float[Array, "*n 2 3"]
    foot_yaws: Float[Array, "*n 2"]
    heading: Float[Array, "*n"]
    mode: Int[Array, "*n"]
    stance: Int[Array, "*n"]
    step: Int[Array, "*n"]
    torques: Float[Array, "*n nu"]
    forces: Float[Array, "*n c 3"]
    qp_residual: Float[Array, "*n"]
    qp_failures: Int[Array, "*n"]
    fallen: Bool[Array, "*n"]


def start_memory(walker: Walker, conditions: Conditions) -> ControllerMemory:
    """Memory of a robot standing in its conditions' start state."""
    terms = rigid_body_terms(walker.robot, conditions.qpos, conditions.qvel)
    sensing = None
    if walker.noise is not None:
        sensors = initial_sensors(walker.noise, conditions.key, conditions.qpos)
        level = terms.base_rotation.T @ jnp.asarray([0.0, 0.0, GRAVITY], terms.com.dtype)
        sensing = Sensing(
            sensors, initial_estimate(walker.legs, conditions.qpos, conditions.qvel, parameters=walker.estimator), level
        )
    torques = jnp.zeros((MAX_DELAY + 1, walker.robot.motor_moments.shape[0]), terms.com.dtype)
    return ControllerMemory(initial_controller(walker.controller, terms), sensing, torques, jnp.ones(2, bool))


def start_walk(walker: Walker, conditions: Conditions) -> WalkState:
    """A robot standing in its conditions' start state."""
    physics = initial_state(walker.robot, conditions.qpos, conditions.qvel)
    return WalkState(physics, start_memory(walker, conditions), jnp.asarray(False))


class ControlOutput(NamedTuple):
    """What one tick's sensing and control lead to.

    Attributes:
        torques: (nu,) [N m] that reach the motors now, the delay included.
        believed: rigid-body terms that the controller went by.
        info: the controller's.
    """

    torques: Float[Array, " nu"]
    believed: RigidBodyTerms
    info: ControlInfo


def sense_and_control(
    walker: Walker,
    conditions: Conditions,
    plan: FootstepPlan,
    memory: ControllerMemory,
    qpos: Float[Array, " nq"],
    qvel: Float[Array, " nv"],
    nominal: RigidBodyTerms | None = None,
) -> tuple[ControllerMemory, ControlOutput]:
    """Sense, estimate and control: everything of a tick but the physics, whose engine may be any.

    Args:
        qpos, qvel: the true state.
        nominal: the nominal robot's terms at it, if they are at hand; used where the true state is fed back.
    """
    sensing = memory.sensing
    if walker.noise is not None and sensing is not None:
        sensors, readings = simulate_sensors(walker.noise, sensing.sensors, qpos, qvel, sensing.specific_force)
        readings = readings._replace(image_arrived=readings.image_arrived & ~conditions.images_lost)
        gait = memory.controller.gait
        carrying = jnp.where(gait.mode == GaitMode.WALK, jax.nn.one_hot(gait.stance, 2), 1.0).astype(qpos.dtype)
        estimate = estimate_step(walker.estimator, walker.legs, sensing.estimate, readings, carrying)
        qpos, qvel = estimated_qpos_qvel(estimate)
        sensing = sensing._replace(sensors=sensors, estimate=estimate)
        nominal = None
    terms = rigid_body_terms(walker.robot, qpos, qvel) if nominal is None else nominal
    arms = qpos[walker.robot.arm_positions], qvel[walker.robot.arm_velocities]
    torques, controller, info = control_step(walker.controller, terms, arms, memory.touching, plan, memory.controller)
    queue = jnp.concatenate([torques[None], memory.torques[:-1]])
    late = queue[jnp.clip(conditions.delay, 0, MAX_DELAY)]
    return ControllerMemory(controller, sensing, queue, memory.touching), ControlOutput(late, terms, info)


def after_physics(
    memory: ControllerMemory, touching: Bool[Array, " c"], specific_force: Float[Array, "3"]
) -> ControllerMemory:
    """Memory with the outcome of a physics step: pressed contact points, specific force [m/s^2] in the base frame."""
    sensing = None if memory.sensing is None else memory.sensing._replace(specific_force=specific_force)
    return memory._replace(touching=jnp.any(touching.reshape(2, -1), axis=1), sensing=sensing)


def push_at(conditions: Conditions, time: Float[Array, ""]) -> Float[Array, "3"]:
    """Force on the torso [N] at a time [s]."""
    pushed = (time >= conditions.push_start) & (time < conditions.push_start + conditions.push_time)
    return conditions.push_force * pushed


def has_fallen(walker: Walker, qpos: Float[Array, " nq"], qvel: Float[Array, " nv"]) -> Bool[Array, ""]:
    """Whether a robot lies, or its state is not finite."""
    upward = 1 - 2 * (qpos[4] ** 2 + qpos[5] ** 2)  # third diagonal element of the base's rotation
    upright = (upward > jnp.cos(walker.fall_tilt)) & (qpos[2] > walker.fall_height * walker.robot.home[2])
    return ~(upright & jnp.all(jnp.isfinite(qpos)) & jnp.all(jnp.isfinite(qvel)))


def walk_tick(walker: Walker, conditions: Conditions, plan: FootstepPlan, state: WalkState) -> tuple[WalkState, Sample]:
    """One control period and physics step of one robot."""
    physics = state.physics
    plant = vary(walker.robot, mass_scale=conditions.mass_scale, friction=conditions.friction)
    data = smooth_stages(plant, physics.qpos, physics.qvel)
    truth = terms_from_data(plant, data)
    nominal = without_mass_scale(walker.robot, truth, conditions.mass_scale)
    memory, output = sense_and_control(walker, conditions, plan, state.memory, physics.qpos, physics.qvel, nominal)
    push = jnp.concatenate([push_at(conditions, physics.time), jnp.zeros(3, physics.qpos.dtype)])
    if walker.physics == "mjx.step":
        moved, info = complete_step_by_mjx(plant, physics, data, output.torques, push)
    else:
        moved, info = complete_step(plant, physics, data, output.torques, push, walker.contacts)
    memory = after_physics(memory, info.touching, info.accelerometer)
    sample = make_sample(physics.time, physics.qpos, truth, memory, output, info.contact_forces, state.fallen)
    fallen = state.fallen | has_fallen(walker, moved.qpos, moved.qvel)
    after = jax.tree.map(lambda new, old: jnp.where(fallen, old, new), WalkState(moved, memory, fallen), state)
    return after._replace(fallen=fallen, physics=after.physics._replace(time=moved.time)), sample


def without_mass_scale(robot: RobotModel, terms: RigidBodyTerms, scale: Float[Array, ""]) -> RigidBodyTerms:
    """Terms of the nominal robot from those of one whose masses are all `scale` times as large.

    All is proportional to mass but the reflected inertias; so the controller need not repeat the kinematics.
    """
    tendons = robot.tendon_moments
    reflected = jnp.diag(robot.model.dof_armature) + tendons.T @ (tendons * robot.model.tendon_armature[:, None])
    return terms._replace(
        mass_matrix=(terms.mass_matrix - reflected) / scale + reflected,
        bias=terms.bias / scale,
        mass=terms.mass / scale,
        angular_momentum=terms.angular_momentum / scale,
        angular_momentum_jacobian=terms.angular_momentum_jacobian / scale,
        angular_momentum_bias=terms.angular_momentum_bias / scale,
    )


def make_sample(
    time: Float[Array, ""],
    qpos: Float[Array, " nq"],
    truth: RigidBodyTerms,
    memory: ControllerMemory,
    output: ControlOutput,
    forces: Float[Array, "c 3"],
    fallen: Bool[Array, ""],
) -> Sample:
    """The record of one tick."""
    gait, solution = memory.controller.gait, output.info.solution
    rotation = truth.base_rotation
    return Sample(
        time=time,
        qpos=qpos,
        com=truth.com,
        com_velocity=truth.com_velocity,
        believed_velocity=output.believed.com_velocity,
        feet=truth.foot_positions,
        foot_yaws=jnp.arctan2(truth.foot_rotations[:, 1, 0], truth.foot_rotations[:, 0, 0]),
        heading=jnp.arctan2(rotation[1, 0], rotation[0, 0]),
        mode=gait.mode,
        stance=gait.stance,
        step=gait.step,
        torques=jnp.abs(output.torques),
        forces=forces,
        qp_residual=solution.residual,
        qp_failures=(solution.status != Status.CONVERGED).astype(jnp.int32),
        fallen=fallen,
    )


def roll_out(
    walker: Walker,
    conditions: Conditions,
    plan: FootstepPlan,
    state: WalkState,
    samples: int,
    every: int = 10,
) -> tuple[WalkState, Sample]:
    """`samples` recording intervals of `every` ticks for one robot; vmap over conditions, plan and state for many."""

    def tick(index: Array, carry: tuple[WalkState, Sample]) -> tuple[WalkState, Sample]:
        state, record = carry
        state, sample = walk_tick(walker, conditions, plan, state)
        record = jax.tree.map(lambda new, old: jnp.where(index == 0, new, old), sample, record)
        return state, record._replace(
            torques=jnp.maximum(record.torques, sample.torques),
            qp_residual=jnp.maximum(record.qp_residual, sample.qp_residual),
            qp_failures=record.qp_failures + jnp.where(index == 0, 0, sample.qp_failures),
        )

    def interval(state: WalkState, _: None) -> tuple[WalkState, Sample]:
        # Starting from an empty record traces and compiles the tick once instead of twice.
        return jax.lax.fori_loop(0, every, tick, (state, empty))

    shapes = jax.eval_shape(partial(walk_tick, walker), conditions, plan, state)[1]
    empty = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    return jax.lax.scan(interval, state, None, length=samples)

"""Roll-outs of the walking robot: sensors, estimator, controller and physics as one pure function, scanned.

One tick is one control period and one physics step. A robot that has fallen or turned non-finite is frozen where it is,
so that it can touch neither its batch neighbours nor their speed.
"""

from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.control.controller import Controller, ControllerState, control_step, initial_controller
from iwalker_jax.control.footstep_plan import FootstepPlan
from iwalker_jax.control.gait import WALK, GaitState
from iwalker_jax.control.whole_body import GRAVITY
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
from iwalker_jax.optimization.solution import Solution, Status
from iwalker_jax.robot.leg_kinematics import LegKinematics
from iwalker_jax.robot.model import LEG_JOINTS, RobotModel
from iwalker_jax.robot.physics import ContactSolver, PhysicsInfo, PhysicsState, complete_step, initial_state
from iwalker_jax.robot.rigid_body import RigidBodyTerms, rigid_body_terms, smooth_stages, terms_from_data

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
        contacts: settings of the contact solver.
        fall_tilt: tilt of the base [rad], and fall_height: its height as a share of the nominal, that count as a fall.
    """

    robot: RobotModel
    controller: Controller
    legs: LegKinematics
    noise: SensorNoise | None = field(metadata={"static": True}, default=None)
    estimator: EstimatorParameters = EstimatorParameters()
    contacts: ContactSolver = field(metadata={"static": True}, default=ContactSolver())
    fall_tilt: float = field(metadata={"static": True}, default=0.785)
    fall_height: float = field(metadata={"static": True}, default=0.5)


class Conditions(NamedTuple):
    """What one simulated robot meets; the controller knows none of it.

    Attributes:
        friction: () coefficient of all contacts.
        mass_scale: () factor of all masses and inertias.
        push_force: (3,) [N] on the torso, world frame, during the push.
        push_start: () [s]; push_time: () [s].
        delay: () int32, ticks by which the torques come late, at most MAX_DELAY.
        qpos, qvel: state at the start.
        key: of the sensors' noise.
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


class Sensing(NamedTuple):
    """Sensors and what is made of them.

    Attributes:
        sensors: their state; estimate: the filter's.
        specific_force: (3,) [m/s^2] of the last period, base frame.
    """

    sensors: SensorState
    estimate: EstimatorState
    specific_force: Float[Array, "3"]


class WalkState(NamedTuple):
    """Everything that a roll-out carries from tick to tick.

    Attributes:
        physics: the true robot.
        controller: its controller's memory.
        sensing: sensors and estimate, or None with the true state fed back.
        torques: (MAX_DELAY + 1, nu) last motor torques, newest first.
        touching: (2,) bool feet pressed on the floor in the last step.
        fallen: () bool, the robot lies or its state is not finite; it is frozen.
    """

    physics: PhysicsState
    controller: ControllerState
    sensing: Sensing | None
    torques: Float[Array, "d nu"]
    touching: Bool[Array, "2"]
    fallen: Bool[Array, ""]


class Sample(NamedTuple):
    """What a roll-out records, at the beginning of a recording interval or over it.

    Attributes:
        time: () [s]; qpos: (nq,).
        com, com_velocity: (3,) true; believed_velocity: (3,) as the controller believes [m, m/s].
        feet: (2, 3) [m] and foot_yaws: (2,) [rad], true; heading: () [rad] of the torso.
        mode, stance, step: of the step clock.
        torques: (nu,) largest motor torques in size over the interval [N m].
        forces: (4, 3) [N] on the contact points.
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
    forces: Float[Array, "*n 4 3"]
    qp_residual: Float[Array, "*n"]
    qp_failures: Int[Array, "*n"]
    fallen: Bool[Array, "*n"]


def start_walk(walker: Walker, conditions: Conditions) -> WalkState:
    """A robot standing in its conditions' start state."""
    robot = walker.robot
    physics = initial_state(robot, conditions.qpos, conditions.qvel)
    terms = rigid_body_terms(robot, conditions.qpos, conditions.qvel)
    sensing = None
    if walker.noise is not None:
        sensors = initial_sensors(walker.noise, conditions.key, conditions.qpos)
        level = terms.base_rotation.T @ jnp.asarray([0.0, 0.0, GRAVITY], terms.com.dtype)
        sensing = Sensing(sensors, initial_estimate(walker.legs, conditions.qpos, conditions.qvel), level)
    torques = jnp.zeros((MAX_DELAY + 1, robot.motor_moments.shape[0]), terms.com.dtype)
    return WalkState(
        physics, initial_controller(walker.controller, terms), sensing, torques, jnp.ones(2, bool), jnp.asarray(False)
    )


def walk_tick(walker: Walker, conditions: Conditions, plan: FootstepPlan, state: WalkState) -> tuple[WalkState, Sample]:
    """One control period: sense, estimate, control and move one robot."""
    plant = _vary(walker.robot, conditions.mass_scale, conditions.friction)
    data = smooth_stages(plant, state.physics.qpos, state.physics.qvel)
    truth = terms_from_data(plant, data)
    sensing, terms, arms = _perceive(walker, truth, conditions.mass_scale, state)
    torques, controller, info = control_step(walker.controller, terms, arms, state.touching, plan, state.controller)
    torques = jnp.concatenate([torques[None], state.torques[:-1]])
    time = state.physics.time
    pushed = (time >= conditions.push_start) & (time < conditions.push_start + conditions.push_time)
    push = jnp.concatenate([conditions.push_force * pushed, jnp.zeros(3, torques.dtype)])
    late = torques[jnp.clip(conditions.delay, 0, MAX_DELAY)]
    physics, happened = complete_step(plant, state.physics, data, late, push, walker.contacts)
    touching = jnp.any(happened.touching.reshape(2, 2), axis=1)
    if sensing is not None:
        sensing = sensing._replace(specific_force=happened.accelerometer)
    sample = _sample(state, truth, terms, controller.gait, late, happened, info.solution)
    after = WalkState(physics, controller, sensing, torques, touching, state.fallen)
    finite = jnp.all(jnp.isfinite(physics.qpos)) & jnp.all(jnp.isfinite(physics.qvel))
    upright = truth.base_rotation[2, 2] > jnp.cos(walker.fall_tilt)
    high = physics.qpos[2] > walker.fall_height * walker.robot.home[2]
    fallen = state.fallen | ~(finite & upright & high)
    after = jax.tree.map(lambda new, old: jnp.where(fallen, old, new), after, state)
    return after._replace(fallen=fallen, physics=after.physics._replace(time=physics.time)), sample


def _perceive(
    walker: Walker, truth: RigidBodyTerms, mass_scale: Float[Array, ""], state: WalkState
) -> tuple[Sensing | None, RigidBodyTerms, tuple[Array, Array]]:
    """What the controller is given: rigid-body terms and the arms' joints, estimated or true, with nominal masses."""
    arms = 7 + 2 * len(LEG_JOINTS)
    if walker.noise is None or state.sensing is None:
        qpos, qvel = state.physics.qpos, state.physics.qvel
        return None, without_mass_scale(walker.robot, truth, mass_scale), (qpos[arms:], qvel[arms - 1 :])
    sensing = state.sensing
    sensors, readings = simulate_sensors(
        walker.noise, sensing.sensors, state.physics.qpos, state.physics.qvel, sensing.specific_force
    )
    gait = state.controller.gait
    carrying = jnp.where(gait.mode == WALK, jax.nn.one_hot(gait.stance, 2), 1.0).astype(sensing.specific_force.dtype)
    estimate = estimate_step(walker.estimator, walker.legs, sensing.estimate, readings, carrying)
    qpos, qvel = estimated_qpos_qvel(estimate)
    sensing = Sensing(sensors, estimate, sensing.specific_force)
    return sensing, rigid_body_terms(walker.robot, qpos, qvel), (qpos[arms:], qvel[arms - 1 :])


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


def _sample(
    state: WalkState,
    truth: RigidBodyTerms,
    believed: RigidBodyTerms,
    gait: GaitState,
    torques: Float[Array, " nu"],
    happened: PhysicsInfo,
    solution: Solution,
) -> Sample:
    rotation = truth.base_rotation
    return Sample(
        time=state.physics.time,
        qpos=state.physics.qpos,
        com=truth.com,
        com_velocity=truth.com_velocity,
        believed_velocity=believed.com_velocity,
        feet=truth.foot_positions,
        foot_yaws=jnp.arctan2(truth.foot_rotations[:, 1, 0], truth.foot_rotations[:, 0, 0]),
        heading=jnp.arctan2(rotation[1, 0], rotation[0, 0]),
        mode=gait.mode,
        stance=gait.stance,
        step=gait.step,
        torques=jnp.abs(torques),
        forces=happened.contact_forces,
        qp_residual=solution.residual,
        qp_failures=(solution.status != Status.CONVERGED).astype(jnp.int32),
        fallen=state.fallen,
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


def _vary(robot, mass_scale, friction):
    import dataclasses

    m = robot.model
    m = m.replace(
        body_mass=m.body_mass * mass_scale,
        body_inertia=m.body_inertia * mass_scale,
        body_subtreemass=m.body_subtreemass * mass_scale,
        geom_friction=m.geom_friction.at[:, 0].set(friction),
    )
    return dataclasses.replace(robot, model=m)

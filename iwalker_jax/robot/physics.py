"""One step of the robot's physics: MJX's collisions, our dynamics and contact solver; values equal `mjx.step`.

A step comes in two halves so that a controller can use the kinematics in between: `smooth_stages` (dynamics.py) of
the state, then `complete_step` with the motor torques. Everything is differentiable in both modes; derivatives are
those of the converged contact problem (contact_solver.py) and jump only where a contact or a joint limit opens or
closes.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.robot.contact.constraints import contact_problem, find_contacts, pyramid_edges
from iwalker_jax.robot.contact.solver import ContactSettings, row_forces, solve_contact
from iwalker_jax.robot.dynamics import SmoothStages, point_velocity, smooth_stages
from iwalker_jax.robot.engine import mjx
from iwalker_jax.robot.limbs import solve_symmetric
from iwalker_jax.robot.model import RobotModel


class PhysicsState(NamedTuple):
    """State of the simulated robot.

    Attributes:
        qpos: (nq,) base position [m] and quaternion (wxyz), joint positions [rad].
        qvel: (nv,) base velocity [m/s world, rad/s base frame], joint velocities [rad/s].
        warmstart: (nv,) last acceleration, where the contact solver starts.
        time: () [s].
    """

    qpos: Float[Array, " nq"]
    qvel: Float[Array, " nv"]
    warmstart: Float[Array, " nv"]
    time: Float[Array, ""]


class PhysicsInfo(NamedTuple):
    """What happened in a step, at its beginning.

    Attributes:
        acceleration: (nv,) generalised acceleration.
        contact_forces: (c, 3) [N] on the robot, world frame, by contact point.
        contact_distances: (c,) [m] from each contact point to what it can touch; negative when it penetrates.
        touching: (c,) bool, whether a contact point is pressed.
        gyro: (3,) [rad/s] angular velocity in the IMU frame.
        accelerometer: (3,) [m/s^2] specific force in the IMU frame; (0, 0, g) at rest on level ground.
        residual: () of the contact solver, relative; iterations: () it took.
    """

    acceleration: Float[Array, " nv"]
    contact_forces: Float[Array, "c 3"]
    contact_distances: Float[Array, " c"]
    touching: Bool[Array, " c"]
    gyro: Float[Array, "3"]
    accelerometer: Float[Array, "3"]
    residual: Float[Array, ""]
    iterations: Int[Array, ""]


def initial_state(robot: RobotModel, qpos: Array | None = None, qvel: Array | None = None) -> PhysicsState:
    """State at rest in the home posture, or with the given positions and velocities."""
    qpos = robot.home if qpos is None else qpos
    resting = jnp.zeros(robot.motor_moments.shape[1], qpos.dtype)
    return PhysicsState(qpos, resting if qvel is None else qvel, resting, jnp.zeros((), qpos.dtype))


def physics_step(
    robot: RobotModel,
    state: PhysicsState,
    torques: Float[Array, " nu"],
    external_force: Float[Array, "6"] | None = None,
    solver: ContactSettings = ContactSettings(),
) -> tuple[PhysicsState, PhysicsInfo]:
    """Advance by one time step; see `complete_step`."""
    data = smooth_stages(robot, state.qpos, state.qvel)
    return complete_step(robot, state, data, torques, external_force, solver)


def complete_step(
    robot: RobotModel,
    state: PhysicsState,
    data: SmoothStages,
    torques: Float[Array, " nu"],
    external_force: Float[Array, "6"] | None = None,
    solver: ContactSettings = ContactSettings(),
) -> tuple[PhysicsState, PhysicsInfo]:
    """Advance by one time step from smooth stages already done.

    Args:
        state: of the robot.
        data: `smooth_stages` of this state.
        torques: (nu,) motor torques [N m], clipped to the motors' limits.
        external_force: (6,) force [N] and torque [N m] on the torso at its COM, world frame; none by default.
        solver: settings of the contact solver.
    """
    motors = jnp.clip(torques, robot.motor_limits[:, 0], robot.motor_limits[:, 1])
    damping = robot.model.dof_damping
    force = robot.motor_moments.T @ motors - data.bias - damping * data.qvel
    if external_force is not None:
        force = force.at[:6].add(_base_force(data, external_force))
    contact = find_contacts(robot, data)
    problem = contact_problem(robot, data, contact, force)
    solution = solve_contact(robot.limbs, solver, problem, state.warmstart)
    acceleration = mean_acceleration = solution.acceleration
    if robot.damped:
        # implicitfast: damping acts on the velocity at the end of the step.
        late = robot.time_step * damping
        mean_acceleration = acceleration - solve_symmetric(
            robot.limbs, problem.mass + jnp.diag(late), late * acceleration
        )
    qvel = state.qvel + robot.time_step * mean_acceleration
    qpos = _integrate(data.qpos, qvel, robot.time_step)
    forces, distances = contact_forces(robot, contact, row_forces(problem, acceleration))
    gyro, accelerometer = imu_readings(robot, data, acceleration)
    info = PhysicsInfo(
        acceleration,
        forces,
        distances,
        jnp.any(forces != 0, axis=1),
        gyro,
        accelerometer,
        solution.residual,
        solution.iterations,
    )
    return PhysicsState(qpos, qvel, acceleration, state.time + robot.time_step), info


def _base_force(data: SmoothStages, wrench: Float[Array, "6"]) -> Float[Array, "6"]:
    """Generalised force on the base's velocities of a force and torque at the torso's COM, world frame."""
    force, torque = wrench[:3], wrench[3:] + jnp.cross(data.torso_com - data.base_position, wrench[:3])
    return data.axes[:6, 3:] @ force + data.axes[:6, :3] @ torque


def _integrate(qpos: Float[Array, " nq"], qvel: Float[Array, " nv"], time_step: float) -> Float[Array, " nq"]:
    """Positions a time step later; the base turns about its own axes."""
    half = time_step / 2 * qvel[3:6]
    square = jnp.sum(half**2)
    small = square < 1e-10
    angle = jnp.sqrt(jnp.where(small, 1.0, square))
    sinc = jnp.where(small, 1 - square / 6, jnp.sin(angle) / angle)
    cosine = jnp.where(small, 1 - square / 2, jnp.cos(angle))
    w, vector = qpos[3], qpos[4:7]
    turn = sinc * half
    quaternion = jnp.append(w * cosine - vector @ turn, w * turn + cosine * vector + jnp.cross(vector, turn))
    quaternion = quaternion / jnp.linalg.norm(quaternion)
    return jnp.concatenate([qpos[:3] + time_step * qvel[:3], quaternion, qpos[7:] + time_step * qvel[6:]])


def contact_forces(
    robot: RobotModel, contact: mjx.Contact, row_forces: Float[Array, " m"]
) -> tuple[Float[Array, "c 3"], Float[Array, " c"]]:
    """World-frame force on each contact point, and its distance to the nearest geom it can touch."""
    world = jnp.sum(row_forces.reshape(-1, 4, 1) * pyramid_edges(contact), axis=1)
    points = jnp.asarray(robot.contact_geoms)[:, None]
    # A contact's normal points from its first geom to its second, and the force acts on the second.
    second, first = contact.geom2 == points, contact.geom1 == points
    forces = (second.astype(world.dtype) - first) @ world
    return forces, jnp.min(jnp.where(first | second, contact.dist, jnp.inf), axis=1)


def imu_readings(robot: RobotModel, data: SmoothStages, acceleration: Float[Array, " nv"]) -> tuple[Array, Array]:
    """Gyroscope and accelerometer readings in the IMU frame."""
    rotation, arm = data.site_rotations[-1], data.site_positions[-1] - data.base_position
    motion = data.qvel[:6] @ data.axes[:6]
    change = jnp.sum(data.drifts[:6], axis=0) + acceleration[:6] @ data.axes[:6]
    point = point_velocity(change, arm) + jnp.cross(motion[:3], point_velocity(motion, arm))
    return rotation.T @ motion[:3], rotation.T @ (point - robot.model.opt.gravity)

"""Rigid-body quantities of the robot that a whole-body controller needs, from MJX's smooth stages alone.

Velocities are MuJoCo's: base linear velocity in the world frame, base angular velocity in the base frame, joints.
MuJoCo's motion axes (cdof) and their rates (cdof_dot) are spatial vectors [angular, linear] in world axes about the
robot's COM; with them a point of body b at r from the COM has the Jacobian column a_lin + a_ang x r for the
velocities in b's chain. COM and angular momentum come from the first six rows of the equations of motion: with R, p
the base's pose, M and h the mass matrix and bias, m J_com = M[0:3] and k J = R M[3:6] - (com - p) x M[0:3].
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float
from mujoco import mjx

from iwalker_jax.robot.model import RobotModel


class RigidBodyTerms(NamedTuple):
    """Rigid-body quantities in world axes; `bias` accelerations are those at zero generalised acceleration.

    Contact points are ordered toe, heel of the right, then of the left foot; feet right, left.

    Attributes:
        mass_matrix: (nv, nv) with reflected inertias of joints and tendons.
        bias: (nv,) Coriolis, centrifugal and gravity forces, on the left-hand side.
        mass: () [kg].
        com: (3,) [m]; com_velocity: (3,) [m/s].
        com_jacobian: (3, nv); com_bias_acceleration: (3,) [m/s^2].
        angular_momentum: (3,) about the COM [kg m^2/s]; reflected inertias do not count.
        angular_momentum_jacobian: (3, nv); angular_momentum_bias: (3,) [N m].
        contact_positions: (4, 3) [m]; contact_velocities: (4, 3) [m/s].
        contact_jacobians: (4, 3, nv); contact_bias_accelerations: (4, 3) [m/s^2].
        foot_positions: (2, 3) of the feet's middles [m]; foot_rotations: (2, 3, 3) from foot to world axes.
        foot_jacobians: (2, 6, nv) and foot_velocities: (2, 6): linear of the middle, then angular.
        foot_bias_accelerations: (2, 6) [m/s^2, rad/s^2].
        base_rotation: (3, 3) from base to world axes.
        torso_angular_velocity: (3,) [rad/s]; torso_jacobian: (3, nv); torso_bias: (3,) [rad/s^2], always zero.
    """

    mass_matrix: Float[Array, "nv nv"]
    bias: Float[Array, " nv"]
    mass: Float[Array, ""]
    com: Float[Array, "3"]
    com_velocity: Float[Array, "3"]
    com_jacobian: Float[Array, "3 nv"]
    com_bias_acceleration: Float[Array, "3"]
    angular_momentum: Float[Array, "3"]
    angular_momentum_jacobian: Float[Array, "3 nv"]
    angular_momentum_bias: Float[Array, "3"]
    contact_positions: Float[Array, "4 3"]
    contact_velocities: Float[Array, "4 3"]
    contact_jacobians: Float[Array, "4 3 nv"]
    contact_bias_accelerations: Float[Array, "4 3"]
    foot_positions: Float[Array, "2 3"]
    foot_rotations: Float[Array, "2 3 3"]
    foot_jacobians: Float[Array, "2 6 nv"]
    foot_velocities: Float[Array, "2 6"]
    foot_bias_accelerations: Float[Array, "2 6"]
    base_rotation: Float[Array, "3 3"]
    torso_angular_velocity: Float[Array, "3"]
    torso_jacobian: Float[Array, "3 nv"]
    torso_bias: Float[Array, "3"]


def smooth_stages(robot: RobotModel, qpos: Float[Array, " nq"], qvel: Float[Array, " nv"]) -> mjx.Data:
    """MJX data with kinematics, mass matrix, velocities and bias forces at a state; no contacts.

    Args:
        qpos: (nq,) base position [m] and quaternion (wxyz, any length), joint positions [rad].
        qvel: (nv,) base velocity [m/s world, rad/s base frame], joint velocities [rad/s].
    """
    model = robot.model
    data = mjx.make_data(model, impl="jax").replace(qpos=qpos, qvel=qvel)
    data = mjx.crb(model, mjx.com_pos(model, mjx.kinematics(model, data)))
    moments = robot.tendon_moments
    reflected = moments.T @ (moments * model.tendon_armature[:, None])
    data = data.tree_replace({"_impl.M": data._impl.M + reflected})
    return mjx.rne(model, mjx.com_vel(model, data))


def rigid_body_terms(robot: RobotModel, qpos: Float[Array, " nq"], qvel: Float[Array, " nv"]) -> RigidBodyTerms:
    """Rigid-body quantities at a state; see `smooth_stages` for the arguments."""
    return terms_from_data(robot, smooth_stages(robot, qpos, qvel))


def terms_from_data(robot: RobotModel, data: mjx.Data) -> RigidBodyTerms:
    """Rigid-body quantities of data whose smooth stages are done, so that controller and physics share them."""
    mass_matrix, bias = data._impl.M, data.qfrc_bias
    base = robot.base
    mass, com = robot.model.body_subtreemass[base], data.subtree_com[base]
    rotation, arm = data.xmat[base], data.subtree_com[base] - data.xpos[base]
    momentum_jacobian = mass_matrix[:3]
    spin_jacobian = rotation @ mass_matrix[3:6] - jnp.cross(arm, momentum_jacobian, axisb=0, axisc=0)

    positions = data.site_xpos[jnp.asarray(robot.contact_sites + robot.foot_sites)]
    offsets = positions - com
    motion = foot_motion_axes(robot, data)
    points_foot = jnp.asarray([0, 0, 1, 1, 0, 1])
    jacobians = motion.linear[points_foot] + jnp.swapaxes(
        jnp.cross(jnp.swapaxes(motion.angular, 1, 2)[points_foot], offsets[:, None]), 1, 2
    )
    spin = motion.velocity[points_foot, :3]
    velocities = motion.velocity[points_foot, 3:] + jnp.cross(spin, offsets)
    accelerations = motion.acceleration[points_foot, 3:] + jnp.cross(motion.acceleration[points_foot, :3], offsets)
    accelerations = accelerations + jnp.cross(spin, velocities)
    torso_jacobian = jnp.zeros_like(momentum_jacobian).at[:, 3:6].set(rotation)
    return RigidBodyTerms(
        mass_matrix=mass_matrix,
        bias=bias,
        mass=mass,
        com=com,
        com_velocity=momentum_jacobian @ data.qvel / mass,
        com_jacobian=momentum_jacobian / mass,
        com_bias_acceleration=bias[:3] / mass + robot.model.opt.gravity,
        angular_momentum=spin_jacobian @ data.qvel,
        angular_momentum_jacobian=spin_jacobian,
        angular_momentum_bias=rotation @ bias[3:6] - jnp.cross(arm, bias[:3]),
        contact_positions=positions[:4],
        contact_velocities=velocities[:4],
        contact_jacobians=jacobians[:4],
        contact_bias_accelerations=accelerations[:4],
        foot_positions=positions[4:],
        foot_rotations=data.site_xmat[jnp.asarray(robot.foot_sites)],
        foot_jacobians=jnp.concatenate([jacobians[4:], motion.angular], axis=1),
        foot_velocities=jnp.concatenate([velocities[4:], motion.velocity[:, :3]], axis=1),
        foot_bias_accelerations=jnp.concatenate([accelerations[4:], motion.acceleration[:, :3]], axis=1),
        base_rotation=rotation,
        torso_angular_velocity=rotation @ data.qvel[3:6],
        torso_jacobian=torso_jacobian,
        torso_bias=jnp.zeros_like(com),
    )


class FootMotionAxes(NamedTuple):
    """Spatial motion of the feet's bodies about the COM, world axes.

    Attributes:
        angular, linear: (2, 3, nv) motion axes of each foot's chain, zero elsewhere.
        velocity: (2, 6) [angular, linear].
        acceleration: (2, 6) spatial, at zero generalised acceleration and without gravity.
    """

    angular: Float[Array, "2 3 nv"]
    linear: Float[Array, "2 3 nv"]
    velocity: Float[Array, "2 6"]
    acceleration: Float[Array, "2 6"]


def foot_motion_axes(robot: RobotModel, data: mjx.Data) -> FootMotionAxes:
    """Motion axes, velocity and bias acceleration of both feet."""
    axes = robot.foot_chains[:, None] * data.cdof.T
    rates = data.cdof_dot * data.qvel[:, None]
    return FootMotionAxes(
        axes[:, :3], axes[:, 3:], data.cvel[jnp.asarray(robot.foot_bodies)], robot.foot_chains @ rates
    )

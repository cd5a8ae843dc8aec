"""Rigid-body quantities of the robot that a whole-body controller needs.

Velocities are MuJoCo's: base linear velocity in the world frame, base angular velocity in the base frame, joints.
COM and angular momentum come from the first six rows of the equations of motion: with R, p the base's pose, M and h
the mass matrix and bias, m J_com = M[0:3] and k J = R M[3:6] - (com - p) x M[0:3]; their rates come from h alike.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.robot.dynamics import SmoothStages, point_velocity, smooth_stages
from iwalker_jax.robot.model import RobotModel


class RigidBodyTerms(NamedTuple):
    """Rigid-body quantities in world axes; `bias` accelerations are those at zero generalised acceleration.

    Contact points are ordered as `RobotModel.contact_geoms`, the right foot's first; feet right, left.

    Attributes:
        mass_matrix: (nv, nv) with reflected inertias of joints and tendons.
        bias: (nv,) Coriolis, centrifugal and gravity forces, on the left-hand side.
        mass: () [kg].
        com: (3,) [m]; com_velocity: (3,) [m/s].
        com_jacobian: (3, nv); com_bias_acceleration: (3,) [m/s^2].
        angular_momentum: (3,) about the COM [kg m^2/s]; reflected inertias do not count.
        angular_momentum_jacobian: (3, nv); angular_momentum_bias: (3,) [N m].
        contact_positions: (c, 3) [m]; contact_velocities: (c, 3) [m/s].
        contact_jacobians: (c, 3, nv); contact_bias_accelerations: (c, 3) [m/s^2].
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
    contact_positions: Float[Array, "c 3"]
    contact_velocities: Float[Array, "c 3"]
    contact_jacobians: Float[Array, "c 3 nv"]
    contact_bias_accelerations: Float[Array, "c 3"]
    foot_positions: Float[Array, "2 3"]
    foot_rotations: Float[Array, "2 3 3"]
    foot_jacobians: Float[Array, "2 6 nv"]
    foot_velocities: Float[Array, "2 6"]
    foot_bias_accelerations: Float[Array, "2 6"]
    base_rotation: Float[Array, "3 3"]
    torso_angular_velocity: Float[Array, "3"]
    torso_jacobian: Float[Array, "3 nv"]
    torso_bias: Float[Array, "3"]


def rigid_body_terms(robot: RobotModel, qpos: Float[Array, " nq"], qvel: Float[Array, " nv"]) -> RigidBodyTerms:
    """Rigid-body quantities at a state; see `smooth_stages` for the arguments."""
    return terms_from_data(robot, smooth_stages(robot, qpos, qvel))


def terms_from_data(robot: RobotModel, data: SmoothStages) -> RigidBodyTerms:
    """Rigid-body quantities of smooth stages already done, so that controller and physics share them."""
    mass, bias, rotation = data.mass, data.bias, data.base_rotation
    momentum_jacobian = data.mass_matrix[:3]
    arm = data.com - data.base_position
    spin_jacobian = rotation @ data.mass_matrix[3:6] - jnp.cross(arm[:, None], momentum_jacobian, axis=0)

    # The contact points, then the middles of the feet.
    points, contacts = robot.foot_points, 2 * robot.foot_points
    positions = data.site_positions[: contacts + 2]
    arms = positions - data.base_position
    chains = jnp.stack([robot.skeleton.chains[robot.skeleton.body_ids.index(body)] for body in robot.foot_bodies])
    motion, drift = chains @ (data.axes * data.qvel[:, None]), chains @ data.drifts
    jacobians = _by_point(chains, points)[:, None] * jnp.swapaxes(point_velocity(data.axes, arms[:, None]), 1, 2)
    spins = _by_point(motion, points)[:, :3]
    velocities = point_velocity(_by_point(motion, points), arms)
    accelerations = point_velocity(_by_point(drift, points), arms) + jnp.cross(spins, velocities)
    turns = chains[:, None] * data.axes[:, :3].T
    torso_jacobian = jnp.zeros_like(momentum_jacobian).at[:, 3:6].set(rotation)
    return RigidBodyTerms(
        mass_matrix=data.mass_matrix,
        bias=bias,
        mass=mass,
        com=data.com,
        com_velocity=momentum_jacobian @ data.qvel / mass,
        com_jacobian=momentum_jacobian / mass,
        com_bias_acceleration=bias[:3] / mass + robot.model.opt.gravity,
        angular_momentum=spin_jacobian @ data.qvel,
        angular_momentum_jacobian=spin_jacobian,
        angular_momentum_bias=rotation @ bias[3:6] - jnp.cross(arm, bias[:3]),
        contact_positions=positions[:contacts],
        contact_velocities=velocities[:contacts],
        contact_jacobians=jacobians[:contacts],
        contact_bias_accelerations=accelerations[:contacts],
        foot_positions=positions[contacts:],
        foot_rotations=data.site_rotations[contacts : contacts + 2],
        foot_jacobians=jnp.concatenate([jacobians[contacts:], turns], axis=1),
        foot_velocities=jnp.concatenate([velocities[contacts:], motion[:, :3]], axis=1),
        foot_bias_accelerations=jnp.concatenate([accelerations[contacts:], drift[:, :3]], axis=1),
        base_rotation=rotation,
        torso_angular_velocity=rotation @ data.qvel[3:6],
        torso_jacobian=torso_jacobian,
        torso_bias=jnp.zeros_like(arm),
    )


def _by_point(feet: Float[Array, " 2 *k"], points: int) -> Float[Array, " n *k"]:
    """Values of the feet by point: of the right and the left foot's contact points, then both middles."""
    right, left = feet
    return jnp.stack([right] * points + [left] * points + [right, left])

"""Tasks of the whole body: what a part shall accelerate like, as weighted linear rows that can be stacked.

Each task says rows @ qdd = target in the least-squares sense; eq. 16 of the iWalker paper.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.control.parameters import WholeBodyParameters
from iwalker_jax.control.swing import TrajectoryPoint
from iwalker_jax.geometry import Side, angle_between
from iwalker_jax.robot import RigidBodyTerms


class WholeBodyTask(NamedTuple):
    """Rows of a weighted least-squares problem in the generalised accelerations.

    Attributes:
        rows: (k, nv) Jacobian of the task.
        target: (k,) wanted task acceleration less the one that the present velocities cause.
        weight: (k,) not negative.
    """

    rows: Float[Array, "k nv"]
    target: Float[Array, " k"]
    weight: Float[Array, " k"]


def stack(tasks: list[WholeBodyTask]) -> WholeBodyTask:
    """All tasks as one."""
    return WholeBodyTask(*(jnp.concatenate(parts) for parts in zip(*tasks, strict=True)))


def foot_task(
    parameters: WholeBodyParameters,
    terms: RigidBodyTerms,
    foot: Side,
    rolls: bool,
    stance: Float[Array, ""],
    motion: TrajectoryPoint,
    yaw: TrajectoryPoint,
) -> WholeBodyTask:
    """Position of a foot's middle, its pitch and its yaw: damped where it stands, tracked where it swings.

    Pitch is the angular motion about the foot's horizontal lateral axis. Roll, about its own forward axis, is left free
    where the ankle has none.

    Args:
        foot: which one.
        rolls: whether the ankle can roll.
        stance: 1 where it carries, 0 where it swings.
        motion, yaw: of the swing foot, world frame.
    """
    p = parameters
    forward = terms.foot_rotations[foot][:, 0]
    level = jnp.sqrt(forward[0] ** 2 + forward[1] ** 2 + 1e-12)
    lateral = jnp.stack([-forward[1], forward[0], jnp.zeros_like(level)]) / level
    turns = [lateral, jnp.zeros_like(lateral).at[2].set(1.0)]
    axes = jnp.stack([*turns, forward] if rolls else turns)
    jacobian = terms.foot_jacobians[foot]
    rows = jnp.concatenate([jacobian[:3], axes @ jacobian[3:]])
    velocity = terms.foot_velocities[foot]
    spin = axes @ velocity[3:]
    bias = terms.foot_bias_accelerations[foot]
    bias = jnp.concatenate([bias[:3], axes @ bias[3:]])
    swing_linear = (
        motion.acceleration
        + p.swing_position_kp * (motion.position - terms.foot_positions[foot])
        + p.swing_position_kd * (motion.velocity - velocity[:3])
    )
    facing = jnp.arctan2(forward[1], forward[0])
    still = jnp.zeros_like(yaw.velocity)
    roll = [-terms.foot_rotations[foot][2, 1]] if rolls else []
    error = jnp.stack([forward[2], angle_between(yaw.position, facing), *roll])
    rate = jnp.stack([still, yaw.velocity, *[still for _ in roll]])
    bend = jnp.stack([still, yaw.acceleration, *[still for _ in roll]])
    swing_angular = bend + p.swing_orientation_kp * error + p.swing_orientation_kd * (rate - spin)
    swing = jnp.concatenate([swing_linear, swing_angular])
    standing = -p.stance_kd * jnp.concatenate([velocity[:3], spin])
    swing_weight = jnp.asarray([p.swing_position] * 3 + [p.swing_orientation] * len(axes), rows.dtype)
    # Two points 42 mm either side of the middle held with the weight of the middle give the angular share.
    stance_weight = jnp.asarray([p.stance] * 3 + [p.stance_angular] * len(axes), rows.dtype)
    target = jnp.where(stance > 0, standing, swing) - bias
    return WholeBodyTask(rows, target, jnp.where(stance > 0, stance_weight, swing_weight))


def torso_task(parameters: WholeBodyParameters, terms: RigidBodyTerms, heading: TrajectoryPoint) -> WholeBodyTask:
    """Torso upright and facing along the heading [rad]; angular acceleration, world axes."""
    p = parameters
    cos, sin = jnp.cos(heading.position), jnp.sin(heading.position)
    zero, one = jnp.zeros_like(cos), jnp.ones_like(cos)
    wanted = jnp.stack([jnp.stack([cos, -sin, zero]), jnp.stack([sin, cos, zero]), jnp.stack([zero, zero, one])])
    error = jnp.sum(jnp.cross(terms.base_rotation.T, wanted.T), axis=0) / 2
    rate = jnp.stack([zero, zero, heading.velocity])
    dtype = cos.dtype
    kp = jnp.asarray([p.torso_tilt_kp, p.torso_tilt_kp, p.torso_yaw_kp], dtype)
    kd = jnp.asarray([p.torso_tilt_kd, p.torso_tilt_kd, p.torso_yaw_kd], dtype)
    target = kp * error + kd * (rate - terms.torso_angular_velocity) - terms.torso_bias
    return WholeBodyTask(terms.torso_jacobian, target, jnp.asarray([p.torso_tilt, p.torso_tilt, p.torso_yaw], dtype))


def com_task(
    parameters: WholeBodyParameters, terms: RigidBodyTerms, acceleration: Float[Array, "2"], height: Float[Array, ""]
) -> WholeBodyTask:
    """COM follows the pendulum's horizontal acceleration [m/s^2] at a height [m]: linear momentum over mass."""
    p = parameters
    rise = p.com_height_kp * (height - terms.com[2]) - p.com_height_kd * terms.com_velocity[2]
    weight = jnp.asarray([p.com_horizontal, p.com_horizontal, p.com_height], rise.dtype)
    return WholeBodyTask(terms.com_jacobian, jnp.append(acceleration, rise) - terms.com_bias_acceleration, weight)


def angular_momentum_task(parameters: WholeBodyParameters, terms: RigidBodyTerms) -> WholeBodyTask:
    """Centroidal angular momentum towards zero."""
    target = -parameters.angular_momentum_kd * terms.angular_momentum - terms.angular_momentum_bias
    weight = jnp.full(3, parameters.angular_momentum, target.dtype)
    return WholeBodyTask(terms.angular_momentum_jacobian, target, weight)

"""What the state estimator remembers, how it begins, and what it says about the robot."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.errors import InputError
from iwalker_jax.estimation.axis_filter import BIAS, CONSIDERED, LEFT_FOOT, POSITION, RIGHT_FOOT, VELOCITY
from iwalker_jax.estimation.parameters import EstimatorParameters
from iwalker_jax.estimation.readings import Health
from iwalker_jax.geometry import rotations as attitude
from iwalker_jax.robot import LegKinematics, foot_motion

_INITIAL_STD = (0.002, 0.02, 0.05, 0.002, 0.002, 1e-4, 1e-4)  # of p [m], v [m/s], b [m/s^2], r, l [m], c [m/s^2], d [m]
_LEVEL = 0.9  # correlation of b and c at the start: the robot knows its tilt, so the acceleration's error is the bias


class EstimatorState(NamedTuple):
    """All that the filter remembers; fixed shapes, never NaN.

    Attributes:
        quaternion: (4,) wxyz, base to world.
        angular_velocity: (3,) [rad/s] in the base frame, gyro bias taken off.
        gyro_bias: (3,) [rad/s] in the base frame.
        accelerometer_bias: () [m/s^2] along the vertical; its horizontal part passes for tilt.
        position: (3,) [m] base origin in the world.
        velocity: (3,) [m/s] of the base origin, world axes.
        feet: (2, 3) [m] midfoot minus base origin, world axes (right, left).
        odometry_drift: (3,) [m] by which visual odometry is believed to have lost the true position.
        covariance: (2, 7, 7) of `axis_filter`'s states: one horizontal axis, and the vertical axis.
        contact_trust: (2,) in [0, 1], follows the contact plan.
        joint_positions: (joints,) [rad] last believed reading.
        joint_velocities: (joints,) [rad/s] likewise.
        memory: (ticks, 4) past x, y, z [m] and unwrapped yaw [rad], newest first, without the image corrections.
        image_correction: (4,) sum of all corrections of x, y, z and yaw by images.
        mean_acceleration: (3,) [m/s^2] lately, world axes, by the accelerometer.
        mean_turn: (3,) [rad/s] by which the filter has lately corrected the attitude that the gyro carries.
        health: what became of the last readings.
    """

    quaternion: Float[Array, "4"]
    angular_velocity: Float[Array, "3"]
    gyro_bias: Float[Array, "3"]
    accelerometer_bias: Float[Array, ""]
    position: Float[Array, "3"]
    velocity: Float[Array, "3"]
    feet: Float[Array, "2 3"]
    odometry_drift: Float[Array, "3"]
    covariance: Float[Array, "2 7 7"]
    contact_trust: Float[Array, "2"]
    joint_positions: Float[Array, " joints"]
    joint_velocities: Float[Array, " joints"]
    memory: Float[Array, "ticks 4"]
    image_correction: Float[Array, "4"]
    mean_acceleration: Float[Array, "3"]
    mean_turn: Float[Array, "3"]
    health: Health


def initial_estimate(
    legs: LegKinematics,
    qpos: Float[Array, " positions"],
    qvel: Float[Array, " velocities"],
    memory_ticks: int = 64,
    parameters: EstimatorParameters = EstimatorParameters(),
) -> EstimatorState:
    """The estimate of a robot whose state is known, within millimetres, at the start.

    Args:
        legs: the robot's leg kinematics.
        qpos, qvel: state in MuJoCo's conventions.
        memory_ticks: control periods to remember for delayed images; an older image is rejected.
        parameters: what the filter believes about its sensors.

    Raises:
        InputError: on other shapes or fewer than two remembered periods.
    """
    if qpos.ndim != 1 or qvel.shape != (qpos.shape[0] - 1,) or qpos.shape[0] < 7:
        raise InputError(f"qpos and qvel must have shapes (n + 7,) and (n + 6,), got {qpos.shape} and {qvel.shape}.")
    if memory_ticks < 2:
        raise InputError(f"The estimator must remember at least 2 control periods for images, got {memory_ticks}.")
    dtype = qpos.dtype
    quaternion = qpos[3:7]
    feet = foot_motion(legs, qpos[7:], qvel[6:]).position @ attitude.rotation_matrix(quaternion).T
    pose = jnp.concatenate([qpos[:3], attitude.yaw_of(quaternion)[None]])
    no, zero = jnp.zeros((), bool), jnp.zeros((), dtype)
    return EstimatorState(
        quaternion=quaternion,
        angular_velocity=qvel[3:6],
        gyro_bias=jnp.zeros(3, dtype),
        accelerometer_bias=zero,
        position=qpos[:3],
        velocity=qvel[:3],
        feet=feet,
        odometry_drift=jnp.zeros(3, dtype),
        covariance=_initial_covariance(jnp.asarray(parameters.accelerometer_bias, dtype)),
        contact_trust=jnp.ones(2, dtype),
        joint_positions=qpos[7:],
        joint_velocities=qvel[6:],
        memory=jnp.tile(pose, (memory_ticks, 1)),
        image_correction=jnp.zeros(4, dtype),
        mean_acceleration=jnp.zeros(3, dtype),
        mean_turn=jnp.zeros(3, dtype),
        health=Health(no, no, no, no, jnp.zeros(2, bool), no, jnp.zeros(2, dtype), zero, zero),
    )


def _initial_covariance(accelerometer_bias: Float[Array, ""]) -> Float[Array, "2 7 7"]:
    """Of a robot whose state is known; the accelerometer's bias [m/s^2] is not."""
    covariance = jnp.tile(jnp.diag(jnp.asarray(_INITIAL_STD, accelerometer_bias.dtype) ** 2), (2, 1, 1))
    variance = accelerometer_bias**2 + covariance[0, CONSIDERED, CONSIDERED]
    both = jnp.asarray([BIAS, CONSIDERED])
    return (
        covariance.at[0, both, both]
        .set(variance)
        .at[0, BIAS, CONSIDERED]
        .set(_LEVEL * variance)
        .at[0, CONSIDERED, BIAS]
        .set(_LEVEL * variance)
    )


class BelievedErrors(NamedTuple):
    """Standard deviations that the filter believes its errors to have.

    Attributes:
        position: (3,) [m]; velocity: (3,) [m/s].
        tilt: () [rad] about each horizontal axis.
        feet: (2, 3) [m] relative to the base (right, left).
    """

    position: Float[Array, "3"]
    velocity: Float[Array, "3"]
    tilt: Float[Array, ""]
    feet: Float[Array, "2 3"]


def believed_errors(state: EstimatorState, parameters: EstimatorParameters = EstimatorParameters()) -> BelievedErrors:
    """How well the filter believes to know base and feet."""
    by_axis = jnp.asarray([0, 0, 1])
    std = jnp.sqrt(jnp.diagonal(state.covariance, axis1=1, axis2=2))[by_axis]
    horizontal = state.covariance[0]
    lean = horizontal[BIAS, BIAS] - 2 * horizontal[BIAS, CONSIDERED] + horizontal[CONSIDERED, CONSIDERED]
    feet = jnp.stack([std[:, RIGHT_FOOT], std[:, LEFT_FOOT]])
    return BelievedErrors(std[:, POSITION], std[:, VELOCITY], jnp.sqrt(lean) / parameters.gravity, feet)


def estimated_qpos_qvel(state: EstimatorState) -> tuple[Float[Array, " positions"], Float[Array, " velocities"]]:
    """qpos and qvel in MuJoCo's conventions: linear velocity in the world frame, angular velocity in the base's."""
    qpos = jnp.concatenate([state.position, state.quaternion, state.joint_positions])
    return qpos, jnp.concatenate([state.velocity, state.angular_velocity, state.joint_velocities])

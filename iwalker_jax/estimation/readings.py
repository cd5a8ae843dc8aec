"""What the robot's sensors deliver in one control period, and which of it can be used."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.checks import Scalar


class Readings(NamedTuple):
    """Sensor readings of one control period. A reading that is NaN or beyond its sensor's range counts as missing.

    Attributes:
        gyro: (3,) [rad/s] angular velocity in the IMU frame, which is the base frame.
        accelerometer: (3,) [m/s^2] mean specific force over the period, in the base frame; (0, 0, g) at rest.
        joint_positions: (joints,) [rad] in the order of qpos[7:].
        joint_velocities: (joints,) [rad/s].
        image_position: (3,) [m] base origin in the world by visual odometry, at the image's time.
        image_yaw: () [rad] heading of the base in the world by visual odometry, any branch.
        image_age: () [s] how long ago the image was taken.
        image_arrived: () bool, whether a visual-odometry pose arrived in this period.
    """

    gyro: Float[Array, "3"]
    accelerometer: Float[Array, "3"]
    joint_positions: Float[Array, " joints"]
    joint_velocities: Float[Array, " joints"]
    image_position: Float[Array, "3"]
    image_yaw: Float[Array, ""]
    image_age: Float[Array, ""]
    image_arrived: Bool[Array, ""]


class Health(NamedTuple):
    """What the filter made of one period's readings; residuals are in standard deviations, 1 when all is well.

    Attributes:
        gyro_rejected: () bool, the last angular velocity was held.
        accelerometer_rejected: () bool, constant velocity was assumed.
        gyro_doubted: () bool, the attitude has had to be corrected for long: reversed, scaled or stuck.
        accelerometer_doubted: () bool, it has told of an acceleration for long that no walk has: likewise.
        joints_rejected: (2,) bool by leg (right, left), the last positions and velocities were held and not used.
        image_rejected: () bool, a pose arrived that was not finite or older than the remembered poses.
        foot_residual: (2,) how far each foot lay from where it was believed to stand.
        velocity_residual: () how far leg odometry lay from the predicted velocity; 0 without a stance foot.
        image_residual: () how far visual odometry lay from the remembered position; 0 without an image.
    """

    gyro_rejected: Bool[Array, ""]
    accelerometer_rejected: Bool[Array, ""]
    gyro_doubted: Bool[Array, ""]
    accelerometer_doubted: Bool[Array, ""]
    joints_rejected: Bool[Array, "2"]
    image_rejected: Bool[Array, ""]
    foot_residual: Float[Array, "2"]
    velocity_residual: Float[Array, ""]
    image_residual: Float[Array, ""]


def within_range(values: Float[Array, "*shape"], limit: Scalar) -> Bool[Array, "*shape"]:
    """Where values are finite and at most `limit` in size; NaN compares as false."""
    return jnp.abs(values) <= limit

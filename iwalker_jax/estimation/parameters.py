"""What the state estimator believes about its sensors, once, with units."""

from dataclasses import dataclass, fields

import jax

from iwalker_jax.checks import Scalar
from iwalker_jax.constants import GRAVITY, TIME_STEP
from iwalker_jax.errors import InputError


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class EstimatorParameters:
    """Noise of the filter's model and measurements; a pytree, so that any of them may be traced and tuned.

    Standard deviations are what the filter should allow for while walking (impacts, slip, tilt error), which is more
    than the sensors' own noise. The legs are trusted little, the IMU much: a filter that takes a sliding foot for a
    moving base feeds the slide back through the controller, and the robot falls on slippery floors.

    Attributes:
        control_period: [s] between two calls.
        gravity: [m/s^2].
        tilt_rate: [1/s] rate at which tilt follows the accelerometer besides; times the period it is the gain per tick.
        tilt_gate: [m/s^2] departure of the accelerometer's magnitude from gravity at which that trust falls to 1/e.
        gyro_bias_gain: [1/s] share of the filter's tilt corrections that goes to the gyro bias.
        yaw_gain: share of a yaw innovation that is corrected at each image.
        yaw_bias_gain: [1/s] share of it that goes to the gyro bias at each image.
        acceleration_noise: [m/s^2] of each accelerometer sample.
        missing_acceleration_noise: [m/s^2] when a sample is missing and constant velocity is assumed.
        missing_gyro_noise: [rad/s] when a sample is missing and the last angular velocity is held.
        acceleration_error_walk: [m/s^2/sqrt(s)] how fast tilt error times gravity and accelerometer bias wander.
        vertical_error_walk: [m/s^2/sqrt(s)] how fast the accelerometer's bias along the vertical wanders.
        accelerometer_bias: [m/s^2] standard deviation of its bias, whose horizontal part passes for tilt, and of what
            else does so: slip, pushes.
        stance_walk: [m/sqrt(s)] slip and rocking of a foot that stands.
        swing_walk: [m/sqrt(s)] freedom of a foot that does not; it is what makes the filter forget a foot's place.
        foot_position_noise: [m] of leg kinematics.
        foot_velocity_noise: [m/s] of leg kinematics, slip of the stance foot included.
        foot_height_noise: [m] of the floor below a standing foot.
        flat_floor: 1 if the floor is the plane z = 0, so that standing feet measure height; 0 to leave that out.
        contact_ramp: [s] after touchdown during which trust in the foot grows from none to full (impact, late contact).
        image_position_noise: [m] of visual odometry.
        image_drift: [m/sqrt(m)] by which visual odometry loses the true position per square root of the way walked.
        outlier_gate: [standard deviations] beyond which a measurement's weight falls as one over its residual (Huber).
        doubt_time: [s] over which the two following are averaged.
        doubted_acceleration: [m/s^2] mean acceleration that no walk has: beyond it the accelerometer is doubted.
        doubted_turn: [rad/s] mean correction of the attitude beyond which the gyro is doubted.
        yaw_gate: [rad] the same for visual odometry's yaw: a larger innovation counts as this.
        gyro_range: [rad/s] beyond it a reading counts as missing.
        accelerometer_range: [m/s^2] likewise.
        joint_position_range: [rad] likewise.
        joint_velocity_range: [rad/s] likewise.
    """

    control_period: Scalar = TIME_STEP
    gravity: Scalar = GRAVITY
    tilt_rate: Scalar = 0.1
    tilt_gate: Scalar = 3.0
    gyro_bias_gain: Scalar = 0.02
    yaw_gain: Scalar = 0.1
    yaw_bias_gain: Scalar = 0.02
    acceleration_noise: Scalar = 0.07
    missing_acceleration_noise: Scalar = 5.0
    missing_gyro_noise: Scalar = 1.0
    acceleration_error_walk: Scalar = 0.02
    vertical_error_walk: Scalar = 0.007
    accelerometer_bias: Scalar = 0.055
    stance_walk: Scalar = 0.01
    swing_walk: Scalar = 0.5
    foot_position_noise: Scalar = 0.001
    foot_velocity_noise: Scalar = 0.3
    foot_height_noise: Scalar = 0.003
    flat_floor: Scalar = 1.0
    contact_ramp: Scalar = 0.02
    image_position_noise: Scalar = 0.005
    image_drift: Scalar = 0.01
    outlier_gate: Scalar = 3.0
    doubt_time: Scalar = 0.5
    doubted_acceleration: Scalar = 2.0
    doubted_turn: Scalar = 0.05
    yaw_gate: Scalar = 0.05
    gyro_range: Scalar = 35.0
    accelerometer_range: Scalar = 160.0
    joint_position_range: Scalar = 7.0
    joint_velocity_range: Scalar = 60.0

    def __post_init__(self) -> None:
        may_be_zero = {
            "tilt_rate",
            "gyro_bias_gain",
            "yaw_gain",
            "yaw_bias_gain",
            "flat_floor",
            "accelerometer_bias",
            "image_drift",
        }
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, (int, float)) and not (0 < value < 1e6 or (value == 0 and field.name in may_be_zero)):
                raise InputError(f"EstimatorParameters.{field.name} must be a positive finite number, got {value}.")

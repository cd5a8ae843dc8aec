"""Simulated sensors: what IMU, encoders and visual odometry would report of a simulated robot's true state."""

import dataclasses
import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key

from iwalker_jax.constants import GRAVITY, TIME_STEP
from iwalker_jax.errors import InputError
from iwalker_jax.estimation.readings import Readings
from iwalker_jax.geometry import rotation_matrix, turn, yaw_of

_IN_FLIGHT = 4  # images under way at a time


@dataclass(frozen=True)
class SensorNoise:
    """Error model of the sensors, white noise per sample at the control rate; the defaults are a good small robot's.

    Attributes:
        control_period: [s] between two calls.
        accelerometer_std: [m/s^2] white noise.
        accelerometer_bias: [m/s^2] standard deviation of a bias that wanders within bias_time.
        gyro_std: [rad/s] white noise.
        gyro_bias: [rad/s] standard deviation of a bias that wanders within bias_time.
        bias_time: [s] correlation time of both biases.
        encoder_std: [rad] white noise of the joint positions, before quantisation.
        encoder_step: [rad] resolution of the joint positions; 0 for none.
        encoder_offset: [rad] standard deviation of a lasting calibration error of each joint.
        joint_velocity_std: [rad/s] white noise.
        image_rate: [Hz] of visual odometry.
        image_delay: [s] from the image to its pose.
        image_position_std: [m] per axis.
        image_yaw_std: [rad].
        image_drift: [m] per axis for the square root of a metre walked: odometry adds up its errors.
        image_yaw_drift: [rad] for the square root of a metre walked.
        image_dropout: chance that an image gives no pose.
    """

    control_period: float = TIME_STEP
    accelerometer_std: float = 0.05
    accelerometer_bias: float = 0.05
    gyro_std: float = 0.01
    gyro_bias: float = 0.002
    bias_time: float = 100.0
    encoder_std: float = 0.0005
    encoder_step: float = 0.0004
    encoder_offset: float = 0.0
    joint_velocity_std: float = 0.05
    image_rate: float = 15.0
    image_delay: float = 0.05
    image_position_std: float = 0.005
    image_yaw_std: float = math.radians(0.3)
    image_drift: float = 0.01
    image_yaw_drift: float = math.radians(0.3)
    image_dropout: float = 0.1

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise InputError(f"SensorNoise.{field.name} must be a finite number of at least 0, got {value}.")
        if self.control_period == 0 or self.bias_time < self.control_period:
            raise InputError("SensorNoise needs a control_period above 0 and a bias_time of at least that.")
        if self.image_rate * self.control_period > 1 or self.image_rate * self.image_delay >= _IN_FLIGHT - 1:
            raise InputError(
                f"SensorNoise takes at most one image a control period and {_IN_FLIGHT - 1} images under way; "
                "lower image_rate or image_delay."
            )
        if self.image_dropout > 1:
            raise InputError(f"SensorNoise.image_dropout is a probability, got {self.image_dropout}.")

    @classmethod
    def none(cls) -> "SensorNoise":
        """Perfect sensors; images come without delay."""
        silent = {field.name: 0.0 for field in fields(cls)}
        kept = {"control_period": cls.control_period, "bias_time": cls.bias_time, "image_rate": cls.image_rate}
        return cls(**(silent | kept))

    @classmethod
    def nominal(cls) -> "SensorNoise":
        """The defaults."""
        return cls()

    @classmethod
    def harsh(cls) -> "SensorNoise":
        """Twice to three times the noise, miscalibrated encoders, late and missing images."""
        return cls(
            accelerometer_std=0.15,
            accelerometer_bias=0.1,
            gyro_std=0.02,
            gyro_bias=0.005,
            encoder_std=0.001,
            encoder_step=0.001,
            encoder_offset=0.003,
            joint_velocity_std=0.1,
            image_rate=10.0,
            image_delay=0.1,
            image_position_std=0.015,
            image_yaw_std=math.radians(1.0),
            image_drift=0.03,
            image_yaw_drift=math.radians(1.0),
            image_dropout=0.3,
        )

    def replace(self, **changes: float) -> "SensorNoise":
        """A copy with some fields changed."""
        return dataclasses.replace(self, **changes)


class SensorState(NamedTuple):
    """What the sensors carry from period to period.

    Attributes:
        key: of all noise to come.
        accelerometer_bias: (3,) [m/s^2].
        gyro_bias: (3,) [rad/s].
        encoder_offset: (joints,) [rad].
        image_phase: () in [0, 1), share of the time to the next image that has passed.
        image_count: () int32 images taken.
        poses: (4, 4) x, y, z [m] and yaw [rad] of images under way.
        ages: (4,) [s] since each was taken; infinite if there is none.
        drift: (3,) x, y [m] and yaw [rad] by which odometry has lost the true pose.
    """

    key: Key[Array, ""]
    accelerometer_bias: Float[Array, "3"]
    gyro_bias: Float[Array, "3"]
    encoder_offset: Float[Array, " joints"]
    image_phase: Float[Array, ""]
    image_count: Int[Array, ""]
    poses: Float[Array, "4 4"]
    ages: Float[Array, "4"]
    drift: Float[Array, "3"]


def initial_sensors(noise: SensorNoise, key: Key[Array, ""], qpos: Float[Array, " positions"]) -> SensorState:
    """Sensors with random biases and a random camera phase; qpos gives the number of joints and the precision."""
    dtype, joints = qpos.dtype, qpos.shape[0] - 7
    key, key_force, key_gyro, key_offset, key_phase = jax.random.split(key, 5)
    return SensorState(
        key=key,
        accelerometer_bias=noise.accelerometer_bias * jax.random.normal(key_force, (3,), dtype),
        gyro_bias=noise.gyro_bias * jax.random.normal(key_gyro, (3,), dtype),
        encoder_offset=noise.encoder_offset * jax.random.normal(key_offset, (joints,), dtype),
        image_phase=jax.random.uniform(key_phase, (), dtype),
        image_count=jnp.zeros((), jnp.int32),
        poses=jnp.zeros((_IN_FLIGHT, 4), dtype),
        ages=jnp.full(_IN_FLIGHT, jnp.inf, dtype),
        drift=jnp.zeros(3, dtype),
    )


def specific_force(
    qpos: Float[Array, " positions"], base_acceleration: Float[Array, "3"], gravity: float = GRAVITY
) -> Float[Array, "3"]:
    """Specific force at the base origin in the base frame [m/s^2], from qpos and qacc[:3] (world axes)."""
    lifted = base_acceleration + jnp.asarray([0, 0, 1], qpos.dtype) * gravity
    return lifted @ rotation_matrix(qpos[3:7])


def simulate_sensors(
    noise: SensorNoise,
    sensors: SensorState,
    qpos: Float[Array, " positions"],
    qvel: Float[Array, " velocities"],
    imu_acceleration: Float[Array, "3"],
) -> tuple[SensorState, Readings]:
    """Readings at the end of a control period.

    Args:
        noise: the sensors' error model.
        sensors: their state.
        qpos, qvel: true state at the end of the period, MuJoCo's conventions; the gyro sees qvel[3:6].
        imu_acceleration: (3,) [m/s^2] true specific force over the period in the base frame.
    """
    dtype, joints = qpos.dtype, qpos.shape[0] - 7
    key, key_normal, key_drop = jax.random.split(sensors.key, 3)
    normal = jax.random.normal(key_normal, (19 + 2 * joints,), dtype)
    force_noise, gyro_noise, force_walk, gyro_walk = normal[:12].reshape(4, 3)
    image_noise, drift_noise, joint_noise = normal[12:16], normal[16:19], normal[19:]
    encoder_noise, rate_noise = joint_noise[:joints], joint_noise[joints:]

    sensors = sensors._replace(
        key=key,
        accelerometer_bias=_wandered(noise, sensors.accelerometer_bias, noise.accelerometer_bias, force_walk),
        gyro_bias=_wandered(noise, sensors.gyro_bias, noise.gyro_bias, gyro_walk),
        drift=_drifted(noise, sensors.drift, qvel[:2], drift_noise),
    )
    sensors, image = _next_image(noise, sensors, qpos, image_noise, key_drop)
    readings = Readings(
        gyro=qvel[3:6] + sensors.gyro_bias + noise.gyro_std * gyro_noise,
        accelerometer=imu_acceleration + sensors.accelerometer_bias + noise.accelerometer_std * force_noise,
        joint_positions=_encoded(noise, qpos[7:] + sensors.encoder_offset + noise.encoder_std * encoder_noise),
        joint_velocities=qvel[6:] + noise.joint_velocity_std * rate_noise,
        image_position=image.pose[:3],
        image_yaw=image.pose[3],
        image_age=image.age,
        image_arrived=image.arrived,
    )
    return sensors, readings


class _Image(NamedTuple):
    """The image whose pose arrives in a period; zeros if none does.

    Attributes:
        pose: (4,) x, y, z [m] and yaw [rad] by odometry.
        age: () [s] since it was taken; arrived: () bool.
    """

    pose: Float[Array, "4"]
    age: Float[Array, ""]
    arrived: Bool[Array, ""]


def _wandered(noise: SensorNoise, bias: Float[Array, "3"], std: float, normal: Float[Array, "3"]) -> Float[Array, "3"]:
    """A bias one period later: an Ornstein-Uhlenbeck process of a standard deviation, driven by standard normals."""
    decay = math.exp(-noise.control_period / noise.bias_time)
    diffusion = math.sqrt(1 - decay**2)
    return decay * bias + diffusion * std * normal


def _encoded(noise: SensorNoise, angles: Float[Array, " joints"]) -> Float[Array, " joints"]:
    """Joint positions [rad] at the encoders' resolution."""
    if noise.encoder_step > 0:
        # Only the rounding is piecewise constant: derivatives pass as if there were none.
        angles += jax.lax.stop_gradient(jnp.round(angles / noise.encoder_step) * noise.encoder_step - angles)
    return angles


def _drifted(
    noise: SensorNoise, drift: Float[Array, "3"], velocity: Float[Array, "2"], normal: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Odometry's drift one period later: it adds up what it believes to have moved, turned by its heading's error."""
    moved = velocity * noise.control_period
    square = jnp.sum(moved**2)
    walked = jnp.where(square > 0, jnp.where(square > 0, square, 1) ** 0.25, 0)  # square root of the distance
    spread = jnp.asarray([noise.image_drift, noise.image_drift, noise.image_yaw_drift], drift.dtype)
    turned = turn(drift[2], moved) - moved
    return drift + jnp.append(turned, 0) + walked * spread * normal


def _next_image(
    noise: SensorNoise, sensors: SensorState, qpos: Float[Array, " positions"], normal: Float[Array, "4"], key: Array
) -> tuple[SensorState, _Image]:
    """Take an image if its time has come, and deliver the one that is due, if any."""
    dtype, drift = qpos.dtype, sensors.drift
    phase = sensors.image_phase + noise.image_rate * noise.control_period
    taken = phase >= 1
    # A lost image never enters the queue.
    entered = taken & (jax.random.uniform(key, (), dtype) >= noise.image_dropout)
    slots = jnp.arange(_IN_FLIGHT)
    enters = entered & (slots == sensors.image_count % _IN_FLIGHT)
    scale = jnp.asarray([noise.image_position_std] * 3 + [noise.image_yaw_std], dtype)
    truth = jnp.concatenate([qpos[:3], yaw_of(qpos[3:7])[None]])
    pose = truth + jnp.stack([drift[0], drift[1], jnp.zeros_like(drift[0]), drift[2]]) + scale * normal
    poses = jnp.where(enters[:, None], pose, sensors.poses)
    ages = jnp.where(enters, 0, sensors.ages + noise.control_period)
    # The oldest image that is due; half a period of slack keeps rounding from adding a tick.
    due = jnp.isfinite(ages) & (ages >= noise.image_delay - noise.control_period / 2)
    delivered = due & (slots == jnp.argmax(jnp.where(due, ages, -1)))
    image = _Image(
        pose=jnp.sum(jnp.where(delivered[:, None], poses, 0), axis=0),
        age=jnp.sum(jnp.where(delivered, ages, 0)),
        arrived=jnp.any(due),
    )
    sensors = sensors._replace(
        image_phase=phase - taken,
        image_count=sensors.image_count + entered,
        poses=poses,
        ages=jnp.where(delivered, jnp.inf, ages),
    )
    return sensors, image

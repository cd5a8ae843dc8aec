"""The estimator on motions whose truth is known (oracle: C MuJoCo's states and inverse kinematics)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.estimation import EstimatorParameters, SensorNoise, estimated_qpos_qvel, initial_estimate
from iwalker_jax.robot import load_leg_kinematics
from tests.estimation.motions import bruce, crouch, squat, walk
from tests.estimation.runs import (
    estimate,
    is_finite,
    position_error,
    rms,
    rotation_error,
    sense,
    velocity_error,
)


@pytest.mark.parametrize("motion", [walk, squat])
def test_perfect_sensors(motion):
    """What is left is slip, which no sensor reports."""
    motion = motion()
    estimates = estimate(motion, sense(motion, SensorNoise.none()))
    assert rms(velocity_error(estimates, motion)) < 0.01
    assert rms(position_error(estimates, motion)) < 0.006
    assert rms(rotation_error(estimates.quaternion, motion.qpos[:, 3:7])) < np.radians(0.15)


@pytest.mark.parametrize("motion", [walk, squat])
@pytest.mark.parametrize("noise", [SensorNoise.nominal(), SensorNoise.harsh()], ids=["nominal", "harsh"])
def test_velocity_is_good_enough_to_walk_on(motion, noise):
    motion = motion()
    estimates = estimate(motion, sense(motion, noise))
    nominal = noise == SensorNoise.nominal()
    assert rms(velocity_error(estimates, motion)) < (0.013 if nominal else 0.025)
    assert np.abs(velocity_error(estimates, motion)).max() < (0.07 if nominal else 0.09)
    assert rms(position_error(estimates, motion)) < (0.012 if nominal else 0.04)
    assert rms(rotation_error(estimates.quaternion, motion.qpos[:, 3:7])) < np.radians(1.0)
    state = jax.tree.map(lambda x: x[0, -1], estimates)
    qpos, qvel = estimated_qpos_qvel(state)
    np.testing.assert_allclose(qpos[7:], motion.qpos[-1, 7:], atol=0.015)
    np.testing.assert_allclose(qvel[3:6], motion.qvel[-1, 3:6], atol=0.1)
    np.testing.assert_array_equal(qvel[:3], state.velocity)


def test_velocity_without_any_image():
    motion = walk()
    estimates = estimate(motion, sense(motion, SensorNoise(image_dropout=1.0)))
    assert rms(velocity_error(estimates, motion)) < 0.015
    assert (estimates.health.image_residual == 0).all() and not estimates.health.image_rejected.any()


def test_late_images_do_not_drag_the_position_behind():
    """0.3 m/s for 100 ms is 3 cm: where an image belongs in time matters."""
    motion = walk()
    readings = sense(motion, SensorNoise.none().replace(image_delay=0.1))
    error = position_error(estimate(motion, readings), motion)
    assert rms(error) < 0.006
    untimed = readings._replace(image_age=jnp.zeros_like(readings.image_age))
    # A part of what is late passes for odometry's drift.
    assert rms(position_error(estimate(motion, untimed), motion)) > 0.015


def test_images_older_than_the_memory_are_rejected():
    motion = walk()
    readings = sense(motion, SensorNoise.none())
    readings = readings._replace(image_age=jnp.full_like(readings.image_age, 0.2))
    estimates = estimate(motion, readings)
    np.testing.assert_array_equal(estimates.health.image_rejected, readings.image_arrived)
    assert rms(velocity_error(estimates, motion)) < 0.015


def test_images_remove_a_wrong_start():
    """5 cm and 0.1 rad of heading off at the start, which legs alone could never tell."""
    motion = walk()
    qpos = motion.qpos[0].copy()
    qpos[:2] += [0.05, -0.03]
    qpos[3:7] = [np.cos(0.05), 0, 0, np.sin(0.05)]
    estimates = estimate(motion, sense(motion, SensorNoise.nominal()), qpos)
    assert rms(position_error(estimates, motion, since=1500)) < 0.015
    heading = rotation_error(estimates.quaternion, motion.qpos[:, 3:7])[:, 1500:, 2]
    assert np.abs(heading).max() < np.radians(1.5)


def test_yaw_wraps():
    """Turn the world so that the heading passes pi; images count their yaw from -pi to pi."""
    motion = walk()
    readings = sense(motion, SensorNoise.nominal())
    plain = estimate(motion, readings)
    for angle in (np.pi - 0.3, 2.0):
        turned = rotated(motion, angle)
        yaw = readings.image_yaw + angle
        seen = readings._replace(
            image_yaw=jnp.arctan2(jnp.sin(yaw), jnp.cos(yaw)),
            image_position=readings.image_position @ jnp.asarray(vertical_turn(angle).T, jnp.float32),
        )
        estimates = estimate(turned, seen)
        np.testing.assert_allclose(estimates.position, plain.position @ vertical_turn(angle).T, atol=2e-4)
        np.testing.assert_allclose(estimates.velocity, plain.velocity @ vertical_turn(angle).T, atol=2e-4)
        np.testing.assert_allclose(
            rotation_error(estimates.quaternion, turned.qpos[:, 3:7])[:, :, 2],
            rotation_error(plain.quaternion, motion.qpos[:, 3:7])[:, :, 2],
            atol=5e-4,
        )


def test_mirror_image():
    """Mirrored readings with the legs exchanged give the mirrored estimate."""
    motion = walk()
    readings = sense(motion, SensorNoise.nominal())
    plain = estimate(motion, readings)
    # Yaw and roll joints change sign; arms are not used by the filter.
    order = np.r_[5:10, 0:5, 13:16, 10:13]
    sign = np.array([-1, 1, -1, 1, 1] * 2 + [1, -1, 1] * 2)
    flip, spin = np.array([1, -1, 1]), np.array([-1, 1, -1])
    mirrored = readings._replace(
        gyro=readings.gyro * spin,
        accelerometer=readings.accelerometer * flip,
        joint_positions=readings.joint_positions[..., order] * sign,
        joint_velocities=readings.joint_velocities[..., order] * sign,
        image_position=readings.image_position * flip,
        image_yaw=-readings.image_yaw,
    )
    qpos, qvel = motion.qpos.copy(), motion.qvel.copy()
    qpos[:, 1] *= -1
    qpos[:, 3:7] *= [1, -1, 1, -1]
    qpos[:, 7:] = qpos[:, 7:][:, order] * sign
    qvel[:, :6] *= np.concatenate([flip, spin])
    qvel[:, 6:] = qvel[:, 6:][:, order] * sign
    image = motion._replace(qpos=qpos, qvel=qvel, contacts=motion.contacts[:, ::-1])
    estimates = estimate(image, jax.tree.map(lambda a, b: jnp.asarray(a, b.dtype), mirrored, readings))
    np.testing.assert_allclose(estimates.position, plain.position * flip, atol=1e-3)
    np.testing.assert_allclose(estimates.velocity, plain.velocity * flip, atol=2e-3)


def test_single_precision_follows_double():
    motion = walk()
    readings = sense(motion, SensorNoise.nominal())
    single = estimate(motion, readings)
    with jax.enable_x64(True):
        wide = jax.tree.map(lambda x: x if x.dtype == bool else jnp.asarray(np.asarray(x), jnp.float64), readings)
        double = estimate(motion, wide)
    assert double.position.dtype == np.float64 and single.position.dtype == np.float32
    assert is_finite(single)
    np.testing.assert_allclose(single.velocity, double.velocity, atol=2e-3)
    np.testing.assert_allclose(single.position, double.position, atol=1e-3)
    np.testing.assert_allclose(single.quaternion, double.quaternion, atol=1e-4)


def test_missing_readings_are_left_out_and_flagged():
    """Each sensor drops out at random, one tick in twenty, as NaN, infinity or nonsense."""
    motion, rng = walk(), np.random.default_rng(0)
    readings = sense(motion, SensorNoise.nominal())
    clean = readings
    lost = {}
    for name in ("gyro", "accelerometer", "joint_positions", "joint_velocities", "image_position", "image_yaw"):
        values = np.array(getattr(readings, name))
        lost[name] = rng.random(values.shape[:2]) < 0.05
        row = values[lost[name]]
        if row.ndim == 2:
            row[:, rng.integers(min(3, row.shape[1]))] = rng.choice([np.nan, np.inf, -1e9], len(row))
        else:
            row[:] = np.nan
        values[lost[name]] = row
        readings = readings._replace(**{name: jnp.asarray(values)})
    estimates = estimate(motion, readings)
    assert is_finite(estimates)
    np.testing.assert_array_equal(estimates.health.gyro_rejected, lost["gyro"])
    np.testing.assert_array_equal(estimates.health.accelerometer_rejected, lost["accelerometer"])
    joints = lost["joint_positions"] | lost["joint_velocities"]
    np.testing.assert_array_equal(estimates.health.joints_rejected[..., 0], joints)
    assert rms(velocity_error(estimates, motion)) < 0.03
    untouched = estimate(motion, clean)
    assert not any(np.any(flag) for flag in untouched.health[:4])


def test_all_sensors_dead_for_a_while():
    motion = walk()
    readings = sense(motion, SensorNoise.nominal())

    def kill(values):
        values = np.array(values)
        if values.dtype != bool:
            values[:, 500:600] = np.nan
        return jnp.asarray(values)

    estimates = estimate(motion, jax.tree.map(kill, readings))
    assert is_finite(estimates)
    assert estimates.health.accelerometer_rejected[:, 500:600].all()
    # The covariance says how little is known, and the filter finds back.
    assert (estimates.covariance[:, 599, 0, 1, 1] > 20 * estimates.covariance[:, 499, 0, 1, 1]).all()
    assert rms(velocity_error(estimates, motion, since=1200)) < 0.02


def test_covariance_covers_the_error_and_stays_symmetric():
    """Standard deviations are neither far too small nor absurdly large for the motion they were chosen for."""
    motion = walk()
    estimates = estimate(motion, sense(motion, SensorNoise.nominal()))
    covariance = estimates.covariance
    np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
    assert np.linalg.eigvalsh(covariance.astype(np.float64)).min() > 0
    std = np.sqrt(covariance[:, 100:, 0, 1, 1])
    ratio = np.abs(velocity_error(estimates, motion)[..., 0]) / std
    assert 0.05 < np.sqrt((ratio**2).mean()) < 1.5


FAULTS = {
    "accelerometer reversed": lambda r: r._replace(accelerometer=-r.accelerometer),
    "accelerometer scaled": lambda r: r._replace(accelerometer=0.6 * r.accelerometer),
    "accelerometer's axes exchanged": lambda r: r._replace(accelerometer=r.accelerometer[..., ::-1]),
    "accelerometer dead": lambda r: r._replace(accelerometer=jnp.zeros_like(r.accelerometer)),
    "gyro reversed": lambda r: r._replace(gyro=-r.gyro),
    "gyro stuck": lambda r: r._replace(gyro=jnp.full_like(r.gyro, 0.5)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_broken_imu_is_doubted(fault):
    """A walk that turns by 0.25 rad/s; a sound IMU is never doubted, a broken one within two seconds."""
    motion = walk()
    readings = sense(motion, SensorNoise.nominal())
    sound = estimate(motion, readings).health
    assert not sound.gyro_doubted.any() and not sound.accelerometer_doubted.any()
    broken = jax.tree.map(lambda bad, good: good.at[:, 500:].set(bad[:, 500:]), FAULTS[fault](readings), readings)
    health = estimate(motion, broken).health
    sensor = health.gyro_doubted if "gyro" in fault else health.accelerometer_doubted
    assert not sensor[:, :500].any()
    assert sensor[:, 500:1500].any(axis=1).all()


def test_slipping_foot_shows_in_the_residual():
    """Both feet slide 5 cm in 0.1 s while they should stand."""
    motion = squat()
    readings = sense(motion, SensorNoise.none())
    calm = estimate(motion, readings).health
    # Both hips roll and the base does not follow.
    swung = np.array(readings.joint_positions)
    swung[:, 600:, [2, 7]] += np.clip((np.arange(swung.shape[1] - 600) / 50), 0, 1)[:, None] * 0.12
    rates = np.array(readings.joint_velocities)
    rates[:, 600:650, [2, 7]] += 0.12 / 0.1
    slipped = readings._replace(joint_positions=jnp.asarray(swung), joint_velocities=jnp.asarray(rates))
    health = estimate(motion, slipped).health
    assert health.foot_residual[:, 600:650].max() > 2 * calm.foot_residual[:, 600:650].max()
    assert health.velocity_residual[:, 600:650].max() > 2 * calm.velocity_residual[:, 600:650].max()


def test_bad_shapes_and_values_are_refused_with_a_sentence():
    legs, qpos = load_leg_kinematics(bruce()), jnp.asarray(crouch(bruce()))
    with pytest.raises(InputError, match="must have shapes"):
        initial_estimate(legs, qpos, jnp.zeros(23))
    with pytest.raises(InputError, match="at least 2 control periods"):
        initial_estimate(legs, qpos, jnp.zeros(22), memory_ticks=1)
    with pytest.raises(InputError, match="foot_velocity_noise must be a positive"):
        EstimatorParameters(foot_velocity_noise=0.0)


def vertical_turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


def rotated(motion, angle: float):
    """The same motion in a world turned about the vertical."""
    qpos, qvel = motion.qpos.copy(), motion.qvel.copy()
    qpos[:, :3] = qpos[:, :3] @ vertical_turn(angle).T
    qvel[:, :3] = qvel[:, :3] @ vertical_turn(angle).T
    c, s = np.cos(angle / 2), np.sin(angle / 2)
    w, x, y, z = motion.qpos[:, 3:7].T
    qpos[:, 3:7] = np.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=1)
    return motion._replace(qpos=qpos, qvel=qvel)

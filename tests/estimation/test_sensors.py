"""Simulated sensors: levels, delays and dropouts as declared."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.estimation import SensorNoise, initial_sensors, simulate_sensors, specific_force
from tests.estimation.motions import PERIOD, Motion, bruce, crouch, squat
from tests.estimation.runs import sense

TICKS = 2000


@pytest.fixture(scope="module")
def standing() -> Motion:
    qpos = np.tile(crouch(bruce()), (TICKS, 1))
    return Motion(qpos, np.zeros((TICKS, 22)), np.tile([0, 0, 9.81], (TICKS, 1)), np.ones((TICKS, 2)))


def moving() -> Motion:
    """Base position and yaw count the ticks, so that an image tells when it was taken."""
    qpos = np.tile(crouch(bruce()), (TICKS, 1))
    qpos[:, 0] = np.arange(TICKS) * PERIOD
    return Motion(qpos, np.zeros((TICKS, 22)), np.tile([0, 0, 9.81], (TICKS, 1)), np.ones((TICKS, 2)))


def test_no_noise_is_the_truth():
    motion = squat()
    readings = sense(motion, SensorNoise.none())
    np.testing.assert_allclose(readings.gyro[0], motion.qvel[:, 3:6], atol=1e-6)
    np.testing.assert_allclose(readings.accelerometer[0], motion.force, rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(readings.joint_positions[0], motion.qpos[:, 7:], atol=1e-6)
    np.testing.assert_allclose(readings.joint_velocities[0], motion.qvel[:, 6:], atol=1e-6)
    seen = np.asarray(readings.image_arrived[0])
    np.testing.assert_allclose(readings.image_position[0][seen], motion.qpos[seen, :3], atol=1e-6)
    assert np.all(readings.image_age[0][seen] == 0)


def test_noise_levels(standing):
    """Oracle: sample statistics; biases last through a run and differ from run to run."""
    noise = SensorNoise()
    readings = sense(standing, noise)
    force = np.asarray(readings.accelerometer) - standing.force
    assert np.isclose(force.std(axis=1).mean(), noise.accelerometer_std, rtol=0.1)
    assert 0.2 < np.abs(force.mean(axis=1)).mean() / noise.accelerometer_bias < 2.5
    gyro = np.asarray(readings.gyro)
    assert np.isclose(gyro.std(axis=1).mean(), noise.gyro_std, rtol=0.05)
    assert 0.2 < np.abs(gyro.mean(axis=1)).mean() / noise.gyro_bias < 2.5
    assert np.isclose(np.std(readings.joint_velocities), noise.joint_velocity_std, rtol=0.02)
    angles = np.asarray(readings.joint_positions, np.float64)
    spread = np.hypot(noise.encoder_std, noise.encoder_step / np.sqrt(12))
    assert np.isclose((angles - standing.qpos[:, 7:]).std(), spread, rtol=0.03)
    counts = angles / noise.encoder_step
    np.testing.assert_allclose(counts, np.round(counts), atol=2e-3)
    seen = np.asarray(readings.image_arrived)
    error = np.asarray(readings.image_position)[seen] - standing.qpos[0, :3]
    assert np.isclose(error.std(), noise.image_position_std, rtol=0.15)
    assert np.isclose(np.asarray(readings.image_yaw)[seen].std(), noise.image_yaw_std, rtol=0.2)


@pytest.mark.parametrize("noise", [SensorNoise.nominal(), SensorNoise.harsh()], ids=["nominal", "harsh"])
def test_images_come_late_at_their_rate_and_some_are_lost(noise):
    noise = noise.replace(image_position_std=0.0, image_yaw_std=0.0)
    motion = moving()
    readings = sense(motion, noise)
    seen = np.asarray(readings.image_arrived)
    expected = noise.image_rate * (1 - noise.image_dropout) * TICKS * PERIOD
    assert abs(seen.sum(axis=1).mean() - expected) < 3 * np.sqrt(expected * noise.image_dropout / 3) + 1
    for run in range(len(seen)):
        arrival = np.flatnonzero(seen[run])
        age = np.asarray(readings.image_age)[run][arrival]
        np.testing.assert_allclose(age, noise.image_delay, atol=1e-6)
        taken = np.asarray(readings.image_position)[run][arrival, 0]
        np.testing.assert_allclose(taken, arrival * PERIOD - age, atol=1e-5)
        gaps = np.diff(arrival) * PERIOD * noise.image_rate
        np.testing.assert_allclose(gaps, np.round(gaps), atol=1.5 * PERIOD * noise.image_rate)


def test_odometry_loses_its_way_with_the_distance():
    """Oracle: a random walk's spread, and a heading error that turns what is walked afterwards."""
    speed, runs = 0.5, 200
    motion = moving()
    motion.qpos[:, 0] *= speed
    motion.qvel[:, 0] = speed
    walked = speed * TICKS * PERIOD
    noise = SensorNoise.none().replace(image_drift=0.02, image_yaw_drift=0.05)
    readings = sense(motion, noise, runs=runs)
    seen = np.asarray(readings.image_arrived)
    ends = np.array([np.flatnonzero(row)[-1] for row in seen])
    each = np.arange(runs)
    error = np.asarray(readings.image_position)[each, ends, :2] - motion.qpos[ends, :2]
    yaw = np.asarray(readings.image_yaw)[each, ends]
    assert np.isclose(yaw.std(), noise.image_yaw_drift * np.sqrt(walked), rtol=0.15)
    assert np.isclose(error[:, 0].std(), noise.image_drift * np.sqrt(walked), rtol=0.2)
    # Sideways the heading adds the integral of a random walk over the distance: its variance is a third of the cube.
    sideways = np.hypot(noise.image_drift * np.sqrt(walked), noise.image_yaw_drift * np.sqrt(walked**3 / 3))
    assert np.isclose(error[:, 1].std(), sideways, rtol=0.2)
    still = sense(motion._replace(qvel=0 * motion.qvel), noise)
    assert np.all(np.asarray(still.image_yaw)[np.asarray(still.image_arrived)] == 0)


def test_runs_differ_by_key_only(standing):
    start, noise = jnp.asarray(standing.qpos[0]), SensorNoise()
    first, again, other = (initial_sensors(noise, jax.random.key(k), start) for k in (0, 0, 1))
    force = jnp.asarray([0, 0, 9.81])
    readings = [simulate_sensors(noise, s, start, jnp.zeros(22), force)[1] for s in (first, again, other)]
    np.testing.assert_array_equal(readings[0].gyro, readings[1].gyro)
    assert np.all(readings[0].gyro != readings[2].gyro)


def test_specific_force_is_what_mujocos_accelerometer_reads():
    """Oracle: MuJoCo's accelerometer sensor at the base origin, in free fall with spin and under a force."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body name='b' pos='0 0 1' quat='.8 .2 -.4 .4'><freejoint/>"
        "<geom size='.1 .2 .3' type='box' pos='.1 0 .05'/><site name='s'/></body></worldbody>"
        "<sensor><accelerometer site='s'/></sensor></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qvel[:] = [0.1, 0.2, 0.3, 1.0, -2.0, 0.5]
    data.qfrc_applied[:] = [30, -20, 10, 1, 2, 3]
    mujoco.mj_forward(model, data)
    force = specific_force(jnp.asarray(data.qpos), jnp.asarray(data.qacc[:3]))
    np.testing.assert_allclose(force, data.sensordata, rtol=1e-5, atol=1e-4)


def test_impossible_settings_are_refused_with_a_sentence():
    with pytest.raises(InputError, match="gyro_std must be a finite number"):
        SensorNoise(gyro_std=-1.0)
    with pytest.raises(InputError, match="images under way"):
        SensorNoise(image_rate=20.0, image_delay=0.3)
    with pytest.raises(InputError, match="probability"):
        SensorNoise(image_dropout=1.5)

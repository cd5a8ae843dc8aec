"""Derivatives through the estimator: forward = reverse = central differences, for every input."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from iwalker_jax.estimation import (
    EstimatorParameters,
    Readings,
    SensorNoise,
    estimate_step,
    estimated_qpos_qvel,
    initial_estimate,
    initial_sensors,
    simulate_sensors,
)
from iwalker_jax.robot import load_leg_kinematics
from tests.estimation.motions import bruce, crouch
from tests.gradients import assert_gradients_agree


def some_readings(qpos, qvel, rng) -> Readings:
    return Readings(
        gyro=jnp.asarray(0.3 * rng.normal(size=3)),
        accelerometer=jnp.asarray([0.5, -0.3, 9.5]),
        joint_positions=qpos[7:] + 0.001 * rng.normal(size=16),
        joint_velocities=qvel[6:] + 0.05 * rng.normal(size=16),
        image_position=qpos[:3] + 0.004,
        image_yaw=jnp.asarray(0.01),
        image_age=jnp.asarray(0.0513),
        image_arrived=jnp.asarray(True),
    )


def start_state(rng):
    qpos = jnp.asarray(crouch(bruce()) + np.concatenate([np.zeros(7), 0.1 * rng.normal(size=16)]))
    qvel = jnp.asarray(0.2 * rng.normal(size=22))
    legs = jax.tree.map(jnp.asarray, load_leg_kinematics(bruce()))
    state = initial_estimate(legs, qpos, qvel)
    memory = state.memory + 0.01 * jnp.asarray(rng.normal(size=state.memory.shape))
    return legs, state._replace(contact_trust=jnp.asarray([0.4, 0.7]), memory=memory), some_readings(qpos, qvel, rng)


def outputs(state) -> jax.Array:
    """All that matters of a state in one vector of about unit scale."""
    qpos, qvel = estimated_qpos_qvel(state)
    std = jnp.sqrt(jnp.diagonal(state.covariance, axis1=1, axis2=2)).ravel()
    return jnp.concatenate(
        [qpos, qvel, 1000 * std, state.gyro_bias, state.accelerometer_bias[None], state.feet.ravel()]
    )


def test_step_with_respect_to_every_input(x64):
    rng = np.random.default_rng(0)
    legs, state, readings = start_state(rng)
    flags, arrived = state.health, readings.image_arrived
    flat_state, to_state = ravel_pytree(state._replace(health=(), covariance=()))
    std = jnp.sqrt(jnp.diagonal(state.covariance, axis1=1, axis2=2))
    scales = std[:, :, None] * std[:, None, :]
    flat_readings, to_readings = ravel_pytree(readings._replace(image_arrived=()))
    # Parameters by the logarithm: they span orders of magnitude.
    flat_parameters, to_parameters = ravel_pytree(jax.tree.map(lambda x: jnp.asarray(float(x)), EstimatorParameters()))
    flat_legs, to_legs = ravel_pytree(legs)

    @jax.jit
    def step(flat_state, correlations, flat_readings, contacts, log_parameters, flat_legs):
        return outputs(
            estimate_step(
                to_parameters(flat_parameters * jnp.exp(log_parameters)),
                to_legs(flat_legs),
                to_state(flat_state)._replace(health=flags, covariance=scales * correlations),
                to_readings(flat_readings)._replace(image_arrived=arrived),
                contacts,
            )
        )

    contacts = jnp.asarray([0.9, 0.3])  # one foot's trust is growing, the other's is given up
    correlations = jnp.tile(jnp.eye(7), (2, 1, 1)) + 0.1
    inputs = (contacts, jnp.zeros_like(flat_parameters), flat_legs)
    assert_gradients_agree(step, flat_state, correlations, flat_readings, *inputs, step=1e-6, tolerance=1e-5)
    # An outlier on every measurement: the weights are on their falling branch.
    far = flat_readings + 0.05 * jnp.asarray(rng.normal(size=flat_readings.shape))
    assert_gradients_agree(step, flat_state, correlations, far, *inputs, step=1e-6, tolerance=1e-5)


def test_sensors_and_filter_over_several_steps(x64):
    """The chain true state -> readings -> estimate, as in a closed loop; quantisation passes derivatives."""
    legs, state, _ = start_state(np.random.default_rng(1))
    noise = SensorNoise(encoder_step=0.0, image_rate=400.0, image_delay=0.005)
    qpos, qvel = estimated_qpos_qvel(state)
    sensors = initial_sensors(noise, jax.random.key(0), qpos)

    @jax.jit
    def run(joint_positions, qvel, force):
        def tick(carry, k):
            sensors, state = carry
            now = jnp.concatenate([qpos[:7], joint_positions + 0.002 * k * qvel[6:]])
            sensors, readings = simulate_sensors(noise, sensors, now, qvel, force)
            return (sensors, estimate_step(EstimatorParameters(), legs, state, readings, jnp.asarray([1.0, 0.0]))), None

        (_, end), _ = jax.lax.scan(tick, (sensors, state), jnp.arange(5.0))
        return outputs(end)

    assert_gradients_agree(run, qpos[7:], qvel, jnp.asarray([0.2, 0.1, 9.7]), step=1e-6, tolerance=1e-5)


def test_derivatives_go_straight_through_the_encoders_rounding(x64):
    """Oracle: central differences of the same readings without rounding; the encoders' steps by division."""
    _, state, _ = start_state(np.random.default_rng(3))
    qpos, qvel = estimated_qpos_qvel(state)
    coarse, fine = SensorNoise(encoder_step=0.001), SensorNoise(encoder_step=0.0)
    sensors = initial_sensors(coarse, jax.random.key(0), qpos)

    def positions(joints, noise):
        moved = jnp.concatenate([qpos[:7], joints])
        return simulate_sensors(noise, sensors, moved, qvel, jnp.asarray([0.0, 0.0, 9.8]))[1].joint_positions

    joints, direction = qpos[7:], jnp.linspace(-1.0, 1.0, 16)
    value, forward = jax.jvp(lambda q: positions(q, coarse), (joints,), (direction,))
    np.testing.assert_allclose(value / 0.001, np.round(value / 0.001), atol=1e-6)
    ahead, behind = (positions(joints + s * direction, fine) for s in (1e-6, -1e-6))
    np.testing.assert_allclose(forward, (ahead - behind) / 2e-6, atol=1e-8)
    reverse = jax.vjp(lambda q: positions(q, coarse), joints)[1](direction)[0]
    np.testing.assert_allclose(reverse @ direction, forward @ direction, rtol=1e-12)


def test_gradients_stay_finite_with_missing_readings(x64):
    legs, state, readings = start_state(np.random.default_rng(2))
    missing = jax.tree.map(lambda x: x if x.dtype == bool else jnp.full_like(x, jnp.nan), readings)

    def speed(velocity, gyro):
        now = state._replace(velocity=velocity)
        end = estimate_step(EstimatorParameters(), legs, now, missing._replace(gyro=gyro), jnp.ones(2))
        return jnp.sum(outputs(end))

    for gyro in (readings.gyro, missing.gyro):
        gradients = jax.jit(jax.grad(speed, argnums=(0, 1)))(state.velocity, gyro)
        assert all(np.isfinite(g).all() for g in gradients)

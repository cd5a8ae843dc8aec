"""Sensors and filter run over a motion, and the errors that come out."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from iwalker_jax.estimation import (
    EstimatorParameters,
    EstimatorState,
    Readings,
    SensorNoise,
    estimate_step,
    initial_estimate,
    initial_sensors,
    simulate_sensors,
)
from iwalker_jax.robot import load_leg_kinematics
from tests.estimation.motions import Motion, bruce

RUNS = 3
SETTLED = 100  # ticks


@partial(jax.jit, static_argnames="noise")
def _sense(noise: SensorNoise, keys, qpos, qvel, force) -> Readings:
    def one(key):
        start = initial_sensors(noise, key, qpos[0])
        return jax.lax.scan(lambda s, x: simulate_sensors(noise, s, *x), start, (qpos, qvel, force))[1]

    return jax.vmap(one)(keys)


@jax.jit
def _filter(parameters, legs, starts, readings, contacts) -> EstimatorState:
    def one(start, readings):
        def tick(state, x):
            state = estimate_step(parameters, legs, state, *x)
            return state, state

        return jax.lax.scan(tick, start, (readings, contacts))[1]

    return jax.vmap(one)(starts, readings)


def sense(motion: Motion, noise: SensorNoise, dtype=jnp.float32, runs: int = RUNS) -> Readings:
    """Readings of several runs over the same motion."""
    keys = jax.random.split(jax.random.key(0), runs)
    return _sense(noise, keys, *(jnp.asarray(a, dtype) for a in (motion.qpos, motion.qvel, motion.force)))


def estimate(
    motion: Motion, readings: Readings, qpos=None, parameters: EstimatorParameters = EstimatorParameters()
) -> EstimatorState:
    """Estimates (RUNS, ticks, ...) from the true start, or from another one; one program per motion length."""
    dtype = readings.gyro.dtype
    legs = jax.tree.map(lambda x: jnp.asarray(x, dtype), load_leg_kinematics(bruce()))
    parameters = jax.tree.map(lambda x: jnp.asarray(x, dtype), parameters)
    start = initial_estimate(
        legs, jnp.asarray(motion.qpos[0] if qpos is None else qpos, dtype), jnp.asarray(motion.qvel[0], dtype)
    )
    starts = jax.tree.map(lambda x: jnp.tile(x, (RUNS,) + (1,) * x.ndim), start)
    return jax.tree.map(np.asarray, _filter(parameters, legs, starts, readings, jnp.asarray(motion.contacts, dtype)))


def rms(error: np.ndarray) -> float:
    """Worst axis's root mean square over runs and ticks."""
    return float(np.sqrt((error**2).mean(axis=(0, 1))).max())


def velocity_error(estimates: EstimatorState, motion: Motion, since: int = SETTLED) -> np.ndarray:
    return (estimates.velocity - motion.qvel[:, :3])[:, since:]


def position_error(estimates: EstimatorState, motion: Motion, since: int = SETTLED) -> np.ndarray:
    return (estimates.position - motion.qpos[:, :3])[:, since:]


def rotation_error(quaternion: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(..., 3) small rotation [rad] in the world between estimated and true attitude."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    a, b, c, d = np.moveaxis(truth * [1, -1, -1, -1], -1, 0)
    real = w * a - x * b - y * c - z * d
    vector = np.stack(
        [w * b + x * a + y * d - z * c, w * c - x * d + y * a + z * b, w * d + x * c - y * b + z * a], axis=-1
    )
    return 2 * vector * np.sign(real)[..., None]


def is_finite(tree) -> bool:
    return all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(tree))

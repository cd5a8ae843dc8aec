"""From sensor readings to the robot's state: the Kalman filter, and simulated sensors to try it on."""

from iwalker_jax.estimation.estimator import estimate_step
from iwalker_jax.estimation.parameters import EstimatorParameters
from iwalker_jax.estimation.readings import Health, Readings
from iwalker_jax.estimation.sensors import (
    SensorNoise,
    SensorState,
    initial_sensors,
    simulate_sensors,
    specific_force,
)
from iwalker_jax.estimation.state import (
    BelievedErrors,
    EstimatorState,
    believed_errors,
    estimated_qpos_qvel,
    initial_estimate,
)

__all__ = [
    "BelievedErrors",
    "EstimatorParameters",
    "EstimatorState",
    "Health",
    "Readings",
    "SensorNoise",
    "SensorState",
    "believed_errors",
    "estimate_step",
    "estimated_qpos_qvel",
    "initial_estimate",
    "initial_sensors",
    "simulate_sensors",
    "specific_force",
]

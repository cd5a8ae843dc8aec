"""Whether the filter's errors on walks with contact physics are as large as it believes: normalised squared errors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.control import GaitMode, make_controller, make_plan, velocity_footsteps
from iwalker_jax.estimation import SensorNoise, believed_errors
from iwalker_jax.estimation.axis_filter import LEFT_FOOT, POSITION, RIGHT_FOOT, VELOCITY
from iwalker_jax.geometry import rotation_matrix
from iwalker_jax.robot import load_leg_kinematics, load_robot_model
from iwalker_jax.walking.rollout import Walker, start_walk, walk_tick
from iwalker_jax.walking.setup import Disturbances, sample_conditions

ROBOTS, TICKS, SETTLED = 16, 2500, 500
STATES = np.array([POSITION, VELOCITY, RIGHT_FOOT, LEFT_FOOT])


@pytest.fixture(scope="module")
def errors(bruce_mujoco):
    """Errors (robots, ticks, states, axes), their covariances, and tilt errors with the variance believed; the second
    half of the robots is pushed by 1 N s."""
    robot = load_robot_model(bruce_mujoco)
    walker = Walker(robot, make_controller(robot), load_leg_kinematics(bruce_mujoco), noise=SensorNoise.nominal())
    plan = make_plan(*velocity_footsteps(0.15, 0.0, 0.0, 60, 0.24, 0.1, 1), 1)
    conditions = sample_conditions(robot, Disturbances(push_impulse=1.0, push_after=2.0), ROBOTS, seed=5)
    conditions = conditions._replace(push_force=conditions.push_force.at[: ROBOTS // 2].set(0.0))

    def tick(conditions, state, _):
        qpos, qvel = state.physics.qpos, state.physics.qvel
        after, sample = walk_tick(walker, conditions, plan, state)
        estimate = after.memory.sensing.estimate
        feet = estimate.feet - (sample.feet - qpos[:3])
        difference = rotation_matrix(estimate.quaternion) @ rotation_matrix(qpos[3:7]).T
        tilt = jnp.stack([difference[2, 1] - difference[1, 2], difference[0, 2] - difference[2, 0]]) / 2
        error = jnp.concatenate([jnp.stack([estimate.position - qpos[:3], estimate.velocity - qvel[:3]]), feet])
        return after, (error, estimate.covariance, tilt, believed_errors(estimate).tilt, sample.mode, after.fallen)

    def run(conditions):
        start = start_walk(walker, conditions)
        return jax.lax.scan(lambda state, _: tick(conditions, state, None), start, None, length=TICKS)[1]

    error, covariance, tilt, believed, mode, fallen = jax.tree.map(np.asarray, jax.jit(jax.vmap(run))(conditions))
    assert not fallen.any() and (mode[:, -1] == GaitMode.WALK).all()
    covariance = covariance[..., STATES[:, None], STATES].astype(float)
    return error[:, SETTLED:], covariance[:, SETTLED:], tilt[:, SETTLED:], believed[:, SETTLED:]


@pytest.mark.parametrize("rows", [slice(0, ROBOTS // 2), slice(ROBOTS // 2, ROBOTS)], ids=["nominal", "pushed"])
def test_errors_are_as_large_as_believed(errors, rows):
    """Oracle: the expectation of chi-square, one a degree of freedom; within a factor of two."""
    error, covariance, tilt, believed = (values[rows] for values in errors)
    for axes, group in (([0, 1], 0), ([2], 1)):
        vectors = error[..., axes]
        squares = np.sum(vectors * np.linalg.solve(covariance[:, :, group], vectors), axis=-2)
        assert 0.5 <= squares.mean() / len(STATES) <= 2.0, axes
    assert 0.5 <= np.mean(tilt**2 / believed[..., None] ** 2) <= 2.0

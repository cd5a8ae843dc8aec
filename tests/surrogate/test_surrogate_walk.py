"""The surrogate walk, against geometry where nothing is drawn, and against its own spreads where it is."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from iwalker_jax.errors import InputError
from iwalker_jax.planning import MapViewParameters, MemoryIPath, MemoryIPathConfig, StepGeometry
from iwalker_jax.surrogate import SurrogateOutcome, SurrogateParameters, follow, see, start_surrogate, surrogate_step
from tests.surrogate.scenes import CALM, GRIDS, clearance_at, fields, scene_of, start

SMALL = MemoryIPathConfig(view=MapViewParameters(bearings=12, rings=4), hidden=16, judging=8)


def test_a_walk_begins_where_there_is_room_and_a_way():
    """Oracle: the scene's own distance, and the range of ways that is asked for."""
    for seed in range(10):
        state = start(seed)
        assert clearance_at(state) > CALM.start_clearance - GRIDS.resolution
        assert int(state.most_steps) > CALM.spare_steps + CALM.nearest_start / CALM.pace - 1


def test_a_calm_robot_follows_a_straight_path_step_by_step():
    """Oracle: a step's advance along the path, with the heading already on it."""
    state = start(0)
    ahead = jnp.stack([jnp.cos(state.true[2]), jnp.sin(state.true[2])])
    path = state.true[:2] + jnp.linspace(0.0, 1.6, 50)[:, None] * ahead
    moved = follow(CALM, state, path)
    np.testing.assert_allclose(moved.true[:2], state.true[:2] + CALM.steps.length * ahead, atol=1e-4)
    np.testing.assert_allclose(moved.believed, moved.true, atol=1e-5)
    assert int(moved.step) == 1


def test_a_path_behind_turns_the_robot_by_no_more_than_a_step_can():
    """Oracle: the pursuit's largest turn, on the spot."""
    state = start(1)
    behind = -jnp.stack([jnp.cos(state.true[2]), jnp.sin(state.true[2])])
    path = state.true[:2] + jnp.linspace(0.0, 1.6, 50)[:, None] * behind
    moved = follow(CALM, state, path)
    np.testing.assert_allclose(moved.true[:2], state.true[:2], atol=1e-5)
    np.testing.assert_allclose(abs(moved.true[2] - state.true[2]), CALM.pursuit.max_turn, atol=1e-5)


def test_steps_spread_as_the_parameters_say():
    """Oracle: the standard deviations asked for, over many draws (5 % at 1,000 draws is two standard errors)."""
    robot = SurrogateParameters()
    state = start(0)
    ahead = jnp.stack([jnp.cos(state.true[2]), jnp.sin(state.true[2])])
    path = state.true[:2] + jnp.linspace(0.0, 1.6, 50)[:, None] * ahead
    keys = jax.random.split(jax.random.key(0), 1000)
    many = jax.vmap(lambda key: follow(robot, state._replace(key=key), path))(keys)
    apart = np.asarray(many.true[:, :2] - state.true[:2])
    along, left = apart @ np.asarray(ahead), apart @ np.array([-ahead[1], ahead[0]])
    advance = robot.steps.length
    np.testing.assert_allclose(along.mean(), advance, atol=0.001)
    np.testing.assert_allclose(along.std(), np.hypot(robot.step_forward, robot.advance_share * advance), rtol=0.1)
    np.testing.assert_allclose(left.std(), robot.step_left, rtol=0.1)
    drift = np.linalg.norm(many.believed[:, :2] - many.true[:, :2], axis=1)
    np.testing.assert_allclose(np.sqrt(np.mean(drift**2)), robot.drift_share * advance, rtol=0.15)


def test_what_the_robot_sees_is_in_the_true_scene():
    """Oracle: the scene's own distance at the middle of every occupied cell."""
    from iwalker_jax.navigation.memory import map_cells
    from iwalker_jax.planning import MapCell
    from iwalker_jax.scenes import obstacle_distance

    for seed in range(4):
        state = jax.jit(lambda state: see(CALM, fields(), see(CALM, fields(), state)))(start(seed))
        occupied = np.argwhere(np.asarray(map_cells(CALM.memory, state.memory)) == MapCell.OCCUPIED)
        assert len(occupied) > 10
        places = (occupied + np.asarray(state.memory.middle) - CALM.memory.cells // 2 + 0.5) * CALM.memory.resolution
        distance = np.asarray(obstacle_distance(scene_of(state.scene), jnp.asarray(places, jnp.float32)))
        assert np.mean(distance < 1.5 * CALM.memory.resolution) > 0.97


def test_walls_end_a_walk_goals_too_and_so_does_time():
    """Oracle: the outcomes' definitions, for robots put where each must end."""
    network = MemoryIPath(SMALL, nnx.Rngs(0))
    step = jax.jit(lambda state: surrogate_step(CALM, GRIDS, network, fields(), state, jnp.asarray(0.0))[1])
    state = start(0)
    assert int(step(state)) == SurrogateOutcome.RUNNING
    assert int(step(state._replace(most_steps=jnp.asarray(1)))) == SurrogateOutcome.TIMED_OUT
    goal = jnp.append(fields().goals[state.scene, state.goal], 0.0)
    assert int(step(state._replace(true=goal, believed=goal))) == SurrogateOutcome.REACHED
    outside = jnp.append(fields().scenes.bounds[state.scene, :2] - 0.5, 0.0)
    assert int(step(state._replace(true=outside, believed=outside))) == SurrogateOutcome.COLLIDED


def test_where_no_start_fits_the_walk_ends_at_once():
    """Oracle: a clearance that no place has."""
    state = start_surrogate(dataclasses.replace(CALM, start_clearance=50.0), GRIDS, fields(), jax.random.key(0))
    assert int(state.most_steps) == 0


def test_parameters_that_cannot_be_are_refused():
    """Oracle: the stated ranges."""
    with pytest.raises(InputError, match="not negative"):
        SurrogateParameters(sway_yaw=-0.1)
    with pytest.raises(InputError, match="count 1"):
        SurrogateParameters(steps=StepGeometry(count=2))
    with pytest.raises(InputError, match="nearest_start"):
        SurrogateParameters(nearest_start=20.0)

"""The true fields of scenes, against the scenes' own distances and straight ways."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.perception import UNREACHABLE
from iwalker_jax.scenes import obstacle_distance
from iwalker_jax.surrogate import FieldParameters, make_fields, sample_fields, way_to_go
from tests.gradients import assert_gradients_agree
from tests.surrogate.scenes import GRIDS, fields, scene_of


def test_distances_are_those_of_the_scenes():
    """Oracle: `obstacle_distance` and the bounds at random points; a cell's diagonal apart at most."""
    rng = np.random.default_rng(0)
    for row in range(3):
        scene = scene_of(row)
        low, high = np.asarray(scene.bounds[:2]), np.asarray(scene.bounds[2:])
        points = jnp.asarray(rng.uniform(low + 0.1, high - 0.1, (200, 2)), jnp.float32)
        edge = jnp.minimum(points - low, high - points).min(axis=1)
        expected = jnp.minimum(obstacle_distance(scene, points), edge)
        measured = sample_fields(fields().clearance, jnp.asarray(row), points - low, GRIDS.resolution)
        # Inside an obstacle the scene's distance has kinks along the middle that a grid rounds off.
        np.testing.assert_allclose(measured, expected, atol=1.5 * GRIDS.resolution)


def test_a_way_costs_at_least_its_straight_line_and_nothing_at_the_goal():
    """Oracle: a metre costs at least 1; one in obstacles, contact and discomfort at most."""
    rng = np.random.default_rng(1)
    for row in range(3):
        for number in range(GRIDS.goals):
            corner = np.asarray(fields().scenes.bounds[row, :2])
            goal = np.asarray(fields().goals[row, number]) - corner
            extent = np.asarray(fields().scenes.bounds[row, 2:]) - corner
            points = jnp.asarray(rng.uniform(0, extent, (100, 2)), jnp.float32)
            args = (GRIDS, fields(), jnp.asarray(row), jnp.asarray(number))
            cost = np.asarray(way_to_go(*args, points))
            straight = np.linalg.norm(points - goal, axis=1)
            assert (cost >= straight - 0.2).all() and (cost < UNREACHABLE).all()
            assert way_to_go(*args, jnp.asarray(goal, jnp.float32)[None])[0] < 0.2


def test_samples_have_the_derivatives_of_differences():
    """Oracle: central differences of the bilinear sample, off the cells' borders."""
    with jax.enable_x64(True):
        field = jnp.asarray(np.random.default_rng(2).normal(size=(1, 8, 8)))
        points = jnp.asarray(np.random.default_rng(3).integers(1, 6, (5, 2)) + 0.75)
        assert_gradients_agree(lambda points: sample_fields(field, jnp.asarray(0), points, 1.0), points)


def test_the_same_seed_gives_the_same_scenes_and_another_others():
    """Oracle: the definition."""
    again = make_fields(3, 5, GRIDS)
    for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(fields()), strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(make_fields(1, 6, GRIDS).goals, fields().goals[:1])


def test_what_cannot_be_is_refused():
    """Oracle: the stated ranges."""
    with pytest.raises(InputError, match="at least one scene"):
        make_fields(0, 0)
    with pytest.raises(InputError, match="goals"):
        FieldParameters(goals=0)
    with pytest.raises(InputError, match="resolution"):
        FieldParameters(resolution=0.2)

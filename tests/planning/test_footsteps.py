"""Footstep geometry and robot state against hand-made cases and SciPy's integration of the pendulum."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iwalker_jax.geometry import footstep_signs
from iwalker_jax.optimization import HlipParameters
from iwalker_jax.planning.footsteps import closest_on_path, nominal_footsteps
from iwalker_jax.planning.robot_state import RobotState, StepGeometry, pre_impact_planes, sample_robot_state
from tests.gradients import assert_gradients_agree

GEOMETRY = StepGeometry()
STRAIGHT = jnp.stack([jnp.linspace(0.0, 4.0, 100), jnp.zeros(100)], axis=1)


def test_left_feet_stand_on_the_left():
    """With the left foot as stance foot the next footstep is a right one, at negative y."""
    sides = footstep_signs(jnp.asarray(1.0), 4)
    np.testing.assert_array_equal(sides, [-1, 1, -1, 1])
    footsteps, _ = nominal_footsteps(STRAIGHT, jnp.asarray(1.0), GEOMETRY)
    np.testing.assert_allclose(footsteps[:, 1], footstep_signs(jnp.asarray(1.0), GEOMETRY.count) * GEOMETRY.width / 2)
    np.testing.assert_allclose(footsteps[:, 0], GEOMETRY.length * np.arange(1, GEOMETRY.count + 1), atol=1e-5)


def test_short_paths_end_in_stepping_on_the_spot():
    footsteps, _ = nominal_footsteps(STRAIGHT * 0.1, jnp.asarray(-1.0), GEOMETRY)
    np.testing.assert_allclose(footsteps[5:, 0], 0.4, atol=1e-5)


def test_nominal_footsteps_turn_with_the_path():
    """Property: rotating the path rotates the footsteps."""
    angle = 0.7
    rotation = jnp.asarray([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    bend = jnp.stack([jnp.linspace(0, 3, 100), 0.2 * jnp.linspace(0, 3, 100) ** 2], axis=1)
    straight, _ = nominal_footsteps(bend, jnp.asarray(1.0), GEOMETRY)
    turned, _ = nominal_footsteps(bend @ rotation.T, jnp.asarray(1.0), GEOMETRY)
    np.testing.assert_allclose(turned, straight @ rotation.T, atol=1e-5)


def test_closest_point_on_a_straight_path():
    lateral, advance = closest_on_path(STRAIGHT, jnp.asarray([[1.013, 0.05], [2.0, -0.04]]))
    np.testing.assert_allclose(lateral, [0.05, -0.04], atol=1e-6)
    np.testing.assert_allclose(advance.along, [1.013, 2.0], atol=1e-5)
    assert float(advance.total) == pytest.approx(4.0, rel=1e-5)


def test_gradients_of_footstep_geometry_equal_finite_differences(x64):
    bend = jnp.stack([jnp.linspace(0, 3, 60), 0.2 * jnp.linspace(0, 3, 60) ** 2], axis=1)
    feet = jnp.asarray([[0.51, 0.09], [1.23, 0.2], [2.2, 1.1]])
    assert_gradients_agree(lambda p: nominal_footsteps(p, jnp.asarray(1.0), GEOMETRY)[0], bend)
    assert_gradients_agree(lambda p, f: closest_on_path(p, f)[0], bend, feet)
    assert_gradients_agree(lambda p, f: closest_on_path(p, f)[1].along, bend, feet)


def test_pre_impact_state_equals_the_integrated_pendulum(x64):
    """Oracle: SciPy integrates c'' = lambda^2 (c - foot) over the rest of the step."""
    hlip = HlipParameters()
    state = RobotState(jnp.asarray([0.02, -0.03]), jnp.asarray([0.2, 0.1]), jnp.asarray(1.0), jnp.asarray(0.1))
    planes = pre_impact_planes(state, hlip)
    square = hlip.gravity / hlip.com_height
    for axis in range(2):
        start = [float(state.com_from_stance[axis]), float(state.com_velocity[axis])]
        run = solve_ivp(lambda _, y: [y[1], square * y[0]], (0, 0.14), start, rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(planes[axis, 1:], run.y[:, -1], atol=1e-9)
        # The stance foot does not move: c - p stays where it was.
        assert float(planes[axis, 0] - planes[axis, 1]) == pytest.approx(-start[0], abs=1e-12)


def test_sampled_states_scatter_about_the_walking_orbit():
    """Property: an undisturbed lateral orbit ends each step with the COM half a width inside the stance foot."""
    hlip = HlipParameters()
    keys = jax.random.split(jax.random.key(0), 4000)
    states = jax.vmap(lambda key: sample_robot_state(key, GEOMETRY, hlip))(keys)
    planes = jax.vmap(lambda s: pre_impact_planes(s, hlip))(states)
    inward = -np.asarray(states.stance_sign) * np.asarray(planes[:, 1, 1])
    assert np.mean(inward) == pytest.approx(GEOMETRY.width / 2, abs=3e-3)
    assert abs(np.mean(np.asarray(states.stance_sign))) < 0.05
    assert np.std(inward) > 0.01


def test_mirroring_twice_is_the_identity():
    state = sample_robot_state(jax.random.key(3), GEOMETRY, HlipParameters())
    for before, after in zip(state, state.mirrored().mirrored()):
        np.testing.assert_array_equal(before, after)

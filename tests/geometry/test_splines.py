"""Splines and re-sampling against SciPy, closed forms and finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from iwalker_jax.geometry.splines import (
    arc_length,
    hermite_path,
    interpolate_along,
    path_tangents,
    resample_by_arc_length,
)
from tests.gradients import assert_gradients_agree


def test_hermite_path_equals_scipys_spline_with_finite_difference_tangents(x64):
    knots = np.random.default_rng(0).normal(size=(6, 2))
    tangents = np.gradient(knots, axis=0)
    expected = CubicHermiteSpline(np.arange(6), knots, tangents)(np.linspace(0, 5, 100))
    np.testing.assert_allclose(hermite_path(jnp.asarray(knots), 100), expected, atol=1e-12)


def test_hermite_path_passes_through_its_knots():
    knots = jnp.asarray(np.random.default_rng(1).normal(size=(6, 2)), jnp.float32)
    np.testing.assert_allclose(hermite_path(knots, 101)[::20], knots, atol=1e-5)


def test_arc_length_of_a_circle_approaches_its_circumference(x64):
    angle = jnp.linspace(0, 2 * jnp.pi, 2001)
    circle = 2.0 * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
    assert float(arc_length(circle)[-1]) == pytest.approx(4 * np.pi, rel=1e-5)


def test_resampling_spaces_points_evenly_and_keeps_the_ends():
    angle = jnp.asarray([0.0, 0.4, 1.0, 1.3, 2.0])
    knots = 2.0 * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
    path = hermite_path(knots, 400)
    even = resample_by_arc_length(path, 50)
    steps = np.linalg.norm(np.diff(even, axis=0), axis=1)
    assert steps.max() / steps.min() < 1.01
    np.testing.assert_allclose(even[0], path[0], atol=1e-6)
    np.testing.assert_allclose(even[-1], path[-1], atol=1e-5)


def test_interpolate_along_equals_scipys_hermite_spline(x64):
    """Oracle: SciPy's spline with slopes by finite differences, held constant beyond the ends."""
    lengths = np.sort(np.random.default_rng(2).uniform(0, 5, 20))
    values = np.random.default_rng(3).normal(size=(20, 2))
    rise = np.concatenate([values[1:2] - values[:1], values[2:] - values[:-2], values[-1:] - values[-2:-1]])
    run = np.concatenate([lengths[1:2] - lengths[:1], lengths[2:] - lengths[:-2], lengths[-1:] - lengths[-2:-1]])
    at = np.linspace(-1, 6, 57)
    expected = CubicHermiteSpline(lengths, values, rise / run[:, None])(np.clip(at, lengths[0], lengths[-1]))
    got = interpolate_along(jnp.asarray(lengths), jnp.asarray(values), jnp.asarray(at))
    np.testing.assert_allclose(got, expected, atol=1e-12)


def test_a_path_that_stands_still_has_finite_values_and_gradients():
    still = jnp.ones((20, 2))
    assert np.isfinite(resample_by_arc_length(still, 10)).all()
    np.testing.assert_allclose(path_tangents(still), np.tile([1.0, 0.0], (20, 1)))
    gradient = jax.grad(lambda p: jnp.sum(resample_by_arc_length(p, 10) ** 2) + jnp.sum(path_tangents(p)))(still)
    assert np.isfinite(gradient).all()


def test_gradients_of_resampling_and_tangents_equal_finite_differences(x64):
    knots = jnp.asarray(np.random.default_rng(4).normal(size=(5, 2)) + np.arange(5)[:, None])
    assert_gradients_agree(lambda k: resample_by_arc_length(hermite_path(k, 31), 17), knots)
    assert_gradients_agree(lambda k: path_tangents(hermite_path(k, 31)), knots)

"""Lengths and their gradients at and away from zero."""

import jax
import jax.numpy as jnp
import numpy as np

from iwalker_jax.geometry.norms import safe_norm, safe_sqrt
from tests.gradients import assert_gradients_agree


def test_a_length_is_zero_with_zero_gradient_at_the_origin():
    assert float(safe_norm(jnp.zeros(2))) == 0.0
    np.testing.assert_array_equal(jax.grad(safe_norm)(jnp.zeros(2)), np.zeros(2))
    assert float(jax.grad(safe_sqrt)(0.0)) == 0.0


def test_a_length_and_its_gradient_elsewhere(x64):
    """Oracles: numpy.linalg.norm and finite differences."""
    vectors = jnp.asarray(np.random.default_rng(0).normal(size=(5, 3)))
    np.testing.assert_allclose(safe_norm(vectors), np.linalg.norm(vectors, axis=-1), rtol=1e-14)
    assert_gradients_agree(safe_norm, vectors)

"""The encoding of the two feet, for whole numbers, NumPy and JAX arrays."""

import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.geometry.sides import Side, other_side, side_of_step, side_sign


@pytest.mark.parametrize("kind", [int, np.asarray, jnp.asarray])
def test_each_foot_has_a_number_a_sign_and_another(kind):
    right, left = kind(0), kind(1)
    assert (other_side(right), other_side(left)) == (Side.LEFT, Side.RIGHT)
    assert (side_sign(right), side_sign(left)) == (-1, 1)


@pytest.mark.parametrize("array", [np.asarray, jnp.asarray])
def test_footsteps_alternate(array):
    assert list(side_of_step(Side.LEFT, array(range(4)))) == [Side.LEFT, Side.RIGHT, Side.LEFT, Side.RIGHT]
    assert list(side_of_step(array(0), array(range(3)))) == [Side.RIGHT, Side.LEFT, Side.RIGHT]
    assert isinstance(side_of_step(array(0), array(range(3))), type(array(0)))

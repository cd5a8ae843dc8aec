"""What callers give for arrays: the same numbers whatever their form, or a sentence; oracle: NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.arrays import as_doubles, as_floats, as_numbers, is_known
from iwalker_jax.errors import InputError

FORMS = [[[1, 2], [3, 4]], ((1.0, 2.0), (3.0, 4.0)), *(np.array([[1, 2], [3, 4]], t) for t in ("f2", "f4", "f8", "i4"))]


@pytest.mark.parametrize("value", FORMS)
def test_numbers_keep_their_values(value):
    for make in (as_doubles, as_numbers, as_floats):
        np.testing.assert_array_equal(make(value, "a"), [[1, 2], [3, 4]])
    assert as_floats(value, "a").dtype == jnp.float32
    assert as_doubles(value, "a").dtype == np.float64


@pytest.mark.parametrize("value", [None, "text", b"bytes", {"a": 1}, object(), [[1, 2], [3]], 1j, np.array(["x"])])
def test_what_is_no_number_is_refused(value):
    for make in (as_doubles, as_numbers, as_floats):
        with pytest.raises(InputError, match=r"^a is .*; give real numbers"):
            make(value, "a")


def test_doubles_stay_doubles(x64):
    assert as_floats(np.ones(2), "a").dtype == jnp.float64
    assert as_floats([1, 2], "a").dtype == jnp.float64
    assert as_floats(np.ones(2, np.float32), "a").dtype == jnp.float32


def test_traced_values_pass_and_are_unknown():
    known = []
    jax.jit(lambda a: known.append(is_known(as_floats(a, "a"))))(jnp.ones(2))
    assert known == [False]
    assert is_known({"a": np.ones(2), "b": jnp.ones(3)}, 1.0)

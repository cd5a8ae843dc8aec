"""Arrays of real numbers from whatever callers give for them, or one sentence that says why there are none."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from iwalker_jax.errors import InputError


def as_doubles(value: Any, name: str) -> Float[np.ndarray, "*shape"]:
    """A new NumPy array in double precision, of an array, a list, or numbers of any kind.

    Raises:
        InputError: for what is no array of real numbers.
    """
    return np.array(_real(np.asarray, value, name), np.float64)


def as_numbers(value: Any, name: str) -> Shaped[Array, "*shape"]:
    """A JAX array of real numbers of their own type; tracers pass.

    Raises:
        InputError: for what is no array of real numbers.
    """
    return _real(jnp.asarray, value, name)


def as_floats(value: Any, name: str) -> Shaped[Array, "*shape"]:
    """`as_numbers` in floating point: whole numbers in JAX's default precision, half precision in single.

    Raises:
        InputError: for what is no array of real numbers.
    """
    array = as_numbers(value, name)
    if not jnp.issubdtype(array.dtype, jnp.floating):
        return array.astype(jnp.result_type(float))
    return array.astype(jnp.promote_types(array.dtype, jnp.float32))


def is_known(*values: Any) -> bool:
    """Whether all numbers can be looked at: not traced, as inside `jit` and `vmap`."""
    return not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(values))


def _real(convert: Callable[[Any], Any], value: Any, name: str) -> Any:
    """What a conversion to an array makes of a value, if that holds real numbers."""
    try:
        array = convert(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} is no array of numbers; give real numbers in rows of equal length.") from error
    kind = array.dtype
    if not (jnp.issubdtype(kind, jnp.floating) or jnp.issubdtype(kind, jnp.integer) or jnp.issubdtype(kind, jnp.bool_)):
        raise InputError(f"{name} is of type {kind}; give real numbers.")
    return array

"""JAX's usual promotion of shapes and types within the library, whatever users have set for programs of their own.

`JAX_NUMPY_RANK_PROMOTION=raise` and `JAX_NUMPY_DTYPE_PROMOTION=strict` help to find mistakes in the program that sets
them. What is not that program's own is traced under the settings it was written for.
"""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import jax

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def usual_promotion(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorate a function that is called, or traced, by programs with settings of their own."""

    @wraps(function)
    def call(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
            return function(*args, **kwargs)

    return call

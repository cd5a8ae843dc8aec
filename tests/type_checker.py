"""What checks the library's annotations when tests call it: beartype, for which NumPy's scalars are numbers too."""

from collections.abc import Callable
from typing import Any

import numpy as np
from beartype import BeartypeConf, FrozenDict, beartype

_NUMBERS = {bool: bool | np.bool_, int: int | np.integer, float: float | int | np.floating | np.integer}
_check = beartype(conf=BeartypeConf(hint_overrides=FrozenDict(_NUMBERS)))


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, checked; JAX rebuilds dataclasses around placeholders, so their `__init__` is left as it is."""
    return function if function.__name__ == "__init__" else _check(function)

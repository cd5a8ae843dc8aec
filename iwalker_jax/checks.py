"""What configuration dataclasses check and are made of."""

from collections.abc import Iterator
from dataclasses import fields
from types import UnionType
from typing import Any, Union, get_args, get_origin

import numpy as np

from iwalker_jax.errors import InputError

Scalar = Any
"""A Python float, or a traced () array when derivatives with respect to it are wanted."""

LARGEST_NUMBER = 1e9
"""Size of any setting; a larger one is a slip, or overflows further on."""

_WHOLE = (int, np.integer)
_NUMBERS = (*_WHOLE, float, np.floating)
_NO_NUMBERS = (str, bytes, complex, list, tuple, dict)


def require_range(record: Any, name: str, low: float, high: float, unit: str) -> None:
    """Raise InputError unless the plain number `record.name` lies in [low, high]; arrays and tracers pass."""
    value = getattr(record, name)
    outside = isinstance(value, _NUMBERS) and not low <= value <= high
    if outside or isinstance(value, _NO_NUMBERS):
        raise InputError(f"{type(record).__name__}.{name} is {_shown(value)} {unit}; give {low:g} to {high:g} {unit}.")


def require_numbers(record: Any) -> None:
    """Raise InputError unless all of a record that shall be numbers, seeds apart, are some, and whole ones where only
    these make sense; arrays and tracers pass.
    """
    for name, value, whole in _plain_values(record):
        if not isinstance(value, _WHOLE if whole else _NUMBERS):
            raise InputError(f"{name} is {_shown(value)}; give a {'whole ' if whole else ''}number.")


def require_plain_numbers(record: Any) -> None:
    """`require_numbers` that are finite and not absurdly large."""
    require_numbers(record)
    for name, value, _ in _plain_values(record):
        if not -LARGEST_NUMBER <= value <= LARGEST_NUMBER:
            raise InputError(f"{name} is {_shown(value):.24}; give a number of at most {LARGEST_NUMBER:g} in size.")


def _plain_values(record: Any) -> Iterator[tuple[str, Any, bool]]:
    """(name, value, whether it shall be a whole number) of a record's numbers that are no seeds and no arrays."""
    for field in fields(record):
        value = getattr(record, field.name)
        kinds = get_args(field.type) if get_origin(field.type) in (Union, UnionType) else (field.type,)
        left_out = value is None and type(None) in kinds
        is_array = hasattr(value, "dtype") and not isinstance(value, np.generic)
        if (int in kinds or float in kinds) and not left_out and not is_array and field.name != "seed":
            yield f"{type(record).__name__}.{field.name}", value, float not in kinds


def require_whole(value: Any, what: str) -> None:
    """Raise InputError unless a value is a whole number."""
    if not isinstance(value, _WHOLE):
        raise InputError(f"{what} is {_shown(value)}; give a whole number.")


def field_values(record: Any) -> tuple[Any, ...]:
    """Values of a dataclass's fields in their order."""
    return tuple(getattr(record, field.name) for field in fields(record))


def _shown(value: Any) -> str:
    """A value in a sentence."""
    try:
        return str(value) if isinstance(value, _NUMBERS) else f"{value!r:.60}"
    except ValueError:  # more digits than Python writes
        return "a number of thousands of digits"

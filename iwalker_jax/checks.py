"""What configuration dataclasses check and are made of."""

from dataclasses import fields
from typing import Any

from iwalker_jax.errors import InputError

Scalar = Any
"""A Python float, or a traced () array when derivatives with respect to it are wanted."""


def require_range(record: Any, name: str, low: float, high: float, unit: str) -> None:
    """Raise InputError unless the plain number `record.name` lies in [low, high]; arrays and tracers pass."""
    value = getattr(record, name)
    if isinstance(value, (int, float)) and not low <= value <= high:
        raise InputError(f"{type(record).__name__}.{name} is {value} {unit}; give {low:g} to {high:g} {unit}.")


LARGEST_NUMBER = 1e9
"""Size of any setting; a larger one is a slip, or overflows further on."""


def require_plain_numbers(record: Any) -> None:
    """Raise InputError unless all plain numbers of a record, seeds apart, are finite and not absurdly large."""
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or field.name == "seed":
            continue
        if not -LARGEST_NUMBER <= value <= LARGEST_NUMBER:
            name = f"{type(record).__name__}.{field.name}"
            raise InputError(f"{name} is {value!s:.24}; give a number of at most {LARGEST_NUMBER:g} in size.")


def field_values(record: Any) -> tuple[Any, ...]:
    """Values of a dataclass's fields in their order."""
    return tuple(getattr(record, field.name) for field in fields(record))

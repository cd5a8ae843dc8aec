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


def field_values(record: Any) -> tuple[Any, ...]:
    """Values of a dataclass's fields in their order."""
    return tuple(getattr(record, field.name) for field in fields(record))

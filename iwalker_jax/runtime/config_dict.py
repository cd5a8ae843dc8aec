"""Configuration dataclasses as plain dictionaries, the form in which runs, checkpoints and files keep them."""

import dataclasses
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from iwalker_jax.errors import InputError
from iwalker_jax.runtime.reading import printable


def config_to_dict(config: Any) -> dict[str, Any]:
    """Plain nested dictionary of a configuration dataclass, ready for JSON."""
    return dataclasses.asdict(config, dict_factory=lambda items: {k: _plain(v) for k, v in items})


def _plain(value: Any) -> Any:
    return str(value) if isinstance(value, Path) else value


def config_from_dict(kind: type, values: dict[str, Any]) -> Any:
    """The configuration dataclass that `config_to_dict` came from; fields that are left out keep their defaults.

    Raises:
        InputError: for unknown fields, as a configuration written by another version has, and values of another type,
            with the field's dotted name; and whatever the dataclass itself refuses.
    """
    return _dataclass_from(kind, values, "")


def _dataclass_from(kind: type, values: dict[str, Any], place: str) -> Any:
    hints = typing.get_type_hints(kind)
    known = {f.name for f in dataclasses.fields(kind)}
    unknown = set(values) - known
    if unknown:
        names = ", ".join(sorted(place + printable(name) for name in unknown))
        raise InputError(
            f"{kind.__name__} has no field {names}; it is misspelt, or the configuration was written by another "
            "version of iwalker_jax."
        )
    return kind(**{name: _value_from(hints[name], value, place + name) for name, value in values.items()})


def _value_from(hint: Any, value: Any, name: str) -> Any:
    """The value of a field of a type hint, from what JSON makes of it; InputError with the field's name."""
    choices = typing.get_args(hint)
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        if value is None and types.NoneType in choices:
            return None
        (hint,) = (choice for choice in choices if choice is not types.NoneType)
        choices = typing.get_args(hint)
    origin = typing.get_origin(hint)
    if dataclasses.is_dataclass(hint) and isinstance(value, dict):
        return _dataclass_from(typing.cast(type, hint), value, f"{name}.")
    if origin is tuple and isinstance(value, list | tuple):
        return tuple(_value_from(choices[0], entry, f"{name}[{k}]") for k, entry in enumerate(value))
    if origin is Mapping and isinstance(value, dict):
        return {key: _value_from(choices[1], entry, f"{name}.{key}") for key, entry in value.items()}
    if hint is Path and isinstance(value, str):
        return Path(value)
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        return value
    if (
        hint is Any
        or (origin is typing.Literal and value in choices)
        or (isinstance(hint, type) and type(value) is hint)
    ):
        return value
    raise InputError(f"{name} is {printable(repr(value))}; give {_wanted(hint)}.")


def _wanted(hint: Any) -> str:
    """What a field takes, in words."""
    if typing.get_origin(hint) is typing.Literal:
        return f"one of {', '.join(map(str, typing.get_args(hint)))}"
    if typing.get_origin(hint) is tuple:
        return "a list"
    if dataclasses.is_dataclass(hint) or typing.get_origin(hint) is Mapping:
        return "its fields by their names"
    words = {int: "a whole number", float: "a number", bool: "true or false", str: "a text", Path: "a path as a text"}
    return words[hint]

"""Configuration dataclasses as plain dictionaries, the form in which runs and checkpoints keep them."""

import dataclasses
import typing
from pathlib import Path
from typing import Any

from iwalker_jax.errors import InputError


def config_to_dict(config: Any) -> dict[str, Any]:
    """Plain nested dictionary of a configuration dataclass, ready for JSON."""
    return dataclasses.asdict(config, dict_factory=lambda items: {k: _plain(v) for k, v in items})


def _plain(value: Any) -> Any:
    return str(value) if isinstance(value, Path) else value


def config_from_dict(kind: type, values: dict[str, Any]) -> Any:
    """The configuration dataclass that `config_to_dict` came from.

    Raises:
        InputError: for unknown fields, as a configuration written by another version has.
    """
    hints = typing.get_type_hints(kind)
    known = {f.name for f in dataclasses.fields(kind)}
    unknown = set(values) - known
    if unknown:
        raise InputError(
            f"{kind.__name__} has no field {', '.join(sorted(unknown))}; the configuration was written by another "
            "version of iwalker_jax."
        )
    built = {}
    for name, value in values.items():
        hint = hints[name]
        if dataclasses.is_dataclass(hint) and isinstance(value, dict):
            built[name] = config_from_dict(typing.cast(type, hint), value)
        elif Path in typing.get_args(hint) and value is not None:
            built[name] = Path(value)
        else:
            built[name] = value
    return kind(**built)

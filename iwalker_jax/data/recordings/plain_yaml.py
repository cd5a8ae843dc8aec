"""YAML of plain values for files that others wrote: no references, no tags, no key twice, limited in size and depth.

Numbers are those of YAML 1.2, so that 1e-3 is a number and 0640 is 640.
"""

import re
from typing import Any

import yaml

from iwalker_jax.errors import InputError
from iwalker_jax.runtime import printable

MAX_BYTES = 2 * 1024 * 1024
_MAX_DEPTH = 8
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_SPECIAL = {".inf": "inf", "+.inf": "inf", "-.inf": "-inf", ".nan": "nan"}
_WORDS = {"": None, "~": None, "null": None, "true": True, "false": False}


def parse_plain_yaml(text: str) -> Any:
    """Dictionaries, lists, strings, numbers, booleans and None of one YAML document; None for an empty one.

    Raises:
        InputError: in words that follow the file's name.
    """
    try:
        return _document(text)
    except yaml.YAMLError as error:
        raise InputError(f"is not valid YAML: {printable(' '.join(str(error).split()), 200)}.") from None


def _document(text: str) -> Any:
    result: list[Any] = []
    open_values: list[Any] = [result]  # containers around the next value
    keys: list[Any] = [None]  # of the open mappings; `_NO_KEY` where a key is due
    documents = 0
    for event in yaml.parse(text, Loader=_LOADER):
        if isinstance(event, yaml.DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise InputError("holds several YAML documents; write one.")
        elif isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise InputError(f"has a YAML reference (& or *){_line(event)}; write the values out.")
        elif isinstance(event, yaml.CollectionEndEvent):
            open_values.pop()
            keys.pop()
        elif isinstance(event, yaml.NodeEvent):
            value = _value(event)
            keys[-1] = _put(open_values[-1], keys[-1], value, event)
            if isinstance(value, dict | list):
                if len(open_values) > _MAX_DEPTH:
                    raise InputError(f"is nested more than {_MAX_DEPTH} deep; write plain keys and rows.")
                open_values.append(value)
                keys.append(_NO_KEY)
    return result[0] if result else None


class _NoKey:
    """Where a mapping waits for its next key."""


_NO_KEY = _NoKey()


def _put(container: Any, key: Any, value: Any, event: Any) -> Any:
    """Put a value into a list, or into a mapping as a key or under one; returns the key that the next value is for."""
    if isinstance(container, list):
        container.append(value)
        return _NO_KEY
    if not isinstance(key, _NoKey):
        container[key] = value
        return _NO_KEY
    if isinstance(value, dict | list):
        raise InputError(f"has a key{_line(event)} that is not a word; write plain keys and rows.")
    if value in container:
        raise InputError(f"has the key {printable(value)} twice (again{_line(event)}); keep one.")
    return value


def _value(event: Any) -> Any:
    if isinstance(event, yaml.MappingStartEvent):
        value: Any = {}
    elif isinstance(event, yaml.SequenceStartEvent):
        value = []
    else:
        value = _scalar(event.value) if event.implicit[0] else event.value
    if event.tag is not None and event.tag != "!":
        raise InputError(f"has a YAML tag ({printable(event.tag)}){_line(event)}; leave it out.")
    return value


def _line(event: Any) -> str:
    return f" in line {event.start_mark.line + 1}"


def _scalar(text: str) -> Any:
    """A plain scalar by the core schema of YAML 1.2; a number too large for a float is infinite."""
    lower = text.lower()
    if lower in _WORDS:
        return _WORDS[lower]
    if lower in _SPECIAL:
        return float(_SPECIAL[lower])
    if _INTEGER.fullmatch(text) and len(text) < 18:
        return int(text)
    return float(text) if _FLOAT.fullmatch(text) else text

"""Files that hold the settings of a command: a run writes one, `--config` reads it, and options override it.

A file's names are those of the command's options; what it leaves out is as without it.
"""

import argparse
import json
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Any, TypeVar

import tyro

from iwalker_jax.errors import InputError
from iwalker_jax.runtime.config_dict import config_from_dict, config_to_dict
from iwalker_jax.runtime.files import write_json
from iwalker_jax.runtime.reading import printable, read_text

C = TypeVar("C")


def given_value(arguments: list[str], option: str) -> str | None:
    """The value of an option that decides what the other options start from; None if it is not given."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    # An option without its value is the command's own parser's to explain.
    parser.add_argument(option, dest="value", nargs="?")
    return parser.parse_known_args(arguments)[0].value


def parse_options(kind: type[C], arguments: list[str] | None) -> C:
    """A command's options: those given, before those of the file of `--config`, before its defaults.

    Raises:
        InputError: if that file cannot be used.
    """
    given = sys.argv[1:] if arguments is None else arguments
    file = given_value(given, "--config")
    if file is None:
        return tyro.cli(kind, args=given)
    return tyro.cli(kind, args=given, default=options_from(kind, Path(file), read_options(Path(file))))


def read_options(file: Path) -> dict[str, Any]:
    """The options in a file.

    Raises:
        InputError: if it cannot be read or holds something else.
    """
    try:
        values = json.loads(read_text(file))
    except InputError as error:
        raise InputError(f"{printable(file, 300)} {error}") from error
    except (ValueError, RecursionError):
        values = None
    if not isinstance(values, dict):
        raise InputError(f"{printable(file, 300)} holds no options; give a file that a run wrote, or one like it.")
    return values


def options_from(kind: type[C], file: Path, values: dict[str, Any]) -> C:
    """The command of the options that a file holds.

    Raises:
        InputError: if it has no such options, with the file's name and theirs.
    """
    try:
        return config_from_dict(kind, values)
    except InputError as error:
        raise InputError(f"{printable(file, 300)}: {error}") from error


def write_options(file: Path, command: Any, leave_out: Collection[str]) -> None:
    """Write a command's options for `--config`; OSError as `write_json`.

    Args:
        file: to write.
        command: dataclass of the options.
        leave_out: those that are no part of what is done, such as where it is kept.
    """
    write_json(file, {name: value for name, value in config_to_dict(command).items() if name not in leave_out})

"""Files of a recording's folder: images in the order in which they were taken, tables of numbers, names kept inside."""

import os
import re
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

from iwalker_jax.errors import InputError
from iwalker_jax.runtime import printable, read_text
from iwalker_jax.runtime.reading import MOST_TEXT

MAX_IMAGES = 20_000
"""Images of one recording: an hour at five a second."""

MAX_ROWS = 500_000

_DECIMAL = re.compile(r"(\d+(?:\.\d+)?)")
_INTEGER = re.compile(r"(\d+)")
_NUMBER = re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|nan|inf(?:inity)?)", re.ASCII | re.IGNORECASE)
_LONGEST_NUMBER = 64  # characters


def depth_images(folder: Path, suffix: str = ".png") -> tuple[list[Path], list[str]]:
    """(PNG files, or those of another ending, in natural order; what was assumed about their names).

    Numbers within names count as numbers: depth_2 comes before depth_10. Hidden files, such as the ._name.png that
    some systems leave beside each file, are no images.

    Raises:
        InputError: for a folder that cannot be listed, too many images, or two with the same number.
    """
    try:
        with os.scandir(folder) as entries:
            names = [e.name for e in entries if e.name.lower().endswith(suffix) and not e.name.startswith(".")]
    except FileNotFoundError:
        return [], []
    except (OSError, ValueError) as error:
        raise InputError(f"The folder {printable(folder.name)} cannot be listed ({error}).") from None
    if len(names) > MAX_IMAGES:
        raise InputError(f"It holds {len(names)} images; split recordings of more than {MAX_IMAGES}.")
    ordered = sorted(names, key=lambda name: _natural(name, _DECIMAL))
    for one, other in pairwise(ordered):
        if _natural(one, _DECIMAL) == _natural(other, _DECIMAL):
            raise InputError(
                f"The images {printable(one)} and {printable(other)} have the same number, so their order is unknown; "
                "rename one of them."
            )
    assumptions = []
    for first, second in zip(ordered, sorted(names, key=lambda name: _natural(name, _INTEGER))):
        if first != second:
            assumptions.append(
                f"Numbers in the images' names are read as decimals, so {printable(first)} comes before "
                f"{printable(second)}."
            )
            break
    return [folder / name for name in ordered], assumptions


def _natural(name: str, number: re.Pattern[str]) -> tuple[str | Decimal, ...]:
    """Texts and numbers of a name in turn, so that two names compare like by like."""
    stem, sign = Path(name).stem, ""
    if re.fullmatch(r"-\d+(\.\d+)?", stem):  # a number below zero, alone in the name
        stem, sign = stem[1:], "-"
    parts = number.split(stem.casefold())
    return tuple(Decimal(sign + part) if k % 2 else part for k, part in enumerate(parts))


def inside(folder: Path, name: object, what: str) -> Path:
    """A file or subfolder that a recording names; it must lie in the recording's folder.

    Raises:
        InputError: for what is not a name, and for names that lead out of the folder.
    """
    if not isinstance(name, str) or not name.strip() or "\0" in name or len(os.fsencode(name)) > 1000:
        raise InputError(f"{what} must be the name of a file in the recording's folder, got {printable(repr(name))}.")
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise InputError(
            f"{what} is {printable(repr(name))}, which leads out of the recording's folder; move the file into the "
            "folder and give its name."
        )
    return folder / name


def read_folder_text(folder: Path, name: str, most: int = MOST_TEXT) -> str:
    """A text file of the recording's folder; links must not lead out of it, for its lines may be shown.

    Raises:
        InputError: beginning with the file's name.
    """
    file = folder / name
    try:
        place, root = os.path.realpath(file), os.path.realpath(folder)
    except OSError as error:
        raise InputError(f"{printable(name)} cannot be read ({error.strerror}).") from None
    if os.path.commonpath([place, root]) != root:
        raise InputError(
            f"{printable(name)} is a link that leads out of the recording's folder; copy the file into it."
        )
    try:
        return read_text(file, most)
    except InputError as error:
        raise InputError(f"{printable(name)} {error}") from None


def is_there(file: Path) -> bool:
    """Whether anything has this name, a broken link or a pipe too: what is there is read or refused, never skipped."""
    try:
        return os.path.lexists(file)
    except (OSError, ValueError):
        return False


def read_numbers(folder: Path, name: str, columns: tuple[int, ...], what: str) -> list[list[float]]:
    """Rows of numbers of a text file; commas, brackets and comment lines (#) are ignored.

    Args:
        folder, name: of the text file.
        columns: allowed numbers a row.
        what: the content, for the error's sentence.

    Raises:
        InputError: if the file is missing, or a row is not made of that many numbers.
    """
    try:
        lines = read_folder_text(folder, name).splitlines()
    except InputError as error:
        raise InputError(f"{str(error)[:-1]}; it must hold the {what}.") from None
    rows = []
    for number, line in enumerate(lines, start=1):
        words = line.split("#")[0].translate(str.maketrans("[](),;", "      ")).split()
        if not words:
            continue
        if not all(len(word) <= _LONGEST_NUMBER and _NUMBER.fullmatch(word) for word in words):
            raise InputError(f"{name}, line {number}: {printable(repr(line[:60]))} is not made of numbers.")
        if len(words) not in columns:
            allowed = " or ".join(str(c) for c in columns)
            raise InputError(f"{name}, line {number}: {len(words)} numbers instead of {allowed} ({what}).")
        rows.append([float(word) for word in words])
        if len(rows) > MAX_ROWS:
            raise InputError(f"{name} has more than {MAX_ROWS} rows; split the recording.")
    return rows

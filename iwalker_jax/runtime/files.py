"""Files that are whole or not there, whatever stops the process that writes them, and that tell when they are damaged.

A disk can return other bits than it was given, and people edit files. What the product reads back it therefore writes
with a checksum, and refuses without one.
"""

import csv
import hashlib
import io
import json
import os
import tempfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from iwalker_jax.errors import InputError, MissingFileError
from iwalker_jax.runtime.locks import lock_file
from iwalker_jax.runtime.reading import printable, read_bytes

MOST_SAVED = 1 << 40
"""[bytes] of a file that the product wrote; what fits the memory decides earlier."""

CHECKSUM = "sha256"
"""Name of the array of an .npz file that holds the digest of the others."""


@contextmanager
def atomic_write(file: Path) -> Iterator[Path]:
    """A file beside the wanted one, with its ending, to write to; it takes that one's place at the end, else it goes.

    Folders are made as needed. What was written is on the disk before it gets its name, so that even a machine that
    loses its power keeps the old file or the new one.

    Raises:
        OSError: if the file cannot be written, with its name; one that was there before is kept.
    """
    part = part_of(file)
    file.parent.mkdir(parents=True, exist_ok=True)
    # A second process that writes the same file waits for the first.
    lock = lock_file(part, wait=True)
    try:
        yield part
        with part.open("rb+") as stream:
            os.fsync(stream.fileno())
        part.replace(file)
    except OSError as error:
        # Of a full disk the system does not say which file it is about, and of the part nobody has heard.
        if error.errno is not None and error.filename in (None, str(part), part):
            raise OSError(error.errno, os.strerror(error.errno), str(file)) from error
        raise
    finally:
        part.unlink(missing_ok=True)
        os.close(lock)


def part_of(file: Path) -> Path:
    """Where `atomic_write` keeps an incomplete file; a killed process leaves it, and the next writer clears it."""
    return file.with_name(f"{file.stem}.part{file.suffix}")


def write_bytes(file: Path, content: bytes) -> None:
    """Write bytes; OSError as `atomic_write`."""
    with atomic_write(file) as part:
        part.write_bytes(content)


def write_text(file: Path, text: str) -> None:
    """Write a text as UTF-8; OSError as `atomic_write`."""
    write_bytes(file, text.encode())


def write_json(file: Path, value: Any) -> None:
    """Write a value as indented JSON; OSError as `atomic_write`, TypeError for what JSON cannot hold."""
    write_text(file, json.dumps(value, indent=2) + "\n")


def write_csv(file: Path, rows: Iterable[Iterable[Any]]) -> None:
    """Write rows of cells as comma-separated values, numbers in full precision; OSError as `atomic_write`."""
    stream = io.StringIO(newline="")
    csv.writer(stream).writerows(rows)
    write_text(file, stream.getvalue())


def write_npz(file: Path, arrays: Mapping[str, ArrayLike]) -> None:
    """Write named arrays as a compressed .npz file, whatever its ending, with their digest under the name `CHECKSUM`.

    Raises:
        OSError: as `atomic_write`.
        ValueError: for arrays of Python objects.
    """
    plain = {name: np.asarray(array) for name, array in arrays.items()}
    plain[CHECKSUM] = np.asarray(digest(plain))
    # In memory first: a ZIP archive that its disk cuts short complains for as long as it lives.
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **plain)
    write_bytes(file, stream.getvalue())


def read_whole(file: Path) -> bytes:
    """Content of a regular file that the product wrote, however large.

    Raises:
        InputError: if it cannot be read, without a full stop; the caller adds what to do. A `MissingFileError` if there
            is no such file.
    """
    try:
        return read_bytes(file, MOST_SAVED)
    except MissingFileError as error:
        raise MissingFileError(f"No such file: {printable(file, 300)}") from error
    except InputError as error:
        raise InputError(f"{printable(file, 300)} cannot be read: it {str(error).rstrip('.')}") from error


def read_npz(file: Path, foreign: bool = False) -> dict[str, np.ndarray]:
    """The arrays of a file of `write_npz`.

    Args:
        file: to read.
        foreign: whether a file without a checksum, as NumPy itself writes it, will do.

    Raises:
        InputError: if the file is missing, damaged, altered, or has no checksum; the caller adds what to do.
    """
    content = read_whole(file)
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            size = sum(member.file_size for member in stored.zip.infolist())
            if size > _memory():
                raise MemoryError(f"unpacked it takes {size / 1e9:.0f} GB, more than this machine's memory")
            arrays = {name: stored[name] for name in stored.files}
    except Exception as error:  # zipfile, zlib, struct, tokenize and NumPy each have kinds of their own
        raise InputError(f"{file} is damaged, or no .npz file ({first_line(error)})") from error
    wanted = arrays.pop(CHECKSUM, None)
    if wanted is None and not foreign:
        raise InputError(f"{file} holds no checksum, so that nothing tells whether it is whole")
    if wanted is not None and str(wanted) != digest(arrays):
        raise InputError(f"{file} does not match its checksum: it is damaged or was altered")
    return arrays


def _memory() -> int:
    """[bytes] of this machine's memory."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def require_writable(wanted: Path, is_file: bool = False) -> None:
    """Refuse, before any work is done, a folder or a file that cannot be made or written to; nothing is made.

    Raises:
        InputError: with the reason.
    """
    place = wanted
    if is_file and not os.path.isdir(wanted):
        place = wanted.parent
    while not os.path.lexists(place) and place != place.parent:
        place = place.parent
    try:
        longest = os.pathconf(place, "PC_NAME_MAX")
        if "\0" in str(wanted) or any(len(os.fsencode(part)) > longest for part in wanted.parts):
            raise InputError(f"{printable(wanted, 300)} is no name for a folder or file; choose another one.")
        if is_file and place == wanted:
            raise InputError(f"{wanted} is a folder; give a file's name.")
        # A file without a name, which is the only sure sign that others will be let in.
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        reason = f"{place}: {error.strerror}" if place != wanted else error.strerror
        raise InputError(f"{wanted} cannot be written to ({reason}); choose another place.") from error


def read_csv_lines(content: bytes) -> list[list[str]]:
    """Cells of comma-separated values, a list a line; bytes that are no UTF-8 show as U+FFFD, as do NUL bytes.

    Every line is read by itself, so that a damaged quotation mark in one does not swallow those that follow.
    """
    text = content.decode("utf-8", errors="replace").replace("\0", "\ufffd")
    csv.field_size_limit(max(csv.field_size_limit(), len(text) + 1))
    return [_cells(line) for line in text.replace("\r\n", "\n").split("\n") if line]


def _cells(line: str) -> list[str]:
    try:
        return next(csv.reader([line]))
    except csv.Error:  # a carriage return within: one cell that fits no column
        return [line]


def line_checksum(cells: Iterable[str]) -> str:
    """CRC-32 of a line's cells as eight hexadecimal digits, for files that grow line by line; a single bit shows."""
    return f"{zlib.crc32(chr(0).join(cells).encode()):08x}"


def digest(arrays: Mapping[str, ArrayLike]) -> str:
    """SHA-256 of named arrays in their order: 64 hexadecimal digits that change with any name, type, shape or bit."""
    total = hashlib.sha256()
    for name, array in arrays.items():
        values = np.asarray(array)
        total.update(f"{name} {values.dtype} {values.shape}".encode())
        total.update(values.tobytes())
    return total.hexdigest()


def first_line(error: Exception) -> str:
    """Kind and first line of an error, for a sentence; libraries say the rest in many lines."""
    text = str(error).strip().splitlines()
    return f"{type(error).__name__}: {text[0][:160]}" if text else type(error).__name__

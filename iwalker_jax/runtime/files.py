"""Files that are whole or not there, whatever stops the process that writes them, and that tell when they are damaged.

A disk can return other bits than it was given, and people edit files. What the product reads back it therefore writes
with a checksum, and refuses without one.
"""

import csv
import hashlib
import io
import json
import os
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from iwalker_jax.errors import InputError
from iwalker_jax.runtime.locks import lock_file

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


def read_npz(file: Path, foreign: bool = False) -> dict[str, np.ndarray]:
    """The arrays of a file of `write_npz`.

    Args:
        file: to read.
        foreign: whether a file without a checksum, as NumPy itself writes it, will do.

    Raises:
        InputError: if the file is missing, damaged, altered, or has no checksum; the caller adds what to do.
    """
    try:
        content = file.read_bytes()
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror}") from error
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except Exception as error:  # zipfile, zlib, struct, tokenize and NumPy each have kinds of their own
        raise InputError(f"{file} is damaged, or no .npz file ({first_line(error)})") from error
    wanted = arrays.pop(CHECKSUM, None)
    if wanted is None and not foreign:
        raise InputError(f"{file} holds no checksum, so that nothing tells whether it is whole")
    if wanted is not None and str(wanted) != digest(arrays):
        raise InputError(f"{file} does not match its checksum: it is damaged or was altered")
    return arrays


def read_csv_lines(content: bytes) -> list[list[str]]:
    """Cells of comma-separated values, a list a line; bytes that are no UTF-8 show as U+FFFD, as do NUL bytes.

    Every line is read by itself, so that a damaged quotation mark in one does not swallow those that follow.
    """
    text = content.decode("utf-8", errors="replace").replace("\0", "\ufffd")
    csv.field_size_limit(max(csv.field_size_limit(), len(text) + 1))
    return [next(csv.reader([line])) for line in text.replace("\r\n", "\n").split("\n") if line]


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

"""Files that are whole or not there, whatever stops the process that writes them."""

import csv
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


@contextmanager
def atomic_write(file: Path) -> Iterator[Path]:
    """A file beside the wanted one, with its ending, to write to; it takes that one's place at the end, else it goes.

    Folders are made as needed. What was written is on the disk before it gets its name, so that even a machine that
    loses its power keeps the old file or the new one.

    Raises:
        OSError: if the file cannot be written; one that was there before is kept.
    """
    part = file.with_name(f"{file.stem}.part{file.suffix}")
    file.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield part
        with part.open("rb+") as stream:
            os.fsync(stream.fileno())
        part.replace(file)
    finally:
        part.unlink(missing_ok=True)


def write_text(file: Path, text: str) -> None:
    """Write a text as UTF-8; OSError as `atomic_write`."""
    with atomic_write(file) as part:
        part.write_text(text, encoding="utf-8")


def write_json(file: Path, value: Any) -> None:
    """Write a value as indented JSON; OSError as `atomic_write`, TypeError for what JSON cannot hold."""
    write_text(file, json.dumps(value, indent=2) + "\n")


def write_csv(file: Path, rows: Iterable[Iterable[Any]]) -> None:
    """Write rows of cells as comma-separated values, numbers in full precision; OSError as `atomic_write`."""
    with atomic_write(file) as part, part.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows(rows)


def write_npz(file: Path, arrays: Mapping[str, ArrayLike]) -> None:
    """Write named arrays as a compressed .npz file, whatever its ending; OSError as `atomic_write`."""
    plain = {name: np.asarray(array) for name, array in arrays.items()}
    with atomic_write(file) as part, part.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **plain)

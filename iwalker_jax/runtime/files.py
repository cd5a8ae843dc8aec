"""Files that are whole or not there, whatever stops the process that writes them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_write(file: Path) -> Iterator[Path]:
    """A file beside the wanted one, with its ending, to write to; it takes that one's place at the end, else it goes.

    Folders are made as needed.

    Raises:
        OSError: if the file cannot be written; one that was there before is kept.
    """
    part = file.with_name(f"{file.stem}.part{file.suffix}")
    file.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield part
        part.replace(file)
    finally:
        part.unlink(missing_ok=True)

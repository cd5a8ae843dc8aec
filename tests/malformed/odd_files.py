"""Places that are not what they are taken for: missing, of another kind, or no place at all."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.malformed.drafts import GOOD_IMAGES

Make = Callable[[Path], object]


def _written(content: bytes) -> Make:
    return lambda path: path.write_bytes(content)


def _pickled(path: Path) -> None:
    with path.open("wb") as stream:
        np.save(stream, np.array([{"a": 1}, None], object), allow_pickle=True)


MAKERS: dict[str, Make] = {
    "nothing": lambda path: None,
    "folder": lambda path: path.mkdir(),
    "pipe": os.mkfifo,
    "empty file": _written(b""),
    "text": _written(b"hello\n"),
    "picture": _written(GOOD_IMAGES[0]),
    "random bytes": _written(bytes(range(256)) * 4),
    "NUL bytes": _written(bytes(5000)),
    "pickle": _pickled,
    "link to itself": lambda path: path.symlink_to(path.name),
    "link to a device": lambda path: path.symlink_to("/dev/zero"),
}
"""What may lie where a file is expected."""


def odd_place(rng: np.random.Generator, folder: Path, suffix: str = "", file: bool = True) -> tuple[str, str]:
    """(what it is, path) of a place where no usable file of that ending lies; or, `file` False, no usable folder."""
    names = {"NUL in its name": f"{folder}/a\0b{suffix}", "long name": f"{folder}/{'x' * 300}{suffix}"}
    kinds = [*names, *(kind for kind in MAKERS if file or kind not in ("nothing", "folder"))]
    kind = str(rng.choice(kinds))
    if kind in names:
        return kind, names[kind]
    path = folder / f"odd{suffix}"
    MAKERS[kind](path)
    return kind, str(path)


def unwritable_folder(rng: np.random.Generator, folder: Path) -> tuple[str, str]:
    """(what it is, path) of a place that cannot be or become a folder, whoever asks."""
    kind = str(
        rng.choice(["file", "below a file", "NUL in its name", "long name", "pipe", "link to itself", "in /proc"])
    )
    taken = folder / "taken"
    if kind in ("file", "below a file"):
        taken.write_bytes(b"mine\n")
    elif kind == "pipe":
        os.mkfifo(taken)
    elif kind == "link to itself":
        taken.symlink_to(taken.name)
    paths = {
        "below a file": taken / "run",
        "NUL in its name": folder / "a\0b",
        "long name": folder / ("x" * 300),
        "in /proc": Path("/proc/nowhere/run"),
    }
    return kind, str(paths.get(kind, taken))

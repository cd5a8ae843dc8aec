"""What a run itself writes: metrics as JSON lines, and batches that broke a step."""

import errno
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from iwalker_jax.runtime.files import line_checksum, write_npz, write_text

_CHECKSUM = "checksum"


class MetricsFile:
    """Appends one JSON object a line to `metrics.jsonl`.

    Every line ends in a checksum. Opening the file for a run that resumes at `first_step` drops damaged lines and
    those from that step on, which the run writes again.
    """

    def __init__(self, folder: Path, first_step: int = 0, say: Callable[[str], None] = print) -> None:
        self.file = Path(folder) / "metrics.jsonl"
        self._say, self._failed = say, False
        kept = [line for line in read_metrics(self.file) if line["step"] < first_step]
        write_text(self.file, "".join(_line(line) for line in kept))
        self._stream = self.file.open("ab", buffering=0)

    def write(self, step: int, values: Mapping[str, float]) -> None:
        """Record the values of a step; a full disk costs the line, and is said once."""
        end = self._stream.seek(0, os.SEEK_END)
        line = _line({"step": step, **values}).encode()
        try:
            if self._stream.write(line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            self._stream.truncate(end)
            if not self._failed:
                self._say(f"{self.file} cannot be written ({error.strerror}): the metrics of some steps are lost.")
            self._failed = True

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


def read_metrics(file: Path) -> list[dict[str, Any]]:
    """The lines of a metrics file; a half-written one, as a killed process leaves, and damaged ones are left out."""
    if not file.exists():
        return []
    found = (_whole_line(text) for text in file.read_bytes().splitlines())
    return [line for line in found if line is not None]


def _line(values: dict[str, Any]) -> str:
    text = json.dumps(values)
    return json.dumps(values | {_CHECKSUM: line_checksum([text])}) + "\n"


def _whole_line(text: bytes) -> dict[str, Any] | None:
    """The values of a line; None if it is damaged."""
    try:
        values = json.loads(text)
        checksum = values.pop(_CHECKSUM)
    except (ValueError, AttributeError, TypeError, KeyError, RecursionError):
        return None
    return values if checksum == line_checksum([json.dumps(values)]) else None


def save_broken_batch(folder: Path, step: int, index: np.ndarray, values: dict[str, Any], state: Any) -> Path:
    """Keep what made a step's loss or gradient non-finite: frame indices, losses, random key and step."""
    file = Path(folder) / f"broken_batch_{step:06d}.npz"
    losses = json.dumps({name: float(value) for name, value in values.items()})
    write_npz(file, {"frame_index": index, "key": state.key, "step": step, "losses": np.array(losses)})
    return file

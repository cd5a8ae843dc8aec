"""The run's written record: metrics as JSON lines, optionally TensorBoard, and batches that broke a step."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from iwalker_jax.errors import InputError
from iwalker_jax.runtime.files import write_npz, write_text


class MetricsLog:
    """Appends one JSON object a line to `metrics.jsonl`, and to TensorBoard if asked.

    Opening it for a run that resumes at `first_step` drops the lines from that step on, which the run writes again.
    """

    def __init__(self, folder: Path, first_step: int = 0, tensorboard: bool = False):
        self.file = Path(folder) / "metrics.jsonl"
        kept = [line for line in read_metrics(self.file) if line["step"] < first_step]
        write_text(self.file, "".join(json.dumps(line) + "\n" for line in kept))
        self._stream = self.file.open("a", buffering=1)
        self._board = _tensorboard(folder) if tensorboard else None

    def write(self, step: int, values: dict[str, Any]) -> None:
        """Record the values of a step (numbers become floats)."""
        numbers = {name: float(value) for name, value in values.items()}
        self._stream.write(json.dumps({"step": step, **numbers}) + "\n")
        if self._board is not None:
            for name, value in numbers.items():
                self._board.add_scalar(name, value, step)

    def close(self) -> None:
        """Flush and close."""
        self._stream.close()
        if self._board is not None:
            self._board.close()


def read_metrics(file: Path) -> list[dict[str, Any]]:
    """The lines of a metrics file; a half-written last line, as a killed process leaves, is dropped."""
    if not file.exists():
        return []
    lines = []
    for text in file.read_text().splitlines():
        try:
            lines.append(json.loads(text))
        except json.JSONDecodeError:
            break
    return lines


def save_broken_batch(folder: Path, step: int, index: np.ndarray, values: dict[str, Any], state: Any) -> Path:
    """Keep what made a step's loss or gradient non-finite: frame indices, losses, random key and step."""
    file = Path(folder) / f"broken_batch_{step:06d}.npz"
    losses = json.dumps({name: float(value) for name, value in values.items()})
    write_npz(file, {"frame_index": index, "key": state.key, "step": step, "losses": np.array(losses)})
    return file


def _tensorboard(folder: Path) -> Any:
    try:
        from tensorboardX import SummaryWriter
    except ImportError as error:
        raise InputError(
            "TensorBoard output needs the package tensorboardx; run: pip install 'iwalker-jax[log]'."
        ) from error
    return SummaryWriter(str(Path(folder) / "tensorboard"))

"""Tables of walks: one row a case with the figures of all its robots, as text, Markdown and CSV."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.tables import Column, aligned_text, markdown_table
from iwalker_jax.evaluation.walks.metrics import WalkMetrics, speed_error
from iwalker_jax.runtime.files import atomic_write


class Labels(NamedTuple):
    """Which walks a row sums up: suite, case, engine and the seed of their conditions."""

    suite: str
    case: str
    engine: str
    seed: str


COLUMNS = (
    Column("robots", "number of walks", 0),
    Column("falls", "walks that ended in a fall", 0),
    Column("survived %", "the others", 1),
    Column("steps made %", "footsteps made of those planned, mean over the robots; - where none are planned", 1),
    Column("speed m/s", "achieved between the touchdowns of the steady part", 3),
    Column("speed error %", "mean size of its relative error; of the turn rate where the robot turns on the spot", 1),
    Column("footstep mean cm", "landed to planned foot, mean over all footsteps made", 2),
    Column("footstep max cm", "the largest of them", 2),
    Column("heading mean deg", "torso to the mean of the planned yaws of the feet on the ground", 2),
    Column("heading max deg", "the largest of them", 2),
    Column("COM mean cm", "COM to the middle of the planned feet at touchdowns", 2),
    Column("COM max cm", "the largest of them", 2),
    Column("torque peak %", "largest share of a motor's limit", 0),
    Column("QP failures", "ticks whose whole-body QP did not converge", 0),
    Column("velocity RMS cm/s", "error of the COM velocity that the controller believes", 2),
)
_HEADER = [*Labels._fields, *(column.title for column in COLUMNS)]


def summarise(metrics: Sequence[WalkMetrics]) -> dict[str, float]:
    """Figures of one case over its robots, by column title; NaN where a column does not apply."""
    falls = sum(m.fallen for m in metrics)
    steps = 100 * np.concatenate([m.footstep_errors for m in metrics])
    headings = np.degrees(np.concatenate([m.heading_errors for m in metrics]))
    coms = 100 * np.concatenate([m.com_errors for m in metrics])
    return {
        "robots": float(len(metrics)),
        "falls": float(falls),
        "survived %": 100.0 * (len(metrics) - falls) / len(metrics),
        "steps made %": _mean([100 * m.steps / m.planned for m in metrics if m.planned]),
        "speed m/s": _mean([m.speed for m in metrics if not m.on_the_spot]),
        "speed error %": _mean(np.abs([speed_error(m) for m in metrics])),
        "footstep mean cm": _mean(steps),
        "footstep max cm": _max(steps),
        "heading mean deg": _mean(headings),
        "heading max deg": _max(headings),
        "COM mean cm": _mean(coms),
        "COM max cm": _max(coms),
        "torque peak %": 100 * _max(np.concatenate([m.torque_shares for m in metrics])),
        "QP failures": float(sum(m.qp_failures for m in metrics)),
        "velocity RMS cm/s": 100 * _root_mean_square([m.velocity_rms for m in metrics]),
    }


def _finite(values: Sequence[float] | np.ndarray) -> np.ndarray:
    values = np.asarray(values, np.float64)
    return values[np.isfinite(values)]


def _mean(values: Sequence[float] | np.ndarray) -> float:
    usable = _finite(values)
    return float(usable.mean()) if len(usable) else float("nan")


def _root_mean_square(values: Sequence[float] | np.ndarray) -> float:
    return float(np.sqrt(_mean(np.square(values))))


def _max(values: Sequence[float] | np.ndarray) -> float:
    usable = _finite(values)
    return float(usable.max()) if len(usable) else float("nan")


@dataclass(frozen=True)
class WalkTable:
    """Rows of cases.

    Attributes:
        rows: labels and figures of each.
    """

    rows: tuple[tuple[Labels, dict[str, float]], ...]

    def holds(self, labels: Labels, robots: int) -> bool:
        """Whether there is a row of these walks by as many robots."""
        return any(own == labels and row["robots"] == robots for own, row in self.rows)

    def cells(self) -> list[list[str]]:
        """Formatted cells, header first."""
        lines = [list(_HEADER)]
        for labels, row in self.rows:
            lines.append([*labels, *(_cell(row[column.title], column.decimals) for column in COLUMNS)])
        return lines

    def text(self) -> str:
        """Aligned plain text."""
        return aligned_text(self.cells())

    def markdown(self) -> str:
        """A Markdown table."""
        return markdown_table(self.cells())

    def save(self, folder: Path, name: str) -> None:
        """Write name.txt, name.md and name.csv (full precision, which `load_table` reads)."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.txt").write_text(f"{self.text()}\n\n{legend()}\n")
        (folder / f"{name}.md").write_text(f"{self.markdown()}\n\n{legend()}\n")
        # Whole, so that it can be read again whenever the study was stopped.
        with atomic_write(folder / f"{name}.csv") as part, part.open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(_HEADER)
            for labels, row in self.rows:
                writer.writerow([*labels, *(row[column.title] for column in COLUMNS)])


def load_table(file: str | PathLike) -> WalkTable:
    """The table of a CSV file that `WalkTable.save` wrote; an empty one if there is no file.

    Raises:
        InputError: a file with other columns, or cells that are not numbers.
    """
    if not Path(file).exists():
        return WalkTable(())
    with Path(file).open(newline="") as stream:
        header, *lines = list(csv.reader(stream)) or [[]]
    try:
        if header != _HEADER:
            raise ValueError
        count = len(Labels._fields)
        rows = [(Labels(*line[:count]), [float(cell) for cell in line[count:]]) for line in lines]
        titles = [column.title for column in COLUMNS]
        return WalkTable(tuple((labels, dict(zip(titles, values, strict=True))) for labels, values in rows))
    except (TypeError, ValueError):
        raise InputError(
            f"{file} is not a table that this version writes; move it away or choose another folder."
        ) from None


def _cell(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if np.isfinite(value) else "-"


def legend() -> str:
    """What the columns mean, one a line."""
    return "\n".join(f"- {column.title}: {column.meaning}." for column in COLUMNS)

"""Tables of walks: one row a case with the figures of all its robots, as text, Markdown and CSV."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from iwalker_jax.errors import InputError, MissingFileError
from iwalker_jax.evaluation.tables import CHECKSUM_TITLE, Column, Table
from iwalker_jax.evaluation.walks.metrics import WalkMetrics, speed_error
from iwalker_jax.runtime.files import line_checksum, read_csv_lines, read_whole


class WalkLabels(NamedTuple):
    """Which walks a row sums up: suite, case, engine and the seed of their conditions."""

    suite: str
    case: str
    engine: str
    seed: str


WALK_COLUMNS = (
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
"""Columns of the table of walks, in order."""


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


EMPTY_WALK_TABLE = Table((), WalkLabels._fields, WALK_COLUMNS, sample=None)
"""The table of walks before any case is measured."""


def with_case(table: Table, labels: WalkLabels, values: dict[str, float]) -> Table:
    """A table of walks with one more case, whose figures are as from `summarise`."""
    return replace(table, rows=(*table.rows, (labels, (values,))))


def load_walk_table(file: Path) -> Table:
    """The table of a CSV file that a table of walks was saved to with checksums; `EMPTY_WALK_TABLE` if there is none.

    Raises:
        InputError: a file with other columns, or lines that are damaged or were edited.
    """
    try:
        content = read_whole(file)
    except MissingFileError:
        return EMPTY_WALK_TABLE
    except InputError as error:
        raise InputError(f"{error}; choose another folder.") from error
    header, *lines = read_csv_lines(content) or [[]]
    try:
        if header != [*EMPTY_WALK_TABLE.header(), CHECKSUM_TITLE]:
            raise ValueError
        count, titles = len(WalkLabels._fields), [column.title for column in WALK_COLUMNS]
        table = EMPTY_WALK_TABLE
        for *line, checksum in lines:
            if checksum != line_checksum(line):
                raise ValueError
            values = dict(zip(titles, map(float, line[count:]), strict=True))
            table = with_case(table, WalkLabels(*line[:count]), values)
        return table
    except (TypeError, ValueError):
        raise InputError(
            f"{file} is not a table that this version writes, or is damaged; move it away or choose another folder."
        ) from None


def has_case(table: Table, labels: WalkLabels, robots: int) -> bool:
    """Whether a table of walks has a row of these walks by as many robots."""
    return any(own == labels and values["robots"] == robots for own, (values,) in table.rows)

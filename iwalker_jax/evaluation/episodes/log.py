"""A file of finished episodes that grows line by line, so that a study can be stopped and gone on with."""

import csv
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes.metrics import EpisodeMetrics
from iwalker_jax.navigation import Outcome
from iwalker_jax.runtime.files import line_checksum, read_csv_lines, read_whole


class EpisodeKey(NamedTuple):
    """Which episode it is; equal keys are equal episodes.

    Attributes:
        planner: whose networks, with their fingerprint; depth, state: what camera and walking robot are given.
        seed: of the study; width: episodes of a whole batch, on which the conditions of each depend.
        policy: how it was navigated; episode_set: of which it is one; number: in the set.
    """

    planner: str
    depth: str
    state: str
    seed: int
    width: int
    policy: str
    episode_set: str
    number: int


_FIGURES = tuple(name for name in EpisodeMetrics._fields if name != "outcome")
_COLUMNS = (*EpisodeKey._fields, "task", "outcome", *_FIGURES)
_HEADER = (*_COLUMNS, "checksum")


def append_episodes(file: Path, rows: Sequence[tuple[EpisodeKey, str, EpisodeMetrics]]) -> None:
    """Append (key, name of the task, figures) to a CSV file, which is made if it is not there.

    Raises:
        InputError: a file that cannot be written.
    """
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("a", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            whole = len(_whole_lines(file))
            stream.truncate(whole)
            if whole == 0:
                writer.writerow(_HEADER)
            for key, task, metrics in rows:
                figures = (getattr(metrics, name) for name in _FIGURES)
                cells = [str(cell) for cell in (*key, task, metrics.outcome.name.lower(), *figures)]
                writer.writerow([*cells, line_checksum(cells)])
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise InputError(f"{file} cannot be written ({error.strerror}); choose another folder.") from error


def log_file(folder: Path, process: int) -> Path:
    """Where a process logs: each has a file of its own, because folders that machines share do not append safely."""
    return folder / ("episodes.csv" if process == 0 else f"episodes-{process}.csv")


def load_logs(folder: Path) -> dict[EpisodeKey, EpisodeMetrics]:
    """The episodes that any process logged in a folder.

    Raises:
        InputError: a file with other columns.
    """
    files = [log_file(folder, 0), *sorted(folder.glob("episodes-[0-9]*.csv"))]
    return {key: metrics for file in files for key, metrics in load_episodes(file).items()}


def load_episodes(file: Path) -> dict[EpisodeKey, EpisodeMetrics]:
    """The episodes of such a file; none if there is no file.

    A last line cut short by a crash and damaged or edited lines are passed over: a study runs their episodes again.

    Raises:
        InputError: a file with other columns.
    """
    if not file.exists():
        return {}
    # A number that is cut short is still a number: only the line's end tells that the line is whole.
    lines = read_csv_lines(_whole_lines(file))
    if not lines:
        return {}
    if tuple(lines[0]) != _HEADER:
        raise InputError(f"{file} has other columns than this version writes; move it away or choose another folder.")
    episodes = {}
    for line in lines[1:]:
        try:
            *cells, checksum = line
            row = dict(zip(_COLUMNS, cells, strict=True))
            if checksum != line_checksum(cells):
                continue
            given = (row["planner"], row["depth"], row["state"], int(row["seed"]), int(row["width"]))
            key = EpisodeKey(*given, row["policy"], row["episode_set"], int(row["number"]))
            outcome = Outcome[row["outcome"].upper()]
            episodes[key] = EpisodeMetrics(outcome, **{name: float(row[name]) for name in _FIGURES})
        except (ValueError, KeyError):
            continue
    return episodes


def _whole_lines(file: Path) -> bytes:
    """The file up to its last line's end."""
    content = read_whole(file)
    return content[: content.rfind(b"\n") + 1]

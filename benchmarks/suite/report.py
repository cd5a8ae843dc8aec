"""A run's report: machine, versions, date and the figures of every benchmark, in one JSON file."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.suite.figures import Result, from_json, to_json
from benchmarks.suite.machine import SHARED
from iwalker_jax.errors import InputError
from iwalker_jax.runtime.files import write_json
from iwalker_jax.runtime.reading import printable, read_text

VERSION = 1
"""Of the file's layout."""


@dataclass(frozen=True)
class Report:
    """What a run found.

    Attributes:
        command: that was run.
        date: of its beginning, UTC.
        size: `quick` or `full`.
        machine: of `machine.describe`.
        versions: of packages.
        load: average number of running processes in the minute before the run.
        results: by benchmark.
    """

    command: str
    date: str
    size: str
    machine: dict[str, Any]
    versions: dict[str, str]
    load: float
    results: dict[str, Result]

    def busiest(self) -> float:
        """Cores that others kept busy, on average, beside the benchmark that they disturbed most; 0 if not known."""
        return max((result.others or 0.0 for result in self.results.values()), default=0.0)

    def shared(self) -> bool:
        """Whether others used more of the machine, before or during the run, than figures of times bear."""
        return max(self.load, self.busiest()) > SHARED * int(self.machine["cores"])


def save(report: Report, file: Path) -> None:
    """Write a report; OSError as `write_json`."""
    head = {name: value for name, value in vars(report).items() if name != "results"}
    results = {name: to_json(result) for name, result in report.results.items()}
    write_json(file, {"layout": VERSION, **head, "results": results})


def load(file: Path) -> Report:
    """Read a report back.

    Raises:
        InputError: if it cannot be read, or holds something else.
    """
    name = printable(file, 300)
    try:
        value = json.loads(read_text(file))
    except InputError as error:
        raise InputError(f"{name} {error}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{name} is no JSON; give the report.json of a run of python -m benchmarks.") from error
    try:
        if value["layout"] != VERSION:
            raise InputError(f"is of layout {value['layout']!r}, not {VERSION}")
        results = {key: from_json(result) for key, result in value["results"].items()}
        report = Report(
            command=str(value["command"]),
            date=str(value["date"]),
            size=str(value["size"]),
            machine=dict(value["machine"]),
            versions=dict(value["versions"]),
            load=value["load"],
            results=results,
        )
        if not isinstance(report.machine["cores"], int) or not isinstance(report.load, (int, float)):
            raise InputError("has no number of cores or no load")
    except InputError as error:
        raise InputError(f"{name} {error}; give the report.json of a run of python -m benchmarks.") from error
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{name} is no report of a run; give the report.json of python -m benchmarks.") from error
    return report

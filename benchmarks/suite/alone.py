"""A benchmark as a command of its own: the options that all have, and how its figures are shown and written."""

import resource
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.suite.extras import missing_sentence
from benchmarks.suite.figures import Fact, Group, Result, to_json
from benchmarks.suite.tables import fact_table, group_table
from iwalker_jax.runtime.devices import machine
from iwalker_jax.runtime.files import write_json

_UNIT = 1 if sys.platform == "darwin" else 1024  # bytes of what the system counts the memory in


@dataclass(frozen=True)
class Options:
    """What every benchmark is told.

    Attributes:
        quick: fewer and smaller problems and fewer turns, for a look of a minute.
        json: file for the figures; none by default.
    """

    quick: bool = False
    json: Path | None = None


def present(figures: Iterable[Group | Fact], options: Options, missing: tuple[str, ...] = ()) -> None:
    """Print figures as they come, and write them if asked to: all so far after each, so that a stop loses only one.

    Args:
        figures: measured while they are iterated over.
        options: of the command.
        missing: packages of peers that are left out.
    """
    began = time.perf_counter()
    print(f"{machine()}; in turns, compilation apart: first call")
    if missing:
        print(missing_sentence(missing))
    groups: list[Group] = []
    facts: list[Fact] = []
    for figure in figures:
        if isinstance(figure, Fact):
            facts.append(figure)
        else:
            groups.append(figure)
            print(f"\n{figure.title}\n\n{group_table(figure)}", flush=True)
        if options.json is not None:
            memory = float(_UNIT * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
            result = Result(tuple(groups), tuple(facts), missing, time.perf_counter() - began, memory)
            write_json(options.json, to_json(result))
    if facts:
        print(f"\n{fact_table(facts)}")

"""Contenders that take turns, measured and judged: what a benchmark hands in, and the row that comes of it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import jax

from benchmarks.suite.figures import Group, Kind, Row, Work
from benchmarks.suite.timing import Times, in_turns


@dataclass(frozen=True)
class Contender:
    """One way of doing what a group does.

    Attributes:
        name: of the row.
        kind: ours, or a peer's.
        call: does it; whatever it returns is waited for.
        count: items that one call handles.
        judge: errors by name of what the first call returned.
        work: the least that an item needs.
        compiles: whether the first call compiles something.
    """

    name: str
    kind: Kind
    call: Callable[[], Any]
    count: int = 1
    judge: Callable[[Any], dict[str, float]] | None = None
    work: Work | None = None
    compiles: bool = True


def contest(title: str, item: str, contenders: Iterable[Contender], repeats: int) -> Group:
    """Let contenders take turns and judge what each returned first."""
    all_of_them = list(contenders)
    times = in_turns({each.name: each.call for each in all_of_them}, repeats)
    return Group(title, item, tuple(_row(each, times[each.name]) for each in all_of_them))


def _row(contender: Contender, times: Times) -> Row:
    errors = contender.judge(jax.device_get(times.result)) if contender.judge else {}
    turns = tuple(turn / contender.count for turn in times.turns)
    return Row(
        contender.name,
        contender.kind,
        turns,
        times.first if contender.compiles else None,
        contender.compiles and times.cached,
        {name: float(error) for name, error in errors.items()},
        contender.work,
    )

"""What changed between two reports, and what of it is within the noise of the turns."""

import math
import statistics
from typing import NamedTuple

from benchmarks.suite.figures import Group, Row, quartiles
from benchmarks.suite.report import Report
from benchmarks.suite.tables import duration, table

LEAST = 0.03
"""Relative change that is called none, however quiet the turns were."""


class Change(NamedTuple):
    """What became of one row of ours.

    Attributes:
        where: benchmark, group and row.
        before, now: medians [s an item].
        change: quotient of now over before, of the times relative to the peer's where both runs have the same peer, so
            that a faster machine is no change.
        noise: relative change that the turns of both runs leave open.
        by_peer: whether it is relative to a peer.
    """

    where: str
    before: float
    now: float
    change: float
    noise: float
    by_peer: bool

    def verdict(self) -> str:
        """In words."""
        if abs(math.log(self.change)) <= math.log1p(self.noise):
            return "within the noise"
        return "faster" if self.change < 1 else "slower"


def changes(before: Report, now: Report) -> list[Change]:
    """Of all rows of ours that both reports have."""
    found = []
    for name, result in now.results.items():
        earlier = {group.title: group for group in before.results[name].groups} if name in before.results else {}
        for group in result.groups:
            if group.title in earlier:
                found += _changes_of(name, earlier[group.title], group)
    return found


def _changes_of(name: str, before: Group, now: Group) -> list[Change]:
    rows = {row.name: row for row in before.rows}
    found = []
    for row in now.rows:
        if row.kind != "ours" or row.name not in rows:
            continue
        peer = now.fastest_peer()
        old_peer = rows.get(peer.name) if peer else None
        where = f"{name}, {now.title}: {row.name}"
        first, second = _relative(rows[row.name], old_peer), _relative(row, peer if old_peer else None)
        change, noise = statistics.median(second) / statistics.median(first), _openness(first) + _openness(second)
        found.append(Change(where, rows[row.name].median, row.median, change, max(noise, LEAST), old_peer is not None))
    return found


def _relative(row: Row, peer: Row | None) -> tuple[float, ...]:
    """Turns of a row, divided by the peer's of the same rounds if there is one."""
    if peer is None:
        return row.turns
    return tuple(a / b for a, b in zip(row.turns, peer.turns, strict=True))


def _openness(values: tuple[float, ...]) -> float:
    low, high = quartiles(values)
    return math.sqrt(high / low) - 1


def comparison_text(before: Report, now: Report) -> str:
    """A table of all changes, the largest first, and what is not in both."""
    found = sorted(changes(before, now), key=lambda each: -abs(math.log(each.change)))
    rows = [
        [
            each.where,
            duration(each.before),
            duration(each.now),
            f"{each.change:.2f}" + (" by the peer" if each.by_peer else ""),
            f"{each.noise:.0%}",
            each.verdict(),
        ]
        for each in found
    ]
    head = ["figure", f"{before.date}", f"{now.date}", "now / before", "noise", "verdict"]
    missing = sorted(set(before.results) ^ set(now.results))
    lines = [table(head, rows) if rows else "No figure is in both reports."]
    if before.machine != now.machine:
        lines.append("The machines differ; only changes by the peer say something.")
    if before.size != now.size:
        lines.append(f"One run was {before.size}, the other {now.size}: their problems differ in size.")
    if missing:
        lines.append(f"In one of the reports alone: {', '.join(missing)}.")
    return "\n\n".join(lines)

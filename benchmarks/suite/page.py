"""The page of a report, in Markdown: written from the JSON alone, so that the two cannot differ."""

import re
from collections.abc import Iterator

from benchmarks.floor import floor_of
from benchmarks.suite.extras import INSTALL
from benchmarks.suite.figures import Floor, Group, Result, Row
from benchmarks.suite.registry import ACCELERATOR, BENCHMARKS, FLOOR
from benchmarks.suite.report import Report
from benchmarks.suite.tables import duration, fact_table, group_table, ratio_cell, table

_WIDTH = 120

_LEGEND = """
Ours in bold. Best and median are of turns, the spread is the distance of their quartiles over the median. The ratio is
the fastest peer's time over ours, turn by turn, with its quartiles: above 1 ours is faster. Peers work in double
precision on one core unless a row says otherwise, ours in single precision. `x floor` is the median over the least time
that this machine's floor allows for the least that the task needs: each input read once, matrices factorised once,
recursions step by step. The first call compiles, or loads what was compiled before (cache). Errors are beside an exact
or interior-point reference; the columns say of what.
"""


def page(report: Report, pictures: dict[str, str]) -> str:
    """The whole page.

    Args:
        report: to show.
        pictures: file names by benchmark, as links from the page.
    """
    floor = floor_of(_floor_result(report))
    written = (
        f"Written by `{report.command}` on {report.date} UTC, from the figures beside it; not by hand. Absolute "
        "times are this machine's; ratios are of contenders that took turns in one process, so that what slowed one "
        "slowed all."
    )
    parts = ["# Performance", _wrapped(written), _machine(report), *_floor(report, floor), *_peers_ahead(report)]
    parts += ["## How to read the tables", _wrapped(_LEGEND)]
    for name, result in report.results.items():
        if name != FLOOR:
            parts += _section(name, result, floor, pictures.get(name))
    parts += ["## Memory and time of the benchmarks", _costs(report)]
    return "\n\n".join(parts) + "\n"


def _wrapped(text: str) -> str:
    """Lines of at most `_WIDTH` characters; code in back ticks stays whole."""
    lines, line = [], ""
    for word in re.findall(r"(?:[^\s`]*`[^`]*`)+\S*|\S+", text):
        if line and len(line) + 1 + len(word) > _WIDTH:
            lines.append(line)
            line = word
        else:
            line = f"{line} {word}".strip()
    return "\n".join([*lines, line])


def _machine(report: Report) -> str:
    machine = report.machine
    text = (
        f"{machine['processor']}, {machine['cores']} cores, {machine['memory']} GiB, {machine['system']}, Python "
        f"{machine['python']}; " + ", ".join(f"{name} {number}" for name, number in report.versions.items()) + ". "
        f"{report.size.capitalize()} size."
    )
    others = f"others kept up to {report.busiest():.1f} cores busy meanwhile"
    load = f"The load was {report.load:.1f} in the minute before; {others}."
    if report.shared():
        load = f"**The machine was shared with other work: read the ratios, not the times.** {load}"
    return _wrapped(f"{text} {load}")


def _floor_result(report: Report) -> Result:
    """The figures that hold the floor: the accelerator's own with its set, else the machine's."""
    return report.results.get(FLOOR) or report.results.get(ACCELERATOR) or Result()


def _floor(report: Report, floor: Floor | None) -> Iterator[str]:
    if floor is None:
        return
    yield "## The machine's floor"
    rows = [
        ["empty step of `jax.lax.scan`", duration(floor.step)],
        ["matrix product, single precision", f"{floor.flops / 1e9:.3g} GFLOP/s"],
        ["memory, sum of two arrays", f"{floor.bandwidth / 1e9:.3g} GB/s"],
    ]
    others = [row for group in _floor_result(report).groups for row in group.rows if "call" in row.name]
    yield table(["what", "best"], rows + [[row.name, duration(row.best)] for row in others])


def ahead(report: Report) -> list[tuple[str, Group, Row, Row]]:
    """(benchmark, group, row of ours, fastest peer) of all rows that a peer beats."""
    found = []
    for name, result in report.results.items():
        for group in result.groups:
            peer = group.fastest_peer()
            for row in group.rows:
                lead = group.lead(row)
                if peer is not None and lead is not None and lead.median < 1:
                    found.append((name, group, row, peer))
    return found


def _peers_ahead(report: Report) -> Iterator[str]:
    yield "## Where a peer is faster"
    rows = [
        [name, group.title, peer.name, duration(peer.median), row.name, duration(row.median), ratio_cell(group, row)]
        for name, group, row, peer in ahead(report)
    ]
    if rows:
        yield table(["benchmark", "task", "faster", "median", "than", "median", "ratio"], rows)
    else:
        yield "In this run the fastest peer is faster than none of our rows."


def _section(name: str, result: Result, floor: Floor | None, picture: str | None) -> Iterator[str]:
    benchmark = BENCHMARKS.get(name)
    yield f"## {name}"
    if benchmark is not None:
        yield _wrapped(f"{benchmark.line()} `python -m {benchmark.module}`")
    if result.failure:
        yield _wrapped(f"It failed: {result.failure}")
    if result.missing:
        yield _wrapped(f"Not installed, and left out: {', '.join(result.missing)}. To get them: `{INSTALL}`.")
    if picture:
        yield f"![{name}: medians of the contenders]({picture})"
    for group in result.groups:
        yield f"**{group.title}**"
        yield group_table(group, floor)
    if result.facts:
        yield fact_table(result.facts)


def _costs(report: Report) -> str:
    rows = []
    for name, result in report.results.items():
        others = "" if result.others is None else f"{result.others:.1f}"
        compiling = sum(row.first for group in result.groups for row in group.rows if row.first and not row.cached)
        rows.append(
            [name, f"{result.seconds:.0f} s", f"{compiling:.0f} s", f"{result.peak_memory / 2**20:.0f} MiB", others]
        )
    return table(["benchmark", "took", "of it first calls", "peak memory", "cores that others used"], rows)

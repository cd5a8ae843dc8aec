"""Figures as tables in Markdown, for the console and for the page."""

from collections.abc import Sequence

from benchmarks.suite.figures import Fact, Floor, Group, Row

_UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns"))


def duration(seconds: float) -> str:
    """Three figures with a unit: 17.3 us."""
    size, unit = next(((size, unit) for size, unit in _UNITS if seconds >= size), _UNITS[-1])
    return f"{seconds / size:.3g} {unit}" if seconds / size < 1000 else f"{seconds / size:.0f} {unit}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table whose columns also line up as plain text."""
    lines = [list(head), *(list(row) for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(head))]
    texts = ["| " + " | ".join(cell.ljust(width) for cell, width in zip(line, widths)) + " |" for line in lines]
    return "\n".join([texts[0], "| " + " | ".join("-" * width for width in widths) + " |", *texts[1:]])


def group_table(group: Group, floor: Floor | None = None) -> str:
    """Times, ratio to the fastest peer, compile time and errors of all rows, in their order."""
    errors = list(dict.fromkeys(name for row in group.rows for name in row.accuracy))
    peer = group.fastest_peer()
    against = [f"{peer.name} / this"] if peer else []
    worked = [row for row in group.rows if floor and row.work]
    head = ["", f"best, {group.item}", "median", "spread", *against, *["x floor"] * bool(worked), "first call", *errors]
    rows = []
    for row in group.rows:
        cells = [f"**{row.name}**" if row.kind == "ours" else row.name, duration(row.best), duration(row.median)]
        cells.append(f"{row.spread:.0%}")
        if peer:
            cells.append(ratio_cell(group, row))
        if worked:
            cells.append(_floor_cell(row, floor))
        cells.append("" if row.first is None else f"{row.first:.1f} s" + (" (cache)" if row.cached else ""))
        cells += [f"{row.accuracy[name]:.1e}" if name in row.accuracy else "" for name in errors]
        rows.append(cells)
    return table(head, rows)


def ratio_cell(group: Group, row: Row) -> str:
    """The fastest peer's time over a row's of ours, with its quartiles; nothing for peers."""
    lead = group.lead(row)
    return "" if lead is None else f"{lead.median:.2f} [{lead.low:.2f}, {lead.high:.2f}]"


def _floor_cell(row: Row, floor: Floor | None) -> str:
    if floor is None or row.work is None:
        return ""
    return f"{row.median / floor.seconds(row.work):.3g}"


def fact_table(facts: Sequence[Fact]) -> str:
    """Figures that are no times."""
    return table(["figure", "value"], [[fact.name, f"{fact.value:.4g} {fact.unit}".strip()] for fact in facts])

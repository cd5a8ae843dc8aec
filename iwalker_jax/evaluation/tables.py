"""Tables of results as text, Markdown and CSV, with mean and spread over seeds, frames or episodes."""

from collections.abc import Sequence as Rows
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iwalker_jax.evaluation.frames.sequences import SequenceResult
from iwalker_jax.evaluation.intervals import wilson_interval
from iwalker_jax.runtime.files import write_csv, write_text


@dataclass(frozen=True)
class Column:
    """A column: title, unit or meaning, and format of its numbers.

    The values of a rate are 0 or 100 %; their mean is shown with its 95 % interval instead of their deviation.
    """

    title: str
    meaning: str
    decimals: int = 2
    rate: bool = False


COLUMNS = (
    Column("feasibility", "1000 x MSE between path and unicycle optimum, lower is better", 3),
    Column("collision", "published map summed over the footsteps, lower is better", 3),
    Column("stability", "1000 x variance of the relative waypoint interval, lower is better", 3),
    Column("H-LIP cost", "cost of the step MPC that follows the footsteps, lower is better", 3),
    Column("steps hit %", "footsteps where the body's footprint touches the true scene", 2),
    Column("paths hit %", "paths on which the footprint touches the true scene anywhere", 1),
    Column("reach %", "goals in view that the path ends within 0.3 m of", 1),
    Column("progress %", "goals out of view towards which the path shortens the true route", 1),
    Column("served %", "both kinds of goals together", 1),
)


def result_row(result: SequenceResult) -> dict[str, float]:
    """Means over the frames of one sequence, by column title; NaN where a column does not apply."""
    row = {
        "feasibility": float(np.mean(result.plan.feasibility)),
        "collision": float(np.mean(result.plan.collision)),
        "stability": float(np.mean(result.plan.stability)),
        "H-LIP cost": float(np.mean(result.plan.hlip_cost)),
    }
    truth, view, served = result.truth, result.in_view, result.served
    if truth is None or view is None or served is None:
        return row | {column.title: float("nan") for column in COLUMNS if column.title not in row}
    return row | {
        "steps hit %": 100.0 * float(np.mean(truth.footsteps_in_collision)),
        "paths hit %": 100.0 * float(np.mean(truth.path_collides)),
        "reach %": _percent(served[view]),
        "progress %": _percent(served[~view]),
        "served %": _percent(served),
    }


def _percent(flags: np.ndarray) -> float:
    return 100.0 * float(np.mean(flags)) if len(flags) else float("nan")


@dataclass(frozen=True)
class Table:
    """Rows of (method, scene) with the values of every seed.

    Attributes:
        rows: (labels, one dictionary of column values a seed).
        labels: titles of the label columns.
        columns: of the values.
        each: what there is one dictionary of.
    """

    rows: tuple[tuple[tuple[str, ...], tuple[dict[str, float], ...]], ...]
    labels: tuple[str, ...] = ("scene",)
    columns: tuple[Column, ...] = COLUMNS
    each: str = "seed"

    def cells(self) -> list[list[str]]:
        """Formatted cells, header first; mean, and +- standard deviation where there are several seeds."""
        lines = [[*self.labels, *(column.title for column in self.columns)]]
        for labels, seeds in self.rows:
            lines.append([*labels, *(_cell([seed[c.title] for seed in seeds], c) for c in self.columns)])
        return lines

    def text(self) -> str:
        """Aligned plain text."""
        return aligned_text(self.cells())

    def markdown(self) -> str:
        """A Markdown table."""
        return markdown_table(self.cells())

    def save(self, folder: Path, name: str) -> None:
        """Write name.md and name.csv (one line a seed, full precision)."""
        write_text(folder / f"{name}.md", f"{self.markdown()}\n\n{legend(self.columns)}\n")
        lines = [
            [*labels, number, *(seed[column.title] for column in self.columns)]
            for labels, seeds in self.rows
            for number, seed in enumerate(seeds)
        ]
        write_csv(folder / f"{name}.csv", [[*self.labels, self.each, *(c.title for c in self.columns)], *lines])


def _cell(values: Rows[float], column: Column) -> str:
    usable = [value for value in values if np.isfinite(value)]
    if not usable:
        return "-"
    text = f"{np.mean(usable):.{column.decimals}f}"
    if column.rate:
        low, high = (100 * end for end in wilson_interval([value / 100 for value in usable]))
        return f"{text} [{low:.{column.decimals}f}, {high:.{column.decimals}f}]"
    return f"{text} +- {spread(usable):.{column.decimals}f}" if len(usable) > 1 else text


def spread(values: Rows[float] | np.ndarray) -> float:
    """Standard deviation of what the values are a sample of (n - 1 in the denominator); 0 for a single one."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else 0.0


def legend(columns: Rows[Column] = COLUMNS) -> str:
    """What the columns mean, one a line."""
    return "\n".join(f"- {column.title}: {column.meaning}." for column in columns)


def aligned_text(cells: list[list[str]]) -> str:
    """Lines of cells, header first, as plain text in right-aligned columns."""
    widths = [max(len(line[i]) for line in cells) for i in range(len(cells[0]))]
    return "\n".join("  ".join(value.rjust(width) for value, width in zip(line, widths)) for line in cells)


def markdown_table(cells: list[list[str]]) -> str:
    """Lines of cells, header first, as a Markdown table."""
    header, *body = cells
    lines = [header, ["---"] * len(header), *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)

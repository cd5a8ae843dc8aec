"""Tables of results as text, Markdown and CSV, with mean and spread over seeds or episodes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iwalker_jax.evaluation.intervals import wilson_interval
from iwalker_jax.runtime import write_csv, write_text
from iwalker_jax.runtime.files import line_checksum

CHECKSUM_TITLE = "checksum"
"""Of the column that tables have which are read back."""


@dataclass(frozen=True)
class Column:
    """A column: title, unit or meaning, and format of its numbers.

    The values of a rate are 0 or 100 %; their mean is shown with its 95 % interval instead of their deviation.
    """

    title: str
    meaning: str
    decimals: int = 2
    rate: bool = False


@dataclass(frozen=True)
class Table:
    """Labelled rows with the values of every sample: of every seed, say, or of every episode.

    Attributes:
        rows: (labels, one dictionary of values by column title a sample).
        labels: titles of the label columns.
        columns: of the values.
        sample: what there is one dictionary of; None where a row has one alone, whose number then is not written.
    """

    rows: tuple[tuple[tuple[str, ...], tuple[dict[str, float], ...]], ...]
    labels: tuple[str, ...]
    columns: tuple[Column, ...]
    sample: str | None = "seed"

    def cells(self) -> list[list[str]]:
        """Formatted cells, header first; mean, and +- standard deviation where there are several samples."""
        lines = [[*self.labels, *(column.title for column in self.columns)]]
        for labels, samples in self.rows:
            lines.append([*labels, *(_cell([values[c.title] for values in samples], c) for c in self.columns)])
        return lines

    def text(self) -> str:
        """Aligned plain text."""
        return aligned_text(self.cells())

    def markdown(self) -> str:
        """A Markdown table."""
        return markdown_table(self.cells())

    def legend(self) -> str:
        """What the columns mean, one a line."""
        return "\n".join(f"- {column.title}: {column.meaning}." for column in self.columns)

    def header(self) -> list[str]:
        """Titles of the columns of the CSV file."""
        numbered = [] if self.sample is None else [self.sample]
        return [*self.labels, *numbered, *(column.title for column in self.columns)]

    def save(self, folder: Path, name: str, checksums: bool = False) -> None:
        """Write name.txt, name.md and name.csv (one line a sample, full precision), each of them whole.

        Args:
            folder: to write to.
            name: of the files.
            checksums: whether every line of the CSV file ends in its checksum, for tables that are read back.

        Raises:
            OSError: if a file cannot be written.
        """
        write_text(folder / f"{name}.txt", f"{self.text()}\n\n{self.legend()}\n")
        write_text(folder / f"{name}.md", f"{self.markdown()}\n\n{self.legend()}\n")
        lines: list[list[object]] = [[*self.header()]]
        for labels, samples in self.rows:
            for number, values in enumerate(samples):
                numbered = [] if self.sample is None else [number]
                lines.append([*labels, *numbered, *(values[column.title] for column in self.columns)])
        if checksums:
            texts = [[str(cell) for cell in line] for line in lines]
            lines = [[*cells, line_checksum(cells) if i else CHECKSUM_TITLE] for i, cells in enumerate(texts)]
        write_csv(folder / f"{name}.csv", lines)


def _cell(values: Sequence[float], column: Column) -> str:
    usable = [value for value in values if np.isfinite(value)]
    if not usable:
        return "-"
    text = f"{np.mean(usable):.{column.decimals}f}"
    if column.rate:
        low, high = (100 * end for end in wilson_interval([value / 100 for value in usable]))
        return f"{text} [{low:.{column.decimals}f}, {high:.{column.decimals}f}]"
    return f"{text} +- {spread(usable):.{column.decimals}f}" if len(usable) > 1 else text


def spread(values: Sequence[float] | np.ndarray) -> float:
    """Standard deviation of what the values are a sample of (n - 1 in the denominator); 0 for a single one."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else 0.0


def aligned_text(cells: list[list[str]]) -> str:
    """Lines of cells, header first, as plain text in right-aligned columns."""
    widths = [max(len(line[i]) for line in cells) for i in range(len(cells[0]))]
    return "\n".join("  ".join(value.rjust(width) for value, width in zip(line, widths)) for line in cells)


def markdown_table(cells: list[list[str]]) -> str:
    """Lines of cells, header first, as a Markdown table."""
    header, *body = cells
    lines = [header, ["---"] * len(header), *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)

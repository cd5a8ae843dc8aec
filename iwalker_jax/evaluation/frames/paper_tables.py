"""Tables I to III of the iWalker paper from a study's results: a metric each, methods down, the four scenes across."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iwalker_jax.evaluation.frames.columns import FRAME_COLUMNS
from iwalker_jax.evaluation.tables import Table, aligned_text, markdown_table, spread
from iwalker_jax.runtime import write_csv, write_text
from iwalker_jax.scenes import SEQUENCE_NAMES

_DECIMALS = 3


@dataclass(frozen=True)
class PaperTable:
    """One of the paper's tables.

    Attributes:
        number: Roman.
        metric: title of the results' column that it shows; lower is better.
        published: the paper's own figures by method, in the order of `SEQUENCE_NAMES`: single runs, other scenes and
            another robot's camera, so their order counts and not their size.
    """

    number: str
    metric: str
    published: tuple[tuple[str, tuple[float, ...]], ...]


PAPER_TABLES = (
    PaperTable(
        "I",
        "feasibility",
        (
            ("iplanner", (1.484, 2.437, 1.286, 0.814)),
            ("finetuned", (3.575, 2.252, 5.292, 5.791)),
            ("iwalker", (1.432, 0.483, 0.468, 0.533)),
        ),
    ),
    PaperTable(
        "II",
        "collision",
        (
            ("iplanner", (11.97, 21.52, 4.470, 5.854)),
            ("finetuned", (12.43, 24.91, 3.894, 6.546)),
            ("iwalker", (10.17, 8.922, 3.132, 3.998)),
        ),
    ),
    PaperTable(
        "III",
        "stability",
        (
            ("iplanner", (89.8, 3.20, 19.1, 1.00)),
            ("finetuned", (71.6, 24.6, 33.3, 38.3)),
            ("iwalker", (31.0, 0.90, 3.32, 0.71)),
        ),
    ),
)


def scene_values(results: Table, metric: str) -> dict[str, dict[str, np.ndarray]]:
    """Each method's values of a metric, one a seed, in each of the paper's scenes: {method: {scene: (seeds,)}}.

    Args:
        results: rows labelled (method, scene).
        metric: title of a column.
    """
    values: dict[str, dict[str, np.ndarray]] = {}
    for (method, scene), seeds in results.rows:
        if scene in SEQUENCE_NAMES:
            values.setdefault(method, {})[scene] = np.array([seed[metric] for seed in seeds])
    return values


def printed_mean(seeds: np.ndarray) -> float:
    """Mean over the seeds as the tables print it, so that rounding errors decide nothing."""
    return round(float(np.mean(seeds)), _DECIMALS)


def best_methods(values: dict[str, dict[str, np.ndarray]], scene: str) -> set[str]:
    """The methods whose printed mean is the lowest in a scene: several where they tie."""
    means = {method: printed_mean(scenes[scene]) for method, scenes in values.items()}
    return {method for method, mean in means.items() if mean == min(means.values())}


def apart(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether two methods' seeds do not overlap: mean +- standard deviation of one lies outside the other's."""
    return bool(abs(np.mean(first) - np.mean(second)) > spread(first) + spread(second))


def paper_cells(results: Table, table: PaperTable, mark: str = "**") -> list[list[str]]:
    """Cells of one table, header first: mean +- deviation over the seeds, the best marked, the published below.

    Args:
        results: rows labelled (method, scene) with at least one seed each.
        table: which one.
        mark: put on both sides of the best.
    """
    values = scene_values(results, table.metric)
    scenes = [scene for scene in SEQUENCE_NAMES if all(scene in row for row in values.values())]
    lines = [["method", *scenes]]
    for method, row in values.items():
        cells = []
        for scene in scenes:
            text = f"{np.mean(row[scene]):.{_DECIMALS}f}"
            if len(row[scene]) > 1:
                text += f" +- {spread(row[scene]):.{_DECIMALS}f}"
            cells.append(f"{mark}{text}{mark}" if method in best_methods(values, scene) else text)
        lines.append([method, *cells])
    for method, numbers in table.published:
        shown = dict(zip(SEQUENCE_NAMES, numbers, strict=True))
        lines.append([f"published {method}", *(f"{shown[scene]:g}" for scene in scenes)])
    return lines


def verdict(results: Table, table: PaperTable, ours: str = "iwalker") -> str:
    """In one sentence: in how many scenes our method's printed mean is better than each other one's, in how many
    it ties, and, with several seeds, in how many the two do not overlap."""
    values = scene_values(results, table.metric)
    parts = []
    for method, row in values.items():
        if method == ours or ours not in values:
            continue
        scenes = [scene for scene in row if scene in values[ours]]
        gaps = {scene: printed_mean(row[scene]) - printed_mean(values[ours][scene]) for scene in scenes}
        better = [scene for scene, gap in gaps.items() if gap > 0]
        details = []
        if all(len(row[scene]) > 1 for scene in scenes):
            clear = [scene for scene in better if apart(values[ours][scene], row[scene])]
            details.append(f"{len(clear)} beyond both spreads")
        ties = sum(gap == 0 for gap in gaps.values())
        if ties:
            details.append(f"{ties} alike")
        more = f" ({', '.join(details)})" if details else ""
        parts.append(f"than {method} in {len(better)} of {len(scenes)} scenes{more}")
    return f"{ours} is better " + ", ".join(parts) + "." if parts else ""


def paper_text(results: Table, note: str = "") -> str:
    """All three tables as plain text, and a note below."""
    parts = [
        f"{_heading(table)}\n{aligned_text(paper_cells(results, table, mark='*'))}\n{verdict(results, table)}"
        for table in PAPER_TABLES
    ]
    return "\n\n".join([*parts, note] if note else parts)


def save_paper_tables(results: Table, folder: Path, note: str = "") -> None:
    """Write paper_tables.txt, .md and .csv (one line a table, method and scene; full precision).

    Args:
        results: rows labelled (method, scene) with at least one seed each.
        folder: created if need be.
        note: what a reader must know of the methods; below the tables in the first two files.
    """
    write_text(folder / "paper_tables.txt", paper_text(results, note) + "\n")
    parts = [
        f"### {_heading(table)}\n\n{markdown_table(paper_cells(results, table))}\n\n{verdict(results, table)}\n"
        for table in PAPER_TABLES
    ]
    write_text(folder / "paper_tables.md", "\n".join([*parts, note + "\n"] if note else parts))
    lines: list[list[object]] = [["table", "metric", "method", "scene", "mean", "deviation", "seeds"]]
    for table in PAPER_TABLES:
        for method, row in scene_values(results, table.metric).items():
            for scene, seeds in row.items():
                lines.append(
                    [table.number, table.metric, method, scene, float(np.mean(seeds)), spread(seeds), len(seeds)]
                )
    write_csv(folder / "paper_tables.csv", lines)


def _heading(table: PaperTable) -> str:
    meaning = next(column.meaning for column in FRAME_COLUMNS if column.title == table.metric)
    return f"Table {table.number}: {table.metric} ({meaning})"

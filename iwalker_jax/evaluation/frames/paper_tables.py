"""Tables I to III of the iWalker paper from a study's results: a metric each, methods down, the four scenes across."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iwalker_jax.evaluation.frames.columns import FRAME_COLUMNS
from iwalker_jax.evaluation.frames.metrics import GOAL_TOLERANCE
from iwalker_jax.evaluation.frames.reference_plans import REFERENCE_NAMES
from iwalker_jax.evaluation.intervals import paired_interval
from iwalker_jax.evaluation.tables import Table, aligned_text, markdown_table, spread
from iwalker_jax.runtime import write_csv, write_text
from iwalker_jax.scenes import SEQUENCE_NAMES

_DECIMALS = 3
_MARK = "(by construction)"


@dataclass(frozen=True)
class PaperTable:
    """One of the paper's tables.

    Attributes:
        number: Roman.
        metric: title of the results' column that it shows; lower is better.
        published: the paper's own figures by method, in the order of `SEQUENCE_NAMES`: single runs, other scenes and
            another robot's camera, so their order counts and not their size; nothing is charged in them.
        of_spacing: whether waypoints that are evenly spaced by construction have won it before it is measured.
    """

    number: str
    metric: str
    published: tuple[tuple[str, tuple[float, ...]], ...] = ()
    of_spacing: bool = False


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
    PaperTable("I, the steps' share", "H-LIP cost"),
    PaperTable("II", "collision"),
    PaperTable(
        "II in the published sampling",
        "collision 1 cm",
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
        of_spacing=True,
    ),
)
"""Tables I to III of the paper: titles, rows and metrics."""


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


def best_methods(values: dict[str, dict[str, np.ndarray]], scene: str, apart: Collection[str] = ()) -> set[str]:
    """The methods whose printed mean is the lowest in a scene: several where they tie; those set apart do not count."""
    means = {method: printed_mean(scenes[scene]) for method, scenes in values.items() if method not in apart}
    return {method for method, mean in means.items() if mean == min(means.values())}


def paper_cells(results: Table, table: PaperTable, even: Collection[str] = (), mark: str = "**") -> list[list[str]]:
    """Cells of one table, header first: mean +- deviation over the seeds, the best marked.

    Args:
        results: rows labelled (method, scene) with at least one seed each.
        table: which one.
        even: methods whose waypoints are evenly spaced by construction: marked in a table of spacing, and best of none.
        mark: put on both sides of the best.
    """
    values = scene_values(results, table.metric)
    scenes = _shared_scenes(values)
    apart = set(even) if table.of_spacing else set()
    lines = [["method", *scenes]]
    for method, row in values.items():
        cells = []
        for scene in scenes:
            text = _mean(row[scene])
            cells.append(f"{mark}{text}{mark}" if method in best_methods(values, scene, apart) else text)
        lines.append([f"{method} {_MARK}" if method in apart else method, *cells])
    return lines


def difference_cells(results: Table, table: PaperTable, ours: str = "iwalker") -> list[list[str]]:
    """Every other method's mean minus ours and its paired 95 % interval over the seeds; empty without two seeds."""
    values = scene_values(results, table.metric)
    scenes = _shared_scenes(values)
    if ours not in values or any(len(seeds) < 2 for row in values.values() for seeds in row.values()):
        return []
    lines = [[f"minus {ours}", *scenes]]
    for method, row in values.items():
        if method == ours:
            continue
        cells = []
        for scene in scenes:
            low, high = paired_interval(row[scene], values[ours][scene])
            middle = np.mean(row[scene]) - np.mean(values[ours][scene])
            cells.append(f"{middle:+.{_DECIMALS}f} [{low:+.{_DECIMALS}f}, {high:+.{_DECIMALS}f}]")
        lines.append([method, *cells])
    return lines


def published_cells(results: Table, table: PaperTable) -> list[list[str]]:
    """The trained methods' means with nothing charged, as the paper measures, above the paper's own figures."""
    values = scene_values(results, f"uncharged {table.metric}")
    scenes = _shared_scenes(values)
    lines = [["method", *scenes]]
    lines += [
        [method, *(_mean(row[scene]) for scene in scenes)]
        for method, row in values.items()
        if method not in REFERENCE_NAMES
    ]
    for method, numbers in table.published:
        shown = dict(zip(SEQUENCE_NAMES, numbers, strict=True))
        lines.append([f"published {method}", *(f"{shown[scene]:g}" for scene in scenes)])
    return lines


def verdict(results: Table, table: PaperTable, ours: str = "iwalker") -> str:
    """In one sentence: in how many scenes our method's printed mean is better than each other one's, in how many
    it ties, and, with several seeds, in how many the paired 95 % interval of the difference lies beyond zero."""
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
            clear = [scene for scene in better if paired_interval(row[scene], values[ours][scene])[0] > 0]
            details.append(f"{len(clear)} beyond the paired interval")
        ties = sum(gap == 0 for gap in gaps.values())
        if ties:
            details.append(f"{ties} alike")
        more = f" ({', '.join(details)})" if details else ""
        parts.append(f"than {method} in {len(better)} of {len(scenes)} scenes{more}")
    return f"{ours} is better " + ", ".join(parts) + "." if parts else ""


def paper_text(results: Table, note: str = "", even: Collection[str] = ()) -> str:
    """All tables as plain text, and a note below."""
    parts = []
    for table in PAPER_TABLES:
        blocks = [f"{title}\n{aligned_text(cells)}" for title, cells in _blocks(results, table, even, mark="*")]
        parts.append("\n\n".join(blocks) + f"\n{verdict(results, table)}")
    return "\n\n".join([*parts, note] if note else parts)


def save_paper_tables(results: Table, folder: Path, note: str = "", even: Collection[str] = ()) -> None:
    """Write paper_tables.txt, .md and .csv (one line a table, method and scene; full precision).

    Args:
        results: rows labelled (method, scene) with at least one seed each.
        folder: created if need be.
        note: what a reader must know of the methods; below the tables in the first two files.
        even: methods whose waypoints are evenly spaced by construction.
    """
    write_text(folder / "paper_tables.txt", paper_text(results, note, even) + "\n")
    parts = []
    for table in PAPER_TABLES:
        (heading, cells), *further = _blocks(results, table, even)
        blocks = [f"### {heading}\n\n{markdown_table(cells)}"]
        blocks += [f"{title}:\n\n{markdown_table(table_cells)}" for title, table_cells in further]
        parts.append("\n\n".join(blocks) + f"\n\n{verdict(results, table)}\n")
    write_text(folder / "paper_tables.md", "\n".join([*parts, note + "\n"] if note else parts))
    lines: list[list[object]] = [["table", "metric", "method", "scene", "mean", "deviation", "uncharged", "seeds"]]
    for table in PAPER_TABLES:
        uncharged = scene_values(results, f"uncharged {table.metric}")
        for method, row in scene_values(results, table.metric).items():
            for scene, seeds in row.items():
                means = float(np.mean(seeds)), spread(seeds), float(np.mean(uncharged[method][scene]))
                lines.append([table.number, table.metric, method, scene, *means, len(seeds)])
    write_csv(folder / "paper_tables.csv", lines)


def _shared_scenes(values: dict[str, dict[str, np.ndarray]]) -> list[str]:
    return [scene for scene in SEQUENCE_NAMES if all(scene in row for row in values.values())]


def _mean(seeds: np.ndarray) -> str:
    text = f"{np.mean(seeds):.{_DECIMALS}f}"
    return f"{text} +- {spread(seeds):.{_DECIMALS}f}" if len(seeds) > 1 else text


def _blocks(
    results: Table, table: PaperTable, even: Collection[str], mark: str = "**"
) -> list[tuple[str, list[list[str]]]]:
    """Titles and cells: the means; their differences with intervals; and the paper's own figures, if it has any."""
    blocks = [(_heading(results, table), paper_cells(results, table, even, mark))]
    differences = difference_cells(results, table)
    if differences:
        blocks.append(("Differences, with the paired 95 % interval over the seeds", differences))
    if table.published:
        title = "As published, nothing charged (a robot that stands still would win, so nothing is marked)"
        blocks.append((title, published_cells(results, table)))
    return blocks


def _heading(results: Table, table: PaperTable) -> str:
    meaning = next(column.meaning for column in FRAME_COLUMNS if column.title == table.metric)
    counts = sorted({len(samples) for _, samples in results.rows})
    seeds = f"{counts[0]} seeds" if counts[0] == counts[-1] else f"{counts[0]} to {counts[-1]} seeds"
    frames = sorted(
        {int(sample["frames"]) for (_, scene), samples in results.rows if scene in SEQUENCE_NAMES for sample in samples}
    )
    each = str(frames[0]) if len(frames) == 1 else f"{frames[0]} to {frames[-1]}"
    return (
        f"Table {table.number}: {table.metric} ({meaning}; success within {GOAL_TOLERANCE:g} m; "
        f"{each} frames a scene, {seeds})"
    )

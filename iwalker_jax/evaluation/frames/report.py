"""A run's evaluation report: the table over the test sequences and unseen scenes, and a picture sheet per sequence."""

from collections.abc import Callable
from pathlib import Path

from iwalker_jax.evaluation.frames.columns import FRAME_COLUMNS, UNCHARGED_COLUMNS, frame_values
from iwalker_jax.evaluation.frames.pictures import save_sheet
from iwalker_jax.evaluation.frames.reference_plans import REFERENCE_NAMES, ReferencePlanner
from iwalker_jax.evaluation.frames.sequences import (
    FrameSequence,
    evaluate_sequence,
    goal_routes,
    record_held_out_sequence,
    record_unseen_scenes,
)
from iwalker_jax.evaluation.tables import Table
from iwalker_jax.perception import Intrinsics
from iwalker_jax.planning import Planner, PlannerModels
from iwalker_jax.scenes import SEQUENCE_NAMES


def standard_sequences(
    names: tuple[str, ...] = SEQUENCE_NAMES,
    unseen_scenes: int = 60,
    seed: int = 0,
    say: Callable[[str], None] = lambda sentence: None,
    camera: Intrinsics = Intrinsics(),
) -> list[FrameSequence]:
    """The named test sequences and, unless `unseen_scenes` is 0, walks through that many held-out scenes."""
    sequences = []
    for name in names:
        say(f"recording the test sequence {name}")
        sequences.append(record_held_out_sequence(name, seed=seed, camera=camera))
    if unseen_scenes:
        say(f"recording walks through {unseen_scenes} unseen scenes")
        sequences.append(record_unseen_scenes(unseen_scenes, seed=seed, camera=camera))
    return sequences


def evaluate_all(
    planner: Planner,
    models: PlannerModels,
    sequences: list[FrameSequence],
    folder: Path | None = None,
    say: Callable[[str], None] = lambda sentence: None,
) -> Table:
    """Evaluate every sequence, and beside it what standing still and a straight line are worth on the same frames; with
    a folder, also write table.md, table.csv, both again with nothing charged, and one sheet a sequence."""
    rows = []
    for sequence in sequences:
        say(f"evaluating {sequence.name} ({len(sequence.frames)} frames)")
        routes = None if sequence.scenes is None else goal_routes(sequence)
        result = evaluate_sequence(planner, models, sequence, routes=routes)
        rows.append((("planner", sequence.name), (frame_values(result),)))
        for name in REFERENCE_NAMES:
            reference = evaluate_sequence(ReferencePlanner(name, planner.config), models, sequence, routes=routes)
            rows.append(((name, sequence.name), (frame_values(reference),)))
        if folder is not None:
            save_sheet(sequence, result, folder / f"{sequence.name}.png")
    table = Table(tuple(rows), ("plans", "scene"), FRAME_COLUMNS)
    if folder is not None:
        table.save(folder, "table")
        Table(table.rows, table.labels, UNCHARGED_COLUMNS).save(folder, "table_uncharged")
    return table

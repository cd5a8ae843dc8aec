"""What `compare` and `ablation` share: train several configurations and seeds on the same frames, one table of all."""

import dataclasses
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from iwalker_jax.commands.shared.console import (
    STOPPED,
    ends_in_a_sentence,
    progress_bar,
    require_counts,
    require_devices,
    say,
)
from iwalker_jax.commands.train import prepare_data
from iwalker_jax.evaluation import Table
from iwalker_jax.evaluation.frames import (
    FRAME_COLUMNS,
    REFERENCE_NAMES,
    UNCHARGED_COLUMNS,
    FrameSequence,
    ReferencePlanner,
    evaluate_sequence,
    frame_values,
    goal_routes,
    standard_sequences,
)
from iwalker_jax.planning import Planner, PlannerModels
from iwalker_jax.runtime.files import require_writable
from iwalker_jax.scenes import RouteMap
from iwalker_jax.training import TrainConfig, TrainingData, make_planner, planner_from, train


@dataclass(frozen=True)
class StudyCommand:
    """Options of a study.

    Attributes:
        out: folder of the study; finished runs in it are not repeated.
        seeds: number of seeds of every row.
        epochs: passes through the frames in every training.
        frames: number of synthetic training frames.
        unseen_scenes: held-out scenes in the evaluation.
    """

    out: Path
    seeds: int = 3
    epochs: int = TrainConfig.epochs
    frames: int = 1185
    unseen_scenes: int = 60


@dataclass(frozen=True)
class Variant:
    """One row group of a study.

    Attributes:
        label: shown in the table.
        config: of its training.
        trained: False evaluates the fresh initialisation.
        starts_from: label of an earlier variant whose parameters this one starts from.
    """

    label: str
    config: TrainConfig
    trained: bool = True
    starts_from: str | None = None


def with_free_spacing(config: TrainConfig) -> TrainConfig:
    """The configuration whose waypoints are spaced by the losses alone."""
    ipath = dataclasses.replace(config.planner.ipath, even=False)
    return dataclasses.replace(config, planner=dataclasses.replace(config.planner, ipath=ipath))


@ends_in_a_sentence("the same command goes on with the trainings that are not finished")
def study_main(
    title: str,
    description: str,
    default: StudyCommand,
    variants_of: Callable[[TrainConfig], Sequence[Variant]],
    arguments: list[str] | None,
    also: Callable[[Table, Path], None] = lambda table, folder: None,
) -> int:
    """Parse the options, run the study of the variants of the default configuration; returns the exit status.

    After every seed, `also` gets the table and the folder that it was saved to.
    """
    given = sys.argv[1:] if arguments is None else arguments
    command = tyro.cli(StudyCommand, args=given, default=default, description=description)
    require_counts(command, seeds=1, epochs=1, frames=1, unseen_scenes=0)
    require_devices()
    require_writable(command.out)
    config = TrainConfig(epochs=command.epochs)
    config = dataclasses.replace(config, source=dataclasses.replace(config.source, frames=command.frames))
    data = prepare_data(config)
    table = run_training_study(
        variants_of(config), command.seeds, data, command.out, command.unseen_scenes, title, also
    )
    return STOPPED if table is None else 0


def run_training_study(
    variants: Sequence[Variant],
    seeds: int,
    data: TrainingData,
    folder: Path,
    unseen_scenes: int,
    title: str,
    also: Callable[[Table, Path], None],
) -> Table | None:
    """Train every variant with every seed and evaluate all on the same sequences.

    Runs are resumable: a finished one is only loaded. The table is printed and saved after every seed, so nothing is
    lost when the study is stopped; None if it was.
    """
    camera = variants[0].config.planner.ipath.camera
    sequences = standard_sequences(unseen_scenes=unseen_scenes, say=say, camera=camera)
    judged = [(sequence, goal_routes(sequence)) for sequence in sequences]
    scores: dict[tuple[str, str], list[dict[str, float]]] = {}
    table = None
    for seed in range(seeds):
        trained: dict[str, Planner] = {}
        for name in REFERENCE_NAMES:
            reference = ReferencePlanner(name, variants[0].config.planner)
            _score(name, reference, variants[0].config.models, judged, seed, scores)
        for variant in variants:
            config = dataclasses.replace(variant.config, seed=seed)
            if variant.trained:
                start = trained[variant.starts_from] if variant.starts_from else None
                planner = _train(variant.label, config, data, folder / f"{variant.label}-{seed}", start)
                if planner is None:
                    return None
            else:
                planner = make_planner(config)
            trained[variant.label] = planner
            _score(variant.label, planner, variant.config.models, judged, seed, scores)
        rows = tuple(
            ((label, sequence.name), tuple(scores[label, sequence.name]))
            for sequence in sequences
            for label in (*REFERENCE_NAMES, *(variant.label for variant in variants))
        )
        table = Table(rows, ("method", "scene"), FRAME_COLUMNS)
        table.save(folder, title)
        Table(rows, ("method", "scene"), UNCHARGED_COLUMNS).save(folder, f"{title}_uncharged")
        say(f"After {seed + 1} of {seeds} seeds:")
        say(table.text())
        also(table, folder)
    if table is not None:
        say(table.legend())
    say(f"The table is in {folder / title}.md and .csv (one line a seed).")
    return table


def _train(label: str, config: TrainConfig, data: TrainingData, folder: Path, start: Planner | None) -> Planner | None:
    total = config.total_steps(data.depth.shape[0])
    with progress_bar(f"{label}, seed {config.seed}", total) as show:
        result = train(
            config,
            data,
            folder,
            start_from=start,
            on_progress=lambda p: show(p.step, f"loss {p.losses['total']:.3f}  {p.frames_per_second:.0f} frames/s"),
            say=say,
        )
    return None if result.interrupted else planner_from(config, result.state.params)


def _score(
    label: str,
    planner: Planner | ReferencePlanner,
    models: PlannerModels,
    sequences: Sequence[tuple[FrameSequence, Sequence[RouteMap]]],
    seed: int,
    scores: dict[tuple[str, str], list[dict[str, float]]],
) -> None:
    """Add the planner's figures on every sequence; robots are in the same states for every planner of a seed."""
    for sequence, routes in sequences:
        result = evaluate_sequence(planner, models, sequence, seed=seed, routes=routes)
        scores.setdefault((label, sequence.name), []).append(frame_values(result))

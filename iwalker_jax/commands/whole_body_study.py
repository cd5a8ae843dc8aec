"""Do whole-body losses in training make better episodes? python -m experiments.whole_body_study [--tasks 20]."""

import dataclasses
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
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
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation import Column, Table, aligned_text, mean_interval
from iwalker_jax.evaluation.episodes import (
    EPISODE_COLUMNS,
    episode_metrics,
    episode_values,
    landing_errors,
    row_of,
    shortest_route,
)
from iwalker_jax.navigation import POLICIES, EpisodeProgram, make_navigator
from iwalker_jax.planning import Planner, SplitModule, split_module
from iwalker_jax.runtime.files import require_writable
from iwalker_jax.tasks.generated import generated_tasks
from iwalker_jax.tasks.task import Task
from iwalker_jax.training.batches import TrainingBatch, gather_batch
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.loop import train
from iwalker_jax.training.losses import LossWeights
from iwalker_jax.training.maps import TrainingData
from iwalker_jax.training.on_policy import memory_ipath_for
from iwalker_jax.training.train_step import planner_from
from iwalker_jax.training.whole_body_losses import WholeBodyLosses, load_controlled_robot, whole_body_losses

ALL_TERMS = LossWeights(torque_margin=10.0, shortfall=3.0, placement=5.0)
"""Weights of the variant with all of the whole-body losses."""

_SHOWN = ("success %", "collided %", "fell %", "SPL", "speed m/s", "torque %", "QP failed %")
COLUMNS = (
    *(column for column in EPISODE_COLUMNS if column.title in _SHOWN),
    Column("step error cm", "between a planned footstep and where the foot landed, mean over an episode", 2),
)
FRAMES = 256
"""Training frames on which the footsteps' own terms are compared."""


@dataclass(frozen=True)
class Command:
    """Train with and without the whole-body losses, run the same tasks with each and print the table.

    without: none of the terms. qp: torque_margin and shortfall, which come from the whole-body QP. all: placement,
    the stepping feedback's, as well.

    Attributes:
        out: folder of runs and table; finished runs in it are not repeated.
        epochs: passes through the frames; frames: their number.
        tasks: generated tasks a variant, all of them at a time; seed: of training, tasks and noise.
        policy: how to navigate: default, networks, published or classical; see experiments.evaluate. networks has
            iStepper follow the path itself.
        weights: of the variant `all`.
    """

    out: Path = Path("runs/whole_body")
    epochs: int = 20
    frames: int = 1185
    tasks: int = 20
    seed: int = 0
    policy: str = "default"
    weights: LossWeights = field(default_factory=lambda: ALL_TERMS)


def weight_variants(command: Command) -> dict[str, TrainConfig]:
    """Configurations by label."""
    config = TrainConfig(epochs=command.epochs, seed=command.seed)
    config = dataclasses.replace(config, source=dataclasses.replace(config.source, frames=command.frames))
    weights = {"qp": dataclasses.replace(command.weights, placement=0.0), "all": command.weights}
    return {"without": config} | {label: dataclasses.replace(config, weights=own) for label, own in weights.items()}


def trained(label: str, config: TrainConfig, data: TrainingData, folder: Path) -> Planner | None:
    """The planner of a run, trained first if it is not yet; None if that was interrupted."""
    with progress_bar(label, config.total_steps(data.depth.shape[0])) as show:
        result = train(
            config, data, folder, on_progress=lambda p: show(p.step, f"loss {p.losses['total']:.3f}"), say=say
        )
    return None if result.interrupted else planner_from(config, result.state.params)


def footstep_terms(planner: Planner, data: TrainingData, config: TrainConfig) -> WholeBodyLosses:
    """Means of the whole-body losses over the footsteps of some frames, each with a robot state of its own."""
    controlled, width = load_controlled_robot(config.planner), config.planner.steps.width
    index = jnp.arange(min(FRAMES, data.depth.shape[0]))
    batch = gather_batch(data, index, jax.random.key(1), False, config.planner)

    @jax.jit
    def terms(network: SplitModule[Planner], batch: TrainingBatch) -> WholeBodyLosses:
        footsteps = network.merge()(batch.depth, batch.goal, batch.state, batch.mount).footsteps
        return jax.vmap(lambda steps, state: whole_body_losses(controlled, steps, state, width))(footsteps, batch.state)

    return jax.tree.map(lambda values: np.mean(np.asarray(values)), terms(split_module(planner), batch))


def episode_rows(planner: Planner, command: Command, tasks: Sequence[Task], shortest: Sequence[float]) -> list[dict]:
    """Column values of every task."""
    navigator = make_navigator(command.policy, planner, memory_ipath=memory_ipath_for(command.policy))
    program = EpisodeProgram(navigator, len(tasks))
    with progress_bar("episodes", len(tasks)) as show:
        record = program.run(
            tasks, command.seed, on_progress=lambda seconds, running: show(len(tasks) - running, f"{seconds:.0f} s")
        )
    rows = []
    for k, task in enumerate(tasks):
        episode = row_of(record, k)
        errors = landing_errors(episode)
        values = episode_values(episode_metrics(episode, task, shortest[k]))
        rows.append(values | {"step error cm": 100 * float(np.mean(errors)) if len(errors) else float("nan")})
    return rows


def difference(first: Sequence[dict], second: Sequence[dict], column: Column) -> str:
    """Mean change of a column from the first to the second rows of the same tasks, with its 95 % interval and n."""
    change = np.array([b[column.title] - a[column.title] for a, b in zip(first, second, strict=True)])
    change = change[np.isfinite(change)]
    if len(change) < 2:
        return "-"
    low, high = mean_interval(change)
    return f"{np.mean(change):+.2f} [{low:+.2f}, {high:+.2f}] ({len(change)})"


@ends_in_a_sentence("the same command goes on with the trainings that are not finished")
def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    command = tyro.cli(Command, args=sys.argv[1:] if arguments is None else arguments)
    # Whatever would fail after hours of training is refused before.
    require_counts(command, epochs=1, frames=1, tasks=1, seed=0)
    require_devices()
    require_writable(command.out)
    if command.policy not in POLICIES:
        raise InputError(f"Unknown policy {command.policy!r}; choose one of {', '.join(POLICIES)}.")
    configs = weight_variants(command)
    data = prepare_data(configs["without"])
    planners = {}
    for label, config in configs.items():
        planner = trained(label, config, data, command.out / f"{label}-{command.seed}")
        if planner is None:
            return STOPPED
        planners[label] = planner
        terms = footstep_terms(planner, data, config)
        say(
            f"{label}: torque margin {terms.torque_margin:.4f}, shortfall {terms.shortfall:.4f}, placement "
            f"{terms.placement:.5f} m^2, {100 * terms.solved:.1f} % of the instants solved."
        )
    tasks = generated_tasks(command.tasks, command.seed)
    shortest = [shortest_route(task) for task in tasks]
    rows = {label: episode_rows(planner, command, tasks, shortest) for label, planner in planners.items()}
    table = Table(
        tuple(((label, str(len(values))), tuple(values)) for label, values in rows.items()),
        ("whole body", "episodes"),
        COLUMNS,
        "episode",
    )
    table.save(command.out, f"whole_body-{command.policy}")
    say(table.text())
    say(table.legend())
    paired = [["minus without", *(column.title for column in COLUMNS)]]
    for label in list(rows)[1:]:
        paired.append([label, *(difference(rows["without"], rows[label], column) for column in COLUMNS)])
    say("Changes paired by task, with the 95 % interval of their mean and n; they hold for these trained networks:")
    say(aligned_text(paired))
    return 0

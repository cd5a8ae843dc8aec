"""The planner that a command is asked to use: of a training run, or the one that ships with the package."""

from pathlib import Path

from experiments.console import say
from iwalker_jax.errors import InputError
from iwalker_jax.planning.planner import Planner
from iwalker_jax.training.checkpoints import load_run
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.pretrained import load_planner
from iwalker_jax.training.train_step import planner_from


def planner_of(run: Path | None, checkpoint: int | None = None) -> tuple[Planner, TrainConfig, str]:
    """Planner, configuration and name of a run's checkpoint, or of the planner that ships with the package.

    Raises:
        CheckpointError: if it cannot be read.
        InputError: for a checkpoint without a run.
    """
    if run is None:
        if checkpoint is not None:
            raise InputError("A checkpoint belongs to a run; give the run's folder with --run.")
        return *load_planner(), "pretrained"
    state, config = load_run(run, checkpoint, say)
    say(f"Checkpoint of step {int(state.step)} ({config.method}).")
    return planner_from(config, state.params), config, f"{run}, step {int(state.step)}"

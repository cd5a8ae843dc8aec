"""The networks of a training run, or those that ship with the package."""

from os import PathLike
from pathlib import Path

from iwalker_jax.errors import InputError
from iwalker_jax.planning import Planner
from iwalker_jax.training.checkpoints import load_run
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.on_policy.saved import is_memory_run
from iwalker_jax.training.pretrained import load_planner as load_planner_file
from iwalker_jax.training.train_step import planner_from


def load_planner(run: str | Path | None = None) -> Planner:
    """The planner that ships with the package, or that of a training run: `plan = load_planner()(depth, goal)`.

    Args:
        run: folder of a training run, whose newest checkpoint is taken.

    Raises:
        CheckpointError: if it cannot be read.
        InputError: for what names no folder.
    """
    return load_with_config(run)[0]


def load_with_config(run: str | Path | None = None) -> tuple[Planner, TrainConfig]:
    """`load_planner` with the configuration that the networks were trained with."""
    if run is None:
        return load_planner_file()
    if not isinstance(run, (str, PathLike)):
        raise InputError(f"The run is {run!r:.40}; give the folder of a training run.")
    if is_memory_run(Path(run)):
        return load_planner_file()
    state, config = load_run(Path(run))
    return planner_from(config, state.params), config

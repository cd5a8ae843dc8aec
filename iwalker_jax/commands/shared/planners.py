"""The planner that a command is asked to use: of a training run, or the one that ships with the package."""

from pathlib import Path

import jax
from flax import nnx

from iwalker_jax.commands.shared.console import say
from iwalker_jax.errors import InputError
from iwalker_jax.planning import Planner
from iwalker_jax.runtime.files import digest
from iwalker_jax.training import TrainConfig, load_planner, load_run, planner_from
from iwalker_jax.training.on_policy import is_memory_run


def planner_of(run: Path | None, checkpoint: int | None = None) -> tuple[Planner, TrainConfig, str]:
    """Planner, configuration and name of a run's checkpoint, or of the planner that ships with the package.

    The name ends in the parameters' fingerprint: results that are kept under it are those of these very networks.

    Raises:
        CheckpointError: if it cannot be read.
        InputError: for a checkpoint without a run.
    """
    if run is None:
        if checkpoint is not None:
            raise InputError("A checkpoint belongs to a run; give the run's folder with --run.")
        planner, config = load_planner()
        return planner, config, f"pretrained ({fingerprint(planner)})"
    if is_memory_run(run):
        planner, config = load_planner()
        return planner, config, f"pretrained ({fingerprint(planner)}), {run}"
    state, config = load_run(run, checkpoint, say)
    say(f"Checkpoint of step {int(state.step)} ({config.method}).")
    planner = planner_from(config, state.params)
    return planner, config, f"{run}, step {int(state.step)} ({fingerprint(planner)})"


def fingerprint(planner: nnx.Module) -> str:
    """Eight hexadecimal digits that change with any parameter."""
    return parameters_digest(planner)[:8]


def parameters_digest(planner: nnx.Module) -> str:
    """SHA-256 of all parameters: 64 hexadecimal digits."""
    leaves = jax.tree_util.tree_flatten_with_path(nnx.state(planner, nnx.Param))[0]
    return digest({jax.tree_util.keystr(path): leaf for path, leaf in leaves})

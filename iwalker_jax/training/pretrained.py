"""The planner that ships with the package: its configuration and half-precision parameters in one small file."""

from pathlib import Path

from iwalker_jax.errors import CheckpointError
from iwalker_jax.planning import Planner
from iwalker_jax.runtime.files import first_line
from iwalker_jax.runtime.reading import printable
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.network_files import read_network_file, restored_parameters, write_network
from iwalker_jax.training.train_step import planner_from, planner_structure

PRETRAINED = Path(__file__).with_name("pretrained.npz")


def save_planner(file: Path, planner: Planner, config: TrainConfig) -> None:
    """Write a planner and the configuration of its training to an .npz file; parameters in half precision.

    Raises:
        CheckpointError: if the file cannot be written.
    """
    write_network(file, planner, config, "the planner")


def load_planner(file: Path = PRETRAINED) -> tuple[Planner, TrainConfig]:
    """The planner of a file of `save_planner`, by default the one that ships with the package.

    Raises:
        CheckpointError: if the file is missing, damaged or of another version.
    """
    try:
        arrays, config = read_network_file(file, TrainConfig)
        params = restored_parameters(arrays, planner_structure(config).params)
    except (KeyError, TypeError, ValueError) as error:
        raise CheckpointError(
            f"{printable(file, 300)} holds no planner that this version can read ({first_line(error)}); "
            "train one with `iwalker-train` and pass its folder."
        ) from error
    return planner_from(config, params), config

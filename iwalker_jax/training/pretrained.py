"""The planner that ships with the package: its configuration and half-precision parameters in one small file."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from iwalker_jax.errors import CheckpointError
from iwalker_jax.planning import Planner
from iwalker_jax.runtime.files import first_line, read_npz, write_npz
from iwalker_jax.runtime.reading import printable
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.config_dict import config_from_dict, config_to_dict
from iwalker_jax.training.train_step import planner_from, planner_structure

PRETRAINED = Path(__file__).with_name("pretrained.npz")
_CONFIG = "config"


def save_planner(file: Path, planner: Planner, config: TrainConfig) -> None:
    """Write a planner and the configuration of its training to an .npz file; parameters in half precision.

    Raises:
        CheckpointError: if the file cannot be written.
    """
    leaves = jax.tree_util.tree_flatten_with_path(nnx.state(planner, nnx.Param))[0]
    arrays = {jax.tree_util.keystr(path): np.asarray(leaf, np.float16) for path, leaf in leaves}
    arrays[_CONFIG] = np.asarray(json.dumps(config_to_dict(config)))
    try:
        write_npz(file, arrays)
    except OSError as error:
        raise CheckpointError(f"Cannot write the planner to {file}: {error.strerror}; choose another place.") from error


def load_planner(file: Path = PRETRAINED) -> tuple[Planner, TrainConfig]:
    """The planner of a file of `save_planner`, by default the one that ships with the package.

    Raises:
        CheckpointError: if the file is missing, damaged or of another version.
    """
    try:
        arrays = read_npz(file)
        config: TrainConfig = config_from_dict(TrainConfig, json.loads(str(arrays.pop(_CONFIG))))
        template = planner_structure(config).params
        paths, structure = jax.tree_util.tree_flatten_with_path(template)
        leaves = [_restored(arrays[jax.tree_util.keystr(path)], leaf.shape) for path, leaf in paths]
    except (KeyError, TypeError, ValueError) as error:
        raise CheckpointError(
            f"{printable(file, 300)} holds no planner that this version can read ({first_line(error)}); "
            "train one with `iwalker-train` and pass its folder."
        ) from error
    return planner_from(config, jax.tree.unflatten(structure, leaves)), config


def _restored(array: np.ndarray, shape: tuple[int, ...]) -> jax.Array:
    if array.dtype.kind != "f" or array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"parameters of shape {array.shape} instead of {shape}, no real numbers, or not finite")
    return jnp.asarray(array, jnp.float32)

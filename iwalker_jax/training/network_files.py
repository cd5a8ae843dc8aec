"""A trained network as one small file: its parameters in half precision, and the configuration of its training."""

import json
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from iwalker_jax.errors import CheckpointError
from iwalker_jax.runtime.config_dict import config_from_dict, config_to_dict
from iwalker_jax.runtime.files import read_npz, write_npz

_CONFIG = "config"

C = TypeVar("C")


def write_network(file: Path, network: nnx.Module, config: Any, what: str) -> None:
    """Write a network and the configuration of its training to an .npz file.

    Args:
        file: to write.
        network: all of whose variables are parameters.
        config: a dataclass.
        what: the file holds, for the sentence.

    Raises:
        CheckpointError: if the file cannot be written.
    """
    leaves = jax.tree_util.tree_flatten_with_path(nnx.state(network, nnx.Param))[0]
    arrays = {jax.tree_util.keystr(path): np.asarray(leaf, np.float16) for path, leaf in leaves}
    arrays[_CONFIG] = np.asarray(json.dumps(config_to_dict(config)))
    try:
        write_npz(file, arrays)
    except OSError as error:
        raise CheckpointError(f"Cannot write {what} to {file}: {error.strerror}; choose another place.") from error


def read_network_file(file: Path, kind: type[C]) -> tuple[dict[str, np.ndarray], C]:
    """Parameters by name, and the configuration, of a file of `write_network`.

    Raises:
        InputError, KeyError, TypeError, ValueError: if it holds no such things.
    """
    arrays = read_npz(file)
    config: C = config_from_dict(kind, json.loads(str(arrays.pop(_CONFIG))))  # type: ignore[arg-type]
    return arrays, config


def restored_parameters(arrays: dict[str, np.ndarray], template: Any) -> Any:
    """Parameters in the shape of a template's.

    Raises:
        KeyError: for one that is missing.
        ValueError: for one of another shape, or without real, finite numbers.
    """
    paths, structure = jax.tree_util.tree_flatten_with_path(template)
    leaves = [_restored(arrays[jax.tree_util.keystr(path)], leaf.shape) for path, leaf in paths]
    return jax.tree.unflatten(structure, leaves)


def _restored(array: np.ndarray, shape: tuple[int, ...]) -> jax.Array:
    if array.dtype.kind != "f" or array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"parameters of shape {array.shape} instead of {shape}, no real numbers, or not finite")
    return jnp.asarray(array, jnp.float32)

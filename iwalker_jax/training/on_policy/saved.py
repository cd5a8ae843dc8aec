"""Trained iPaths with a memory as small files: configuration and half-precision parameters."""

from pathlib import Path

from flax import nnx

from iwalker_jax.errors import CheckpointError
from iwalker_jax.navigation.navigators import POLICIES
from iwalker_jax.planning import MemoryIPath, split_module
from iwalker_jax.runtime.files import first_line
from iwalker_jax.runtime.reading import printable
from iwalker_jax.training.network_files import read_network_file, restored_parameters, write_network
from iwalker_jax.training.on_policy.config import OnPolicyConfig

PRETRAINED_MEMORY_IPATH = Path(__file__).with_name("pretrained.npz")
"""The network that ships with the package."""

NETWORK_FILE = "memory_ipath.npz"
"""Of a run's folder."""


def save_memory_ipath(file: Path, network: MemoryIPath, config: OnPolicyConfig) -> None:
    """Write a network and the configuration of its training to an .npz file; parameters in half precision.

    Raises:
        CheckpointError: if the file cannot be written.
    """
    write_network(file, network, config, "the network")


def load_memory_ipath(file: Path = PRETRAINED_MEMORY_IPATH) -> tuple[MemoryIPath, OnPolicyConfig]:
    """The network of a file of `save_memory_ipath`, by default the one that ships with the package, and its training's
    configuration.

    Raises:
        CheckpointError: if the file is missing, damaged or of another version.
    """
    try:
        arrays, config = read_network_file(file, OnPolicyConfig)
        network = split_module(MemoryIPath(config.network, nnx.Rngs(0)))
        params = restored_parameters(arrays, network.params)
    except (KeyError, TypeError, ValueError) as error:
        raise CheckpointError(
            f"{printable(file, 300)} holds no iPath with a memory that this version can read ({first_line(error)}); "
            "train one with `iwalker-train-memory`."
        ) from error
    return network.with_params(params).merge(), config


def is_memory_run(run: Path) -> bool:
    """Whether a folder is that of a training of this network, whose planner is the one that ships."""
    return (Path(run) / NETWORK_FILE).is_file()


def memory_ipath_for(policy: str, run: Path | None = None) -> MemoryIPath | None:
    """The network that a policy of `POLICIES` needs besides its planner: that of a training run if its folder holds
    one, else the one that ships; None for a policy that needs none.

    Raises:
        CheckpointError: if it cannot be read.
    """
    if policy not in POLICIES or POLICIES[policy].guidance.source != "memory":
        return None
    own = run is not None and is_memory_run(run)
    return load_memory_ipath(Path(run) / NETWORK_FILE if run is not None and own else PRETRAINED_MEMORY_IPATH)[0]

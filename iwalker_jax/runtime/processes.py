"""Several processes, on one machine or on many, that work as one: how they come together, share and part."""

import itertools
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as ocp
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jax.typing import ArrayLike
from jaxtyping import Array

from iwalker_jax.errors import InputError
from iwalker_jax.runtime.rendezvous import DistributedProcess, bind_address, rendezvous

_LONGEST_WAIT = 7 * 24 * 3600  # [s] for processes that have more to do
_ANOTHER_FAILED = "Another process has failed; see what it says, and start all of them again."

_broadcasts = itertools.count()  # the same in every process: they broadcast the same things in the same order


@dataclass(frozen=True)
class ProcessGroup:
    """Which processes work together; a command by itself if nothing is given.

    Attributes:
        coordinator: HOST:PORT at which process 0 listens and the others find it; else $IWALKER_COORDINATOR.
        processes: number of processes that work together; else $IWALKER_PROCESSES.
        process: number of this one, from 0; else $IWALKER_PROCESS.
        join_timeout: [s] that the processes wait for each other at the start.
    """

    coordinator: str | None = None
    processes: int | None = None
    process: int | None = None
    join_timeout: float = 300.0

    def this_process(self, environment: Mapping[str, str] = os.environ) -> DistributedProcess | None:
        """This process of the group, what is missing taken from the environment; None for a command by itself.

        Raises:
            InputError: for values that are missing or out of range.
        """
        coordinator = self.coordinator
        if coordinator is None:
            coordinator = environment.get("IWALKER_COORDINATOR")
        processes = _number(self.processes, "IWALKER_PROCESSES", environment)
        process = _number(self.process, "IWALKER_PROCESS", environment)
        given = {"--coordinator HOST:PORT": coordinator, "--processes N": processes, "--process K": process}
        missing = [name for name, value in given.items() if value is None]
        if len(missing) == len(given):
            return None
        if coordinator is None or processes is None or process is None:
            raise InputError(f"Several processes need {', '.join(given)}; give also {' and '.join(missing)}.")
        host, _, port = coordinator.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise InputError(f"The coordinator {coordinator!r} is not HOST:PORT, such as 192.168.0.1:8476.")
        if not 0 <= process < processes:
            raise InputError(f"There is no process {process} of {processes}; give numbers from 0 to N - 1.")
        if not 0 < self.join_timeout < float("inf"):
            raise InputError(f"The processes cannot wait {self.join_timeout} s for each other; give a positive time.")
        return DistributedProcess(host.strip("[]"), int(port), process, processes, self.join_timeout)


def join_group(group: ProcessGroup) -> None:
    """Bring the processes of a group together, if there is more than one; comes before anything is computed.

    Raises:
        InputError: for bad values, or when the processes do not find each other in time.
    """
    own = group.this_process()
    if own is None or own.num_processes == 1:
        return
    rendezvous(own)
    host = f"[{own.host}]" if ":" in own.host else own.host
    jax.distributed.initialize(
        f"{host}:{own.port}",
        own.num_processes,
        own.process_id,
        cluster_detection_method="deactivate",
        coordinator_bind_address=bind_address(own.host, own.port),
    )
    print_error = sys.excepthook

    def print_and_exit(*error: Any) -> None:
        print_error(*error)
        exit_process(1)

    sys.excepthook = print_and_exit


def is_first() -> bool:
    """Whether this is the process that prints and writes: number 0, or the only one."""
    return jax.process_index() == 0


def broadcast(tree: Any) -> Any:
    """Process 0's values of a tree of arrays whose shapes are the same in every process.

    Raises:
        InputError: if another process has failed.
    """
    if jax.distributed.is_initialized():
        # The first collective gives up where a partner is half a minute late; this waits as long as it takes.
        _wait_for_all(f"iwalker_broadcast_{next(_broadcasts)}", _LONGEST_WAIT)
    return multihost_utils.broadcast_one_to_all(tree)


def device_put(tree: Any, mesh: Mesh | None, *axes: str) -> Any:
    """Copy of a tree of arrays on the devices of a mesh: whole on each, or split over the mesh's given axes.

    Every process must hold the same whole arrays. Without a mesh the copy is on the default device.
    """
    if mesh is None:
        return jax.tree.map(lambda leaf: jnp.array(np.asarray(leaf)), tree)
    sharding = NamedSharding(mesh, PartitionSpec(*axes))

    def placed(leaf: ArrayLike) -> Array:
        whole = np.array(leaf)
        return jax.make_array_from_callback(whole.shape, sharding, lambda index: whole[index])

    return jax.tree.map(placed, tree)


def barrier(seconds: int = _LONGEST_WAIT) -> None:
    """Wait until every process has come this far; from here on each is alone.

    Raises:
        InputError: if another process has failed, or has not come in time.
    """
    if not jax.distributed.is_initialized():
        return
    _wait_for_all("iwalker_barrier", seconds)
    try:
        jax.distributed.shutdown()
    except jax.errors.JaxRuntimeError as error:
        raise InputError(_ANOTHER_FAILED) from error


def _wait_for_all(key: str, seconds: int) -> None:
    """Wait until every process has come to a place of its own name; not a collective, which would keep a core busy."""
    try:
        ocp.multihost.get_barrier_sync_fn()(key=key, timeout_ms=1000 * seconds)
    except jax.errors.JaxRuntimeError as error:
        raise InputError(_ANOTHER_FAILED) from error


def exit_process(status: int) -> NoReturn:
    """End this process with an exit status; if others still work with it, they then end too instead of waiting."""
    if jax.distributed.is_initialized():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    raise SystemExit(status)


def _number(given: int | None, variable: str, environment: Mapping[str, str]) -> int | None:
    text = environment.get(variable)
    if given is not None or text is None:
        return given
    if not text.isdecimal():
        raise InputError(f"${variable} is {text!r}; give a whole number.")
    return int(text)

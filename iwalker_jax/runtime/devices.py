"""The machine's devices: which of them a program runs on, and programs whose rows are split over them."""

import os
import platform
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from iwalker_jax.errors import InputError
from iwalker_jax.runtime.files import first_line

_PLATFORM_VARIABLES = ("JAX_PLATFORMS", "JAX_PLATFORM_NAME")


def chosen_devices(count: int | None = None) -> list[jax.Device]:
    """The first `count` devices of this process, all by default.

    Raises:
        InputError: if fewer devices are present, or none of the platform that is asked for.
    """
    present = local_devices()
    count = len(present) if count is None else count
    if not isinstance(count, (int, np.integer)) or not 1 <= count <= len(present):
        raise InputError(
            f"{count!s:.40} devices were asked for but {len(present)} are present; see jax.local_devices()."
        )
    return present[:count]


def local_devices() -> list[jax.Device]:
    """This process's devices.

    Raises:
        InputError: if the environment asks JAX for a platform that is not there.
    """
    try:
        return jax.local_devices()
    except (RuntimeError, AssertionError) as error:
        asked = [f"{name}={os.environ[name]}" for name in _PLATFORM_VARIABLES if os.environ.get(name)]
        wanted = f"the platform that {' and '.join(asked)} asks for" if asked else f"its devices ({first_line(error)})"
        raise InputError(
            f"JAX cannot use {wanted}; unset the variable, set JAX_PLATFORMS=cpu, or install JAX for this machine's "
            "accelerator."
        ) from error


def machine() -> str:
    """Processor, cores, JAX's devices and version in a line, for tables of times."""
    return (
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, {jax.device_count()} x "
        f"{jax.devices()[0].device_kind}, jax {jax.__version__}"
    )


class ShardedProgram:
    """A function of one row, compiled once for many rows that are split over devices.

    Attributes:
        replicated, sharded: where what all rows share is placed, and where the rows are.
    """

    def __init__(self, one: Callable[..., Any], devices: list[jax.Device]) -> None:
        """Take a function of what all rows share and of the arguments of one row; the compilation comes later."""
        self._one = one
        self._mesh = Mesh(np.array(devices), ("rows",))
        self.replicated = NamedSharding(self._mesh, PartitionSpec())
        self.sharded = NamedSharding(self._mesh, PartitionSpec("rows"))
        self._compiled: Callable[..., Any] | None = None

    def round_up(self, rows: int) -> int:
        """A number of rows rounded up to the same number on every device."""
        return -(-rows // self._mesh.size) * self._mesh.size

    def compiled(self, shared: Any, *rows: Any) -> Callable[..., Any]:
        """The program of (shared, *rows), rows first in every leaf; shapes are those of the first call."""
        if self._compiled is None:

            def many(shared: Any, *rows: Any) -> Any:
                return jax.vmap(partial(self._one, shared))(*rows)

            if self._mesh.size > 1:
                specs = (self.replicated.spec, *[self.sharded.spec] * len(rows))
                many = jax.shard_map(
                    many, mesh=self._mesh, in_specs=specs, out_specs=self.sharded.spec, check_vma=False
                )
            self._compiled = jax.jit(many).lower(shared, *rows).compile()
        return self._compiled

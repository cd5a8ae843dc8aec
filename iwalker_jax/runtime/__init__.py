"""The process and its machine: settings, devices, groups of processes, and files that are whole or not there.

Only the settings are imported at once, because they must be chosen before NumPy and JAX are imported; everything else
comes when it is first asked for.
"""

from typing import TYPE_CHECKING

from iwalker_jax.lazy_names import lazy_names
from iwalker_jax.runtime.settings import configure_runtime, default_cache_folder, requested_devices

if TYPE_CHECKING:
    from iwalker_jax.runtime.config_dict import config_from_dict, config_to_dict
    from iwalker_jax.runtime.devices import ShardedProgram, chosen_devices, local_devices, machine
    from iwalker_jax.runtime.files import atomic_write, read_npz, write_csv, write_json, write_npz, write_text
    from iwalker_jax.runtime.processes import (
        ProcessGroup,
        barrier,
        broadcast,
        device_put,
        exit_process,
        is_first,
        join_group,
    )
    from iwalker_jax.runtime.reading import printable, read_bytes, read_text

__all__ = [
    "ProcessGroup",
    "ShardedProgram",
    "atomic_write",
    "barrier",
    "broadcast",
    "chosen_devices",
    "config_from_dict",
    "config_to_dict",
    "configure_runtime",
    "default_cache_folder",
    "device_put",
    "exit_process",
    "is_first",
    "join_group",
    "local_devices",
    "machine",
    "printable",
    "read_bytes",
    "read_npz",
    "read_text",
    "requested_devices",
    "write_csv",
    "write_json",
    "write_npz",
    "write_text",
]

_HOMES = {
    "config_dict": "config_from_dict config_to_dict",
    "devices": "ShardedProgram chosen_devices local_devices machine",
    "files": "atomic_write read_npz write_csv write_json write_npz write_text",
    "processes": "ProcessGroup barrier broadcast device_put exit_process is_first join_group",
    "reading": "printable read_bytes read_text",
}

__getattr__, __dir__ = lazy_names(__name__, _HOMES)

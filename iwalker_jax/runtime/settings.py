"""Process settings that must be chosen before JAX is imported; commands, tests and benchmarks call this first."""

import os
import sys
from pathlib import Path

_XLA_CPU_FLAGS = (
    # jaxlib 0.10's concurrency-optimised scheduler can hang for ever on large vmapped CPU programs.
    "--xla_cpu_enable_concurrency_optimized_scheduler=false",
    # The first compiles the solvers' small loops as one kernel each instead of dispatching every operation: up to 10x
    # faster. The second keeps LLVM from unrolling short loops over a batch before it has vectorised them: 2x faster.
    "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=4000000,-unroll-full-max-count=4",
)


_configured_for: list[int | None] = []  # the devices that this process was configured for


def configure_runtime(host_devices: int | None = None) -> None:
    """Set XLA, BLAS and compilation-cache defaults; a user's own environment variables win.

    Doing so again changes nothing, so that a notebook's first cell can be run twice.

    Args:
        host_devices: number of CPU devices to expose (data parallelism without accelerators); None keeps one.

    Raises:
        RuntimeError: if JAX was imported before, or for other devices, because the settings would silently not apply.
    """
    if "jax" in sys.modules:
        if _configured_for == [host_devices]:
            return
        raise RuntimeError("configure_runtime() came after `import jax`; call it first so that its settings apply.")
    flags = os.environ.get("XLA_FLAGS", "")
    wanted = list(_XLA_CPU_FLAGS)
    if host_devices is not None:
        wanted.append(f"--xla_force_host_platform_device_count={host_devices}")
    for flag in wanted:
        if flag.split("=")[0] not in flags:
            flags = f"{flags} {flag}".strip()
    os.environ["XLA_FLAGS"] = flags
    # Small LAPACK calls stall when several BLAS threads compete for a busy core.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(default_cache_folder() / "xla"))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
    _configured_for[:] = [host_devices]


def requested_devices(arguments: list[str]) -> int | None:
    """The value of `--devices` among command-line arguments, which must be known before JAX is imported; else None."""
    for i, argument in enumerate(arguments):
        if argument.startswith("--devices"):
            text = argument.partition("=")[2] or (arguments[i + 1] if i + 1 < len(arguments) else "")
            if text.isdecimal() and int(text) > 1:
                return int(text)
    return None


def default_cache_folder() -> Path:
    """Folder for generated data and compiled programs: $IWALKER_CACHE, else ~/.cache/iwalker_jax."""
    override = os.environ.get("IWALKER_CACHE")
    return Path(override) if override else Path.home() / ".cache" / "iwalker_jax"

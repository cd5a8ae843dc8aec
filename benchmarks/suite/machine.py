"""The machine and the packages of a run, and what other processes took of it meanwhile."""

import os
import platform
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = (
    *("iwalker-jax", "jax", "jaxlib", "mujoco", "mujoco-mjx", "numpy", "scipy", "opencv-python-headless"),
    *("casadi", "clarabel", "daqp", "edt", "moreau", "mpax", "osqp", "proxsuite", "qpax", "quadprog", "scikit-fmm"),
)
"""Whose versions a report names."""

SHARED = 0.5
"""Load a core, besides the benchmark, above which a machine was not the benchmark's alone."""


def describe() -> dict[str, str | int]:
    """Processor, cores, memory [GiB], system and Python."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        "memory": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def versions() -> dict[str, str]:
    """Of the packages that are installed."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


class Neighbours:
    """Counts the cores that processes other than this one's children keep busy; only Linux tells."""

    def __init__(self) -> None:
        self._began, self._busy, self._own = time.monotonic(), _busy_seconds(), _own_seconds()

    def cores(self) -> float | None:
        """Cores that others kept busy since the beginning, on average."""
        now, busy = time.monotonic(), _busy_seconds()
        if busy is None or self._busy is None or now <= self._began:
            return None
        others = busy - self._busy - (_own_seconds() - self._own)
        return max(others / (now - self._began), 0.0)


def _busy_seconds() -> float | None:
    """Seconds that all cores together were not idle, since the machine began; also those stolen by its host."""
    try:
        line = Path("/proc/stat").read_text(encoding="utf-8").splitlines()[0].split()
    except OSError:
        return None
    user, nice, system, _, _, interrupts, soft, stolen = (int(word) for word in line[1:9])
    return (user + nice + system + interrupts + soft + stolen) / os.sysconf("SC_CLK_TCK")


def _own_seconds() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system

"""What benchmarks need beside the package: judges, without which they leave, and peers, which are left out."""

from collections.abc import Iterable, Mapping
from importlib.util import find_spec

INSTALL = "pip install 'iwalker-jax[peers]'"
"""Brings all judges and peers."""


def require(*modules: str) -> None:
    """Leave with one sentence if modules are missing that a benchmark cannot do without."""
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise SystemExit(f"error: this benchmark needs {', '.join(missing)}; run: {INSTALL}")


def absent(peers: Mapping[str, str]) -> tuple[str, ...]:
    """Packages of peers (module to package of the extra) that are not installed."""
    return tuple(package for module, package in peers.items() if find_spec(module) is None)


def missing_sentence(packages: Iterable[str]) -> str:
    """That rows are left out, and how to get them."""
    return f"Left out, because they are not installed: {', '.join(packages)}. To get them: {INSTALL}"

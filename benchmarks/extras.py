"""What benchmarks begin with: the solvers that they compare with are there, and arguments are read."""

import argparse
from importlib.util import find_spec


def require(*modules: str) -> None:
    """Leave with one sentence if modules are missing that only benchmarks need."""
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        names = ", ".join(missing)
        raise SystemExit(f"error: this benchmark needs {names}; run: pip install 'iwalker-jax[benchmarks]'")


def read_no_options(description: str | None) -> None:
    """Answer --help and refuse arguments, for a benchmark that takes none."""
    style = argparse.RawDescriptionHelpFormatter
    argparse.ArgumentParser(description=description, formatter_class=style).parse_args()

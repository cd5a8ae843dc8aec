"""The room's face: it imports neither NumPy nor JAX by itself, and every name that it promises is there."""

import subprocess
import sys

import pytest

from iwalker_jax import runtime


def test_settings_come_before_numpy_and_jax():
    """Oracle: the modules that a fresh interpreter has loaded."""
    code = "import sys, iwalker_jax.runtime; print(sorted({'jax', 'numpy', 'orbax'} & set(sys.modules)))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert said.strip() == "[]"


def test_every_promised_name_is_there():
    assert set(runtime.__all__) <= set(dir(runtime))
    assert all(getattr(runtime, name) is not None for name in runtime.__all__)
    with pytest.raises(AttributeError, match="no attribute 'teleport'"):
        _ = runtime.teleport

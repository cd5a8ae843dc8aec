"""`import iwalker_jax as iw`: cheap, complete and typed, as a fresh interpreter and the source itself tell."""

import ast
import importlib
import inspect
import json
from pathlib import Path

import pytest

import iwalker_jax as iw
from tests.fresh_process import ROOT, printed_by

HEAVY = ("jax", "jaxlib", "numpy", "mujoco", "flax", "cv2", "matplotlib", "trimesh")
LONGEST_IMPORT = 0.2
"""[s] that importing the package may take."""


def test_importing_is_cheap():
    code = """
import json, sys, time
began = time.perf_counter()
import iwalker_jax as iw
seconds = time.perf_counter() - began
dir(iw), iw.__all__, iw.__version__
print(json.dumps({"seconds": seconds, "modules": sorted(sys.modules)}))
"""
    # The least of three: other processes may hold the machine, but none makes an import faster.
    runs = [json.loads(printed_by("-c", code)) for _ in range(3)]
    loaded = {name.split(".")[0] for name in runs[0]["modules"]}
    assert loaded.isdisjoint(HEAVY)
    assert min(run["seconds"] for run in runs) < LONGEST_IMPORT


def test_the_process_can_be_configured_before_jax_is_imported():
    code = """
import json, os, sys
import iwalker_jax as iw
iw.configure_runtime(host_devices=3)
early = "jax" not in sys.modules
iw.solve_qp
print(json.dumps({"early": early, "late": "jax" in sys.modules, "devices": sys.modules["jax"].device_count()}))
"""
    assert json.loads(printed_by("-c", code)) == {"early": True, "late": True, "devices": 3}


def test_configuring_twice_does_no_harm_and_too_late_is_said():
    """As when a notebook's first cell is run again."""
    code = """
import os
import iwalker_jax as iw
iw.configure_runtime()
import jax
before = dict(os.environ)
iw.configure_runtime()
assert dict(os.environ) == before
try:
    iw.configure_runtime(host_devices=3)
except RuntimeError as error:
    print(error)
"""
    assert "after `import jax`" in printed_by("-c", code)


@pytest.mark.parametrize("name", iw.__all__)
def test_every_name_is_there_and_documented(name):
    value = getattr(iw, name)
    assert value is getattr(iw, name)
    assert name in dir(iw)
    if inspect.isfunction(value) or inspect.isclass(value):
        assert (value.__doc__ or "").strip(), f"iw.{name} says nothing of itself"


def test_unknown_names_are_refused_as_any_module_does():
    with pytest.raises(AttributeError, match="no attribute 'solve_everything'"):
        _ = iw.solve_everything


@pytest.mark.parametrize("package", ["iwalker_jax", "iwalker_jax.runtime", "iwalker_jax.film", "iwalker_jax.api"])
def test_type_checkers_are_told_the_same_names(package):
    module = importlib.import_module(package)
    tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
    checked = next(node for node in tree.body if isinstance(node, ast.If))
    told = {
        alias.name: node.module for node in checked.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    lazy = {name: f"{package}.{home}" for home, names in module._HOMES.items() for name in names.split()}
    assert told == lazy
    assert set(told) <= set(module.__all__) <= set(dir(module))


def test_the_package_says_that_it_is_typed():
    assert (ROOT / "iwalker_jax" / "py.typed").is_file()

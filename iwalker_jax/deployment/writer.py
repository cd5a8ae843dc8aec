"""Writes a robot's functions to a folder: StableHLO artifacts of `jax.export`, and a manifest of what they are."""

import dataclasses
import hashlib
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax
import jaxlib
from jax import export

from iwalker_jax.deployment import loader
from iwalker_jax.deployment.exported_functions import ExportedFunction
from iwalker_jax.deployment.fields import field_of
from iwalker_jax.deployment.functions import MEMORY
from iwalker_jax.navigation.navigators import Navigator
from iwalker_jax.runtime.files import atomic_write, write_bytes, write_json
from iwalker_jax.version import __version__

PLATFORMS = ("cpu", "cuda")
"""That an artifact runs on."""

LOADER = "load_policy.py"
"""The loader's copy beside the artifacts."""


def write_policy(
    folder: Path,
    navigator: Navigator,
    exported: Mapping[str, ExportedFunction],
    described: Mapping[str, Any],
    on_progress: Callable[[int, str], None] = lambda done, name: None,
) -> dict[str, Any]:
    """Write the artifacts of a robot's functions, then the manifest, without which the folder is none.

    Args:
        folder: to write to; an older policy there is replaced.
        navigator: the robot.
        exported: its functions.
        described: what else the manifest says: policy, weights, configuration.
        on_progress: hears how many functions are written, and which is next.

    Returns:
        The manifest.

    Raises:
        OSError: if a file cannot be written.
    """
    manifest_file = folder / loader.MANIFEST
    manifest_file.unlink(missing_ok=True)
    functions = {}
    for number, (name, entry) in enumerate(exported.items()):
        on_progress(number, name)
        artifact = export.export(jax.jit(entry.function), platforms=PLATFORMS)(dict(entry.inputs))
        content = bytes(artifact.serialize())
        file = f"{name}.jaxexport"
        write_bytes(folder / file, content)
        functions[name] = {
            "file": file,
            "sha256": hashlib.sha256(content).hexdigest(),
            "purpose": entry.purpose,
            "rate_hz": entry.rate,
            "memory": MEMORY if any(key.startswith(f"{MEMORY}.") for key in entry.inputs) else None,
            "platforms": list(artifact.platforms),
            "inputs": _described(entry.inputs),
            "outputs": _described(jax.tree.unflatten(artifact.out_tree, artifact.out_avals)),
        }
    with atomic_write(folder / LOADER) as part:
        shutil.copyfile(loader.__file__, part)
    manifest = {
        "format": loader.FORMAT,
        "product": {"name": "iwalker-jax", "version": __version__},
        "versions": {
            "jax": jax.__version__,
            "jaxlib": jaxlib.__version__,
            "calling_convention": artifact.calling_convention_version,
        },
        "environment": {"XLA_FLAGS": _xla_flags()},
        **described,
        "robot": _robot(navigator),
        "camera": dataclasses.asdict(navigator.intrinsics),
        "units": "SI: metres, seconds, radians, newtons",
        "functions": functions,
    }
    manifest["sha256"] = loader.manifest_digest(manifest)
    write_json(manifest_file, manifest)
    on_progress(len(exported), "")
    return manifest


def _xla_flags() -> str:
    """This process's flags but for the number of its devices, which is its own affair."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    return " ".join(flag for flag in flags if not flag.startswith("--xla_force_host_platform_device_count"))


def _described(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Shape, type, unit, frame and meaning of arrays by name."""
    return {
        name: {
            "shape": [size if isinstance(size, int) else str(size) for size in arrays[name].shape],
            "dtype": str(arrays[name].dtype),
            **field_of(name)._asdict(),
        }
        for name in arrays
    }


def _robot(navigator: Navigator) -> dict[str, Any]:
    robot = navigator.walker.robot
    return {
        "joints": list(robot.joint_names),
        "motors": list(robot.motor_names),
        "motor_limits": [[float(bound) for bound in row] for row in robot.motor_limits],
        "home": [float(value) for value in robot.home],
        "camera_in_base_body": {
            "position": [float(value) for value in navigator.camera.p_body_camera],
            "rotation": [[float(value) for value in row] for row in navigator.camera.R_body_camera],
        },
    }

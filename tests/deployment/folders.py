"""A small exported policy whose one function is a formula, so that its outputs can be told by hand."""

from pathlib import Path

import jax.numpy as jnp
from flax import nnx
from jax import export

from iwalker_jax.deployment.exported_functions import ExportedFunction
from iwalker_jax.deployment.functions import shape_of
from iwalker_jax.deployment.writer import write_policy
from iwalker_jax.navigation import make_navigator
from iwalker_jax.planning import IPathConfig, Planner, PlannerConfig


def small_navigator():
    """BRUCE with small, untrained networks."""
    planner = Planner(PlannerConfig(ipath=IPathConfig(trunk_width=4, hidden=16)), nnx.Rngs(0))
    return make_navigator("default", planner, sensors="none", depth_noise=False)


def formula(arrays):
    """goal = 2 time + row, of as many rows as the path has."""
    return {"goal": 2 * arrays["time"] + arrays["path"][:, 0, :], "solved": jnp.all(arrays["touching"])}


def write_formula(folder: Path, navigator) -> dict:
    """An exported policy of this one function; returns its manifest."""
    (batch,) = export.symbolic_shape("batch")
    inputs = {"time": shape_of(()), "path": shape_of((batch, 3, 2)), "touching": shape_of((2,), bool)}
    exported = {"formula": ExportedFunction(formula, inputs, 500.0, "Twice the time and the row.")}
    return write_policy(folder, navigator, exported, {"policy": "formula"})

"""`load_planner`: the shipped networks are those of the file, a run's are those of its newest checkpoint."""

import jax
import numpy as np
import pytest

from iwalker_jax.api import load_planner
from iwalker_jax.errors import CheckpointError
from iwalker_jax.planning import IPathConfig, PlannerConfig
from iwalker_jax.training import CheckpointStore, TrainConfig, initial_state, make_optimiser, make_planner
from iwalker_jax.training import load_planner as load_planner_file


def parameters(planner) -> list[np.ndarray]:
    return [np.asarray(leaf) for leaf in jax.tree.leaves(planner)]


def test_the_shipped_planner_is_that_of_its_file():
    shipped = load_planner()
    for ours, theirs in zip(parameters(shipped), parameters(load_planner_file()[0]), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_runs_planner_is_that_of_its_checkpoint(tmp_path):
    config = TrainConfig(planner=PlannerConfig(ipath=IPathConfig(trunk_width=4, hidden=16)), seed=3)
    state = initial_state(config, make_optimiser(config, 1))
    CheckpointStore(tmp_path / "checkpoints").save(state, config, 1)
    loaded = load_planner(str(tmp_path))
    assert loaded.config == config.planner
    for ours, theirs in zip(parameters(loaded), parameters(make_planner(config)), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(CheckpointError):
        load_planner(tmp_path / "nothing")

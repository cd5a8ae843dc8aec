"""A small data set and configuration shared by the training tests."""

import dataclasses

import numpy as np
import pytest

from iwalker_jax.data.from_scenes import generate_training_frames
from iwalker_jax.data.path_sampling import CameraPathSampling
from iwalker_jax.data.sources import DataConfig
from iwalker_jax.planning.ipath import IPathConfig
from iwalker_jax.planning.planner import PlannerConfig
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.maps import prepare

SMALL = TrainConfig(
    source=DataConfig(frames=8),
    planner=PlannerConfig(ipath=IPathConfig(trunk_width=4, hidden=16)),
    batch_size=4,
    epochs=3,
    checkpoint_every=2,
)


@pytest.fixture(scope="session")
def small_config() -> TrainConfig:
    """A network that compiles and runs in seconds."""
    return SMALL


@pytest.fixture(scope="session")
def small_frames():
    """Eight frames of two families."""
    sampling = CameraPathSampling(frames_per_path=4, goals_per_frame=3)
    return generate_training_frames(8, seed=5, families=("lobby", "open_office"), sampling=sampling)


@pytest.fixture(scope="session")
def small_data(small_frames):
    """The frames with their maps."""
    return prepare(small_frames, SMALL.models.traversal, batch=8)


@pytest.fixture(scope="session")
def config_with(small_config):
    """Copy of the small configuration with changes."""
    return lambda **changes: dataclasses.replace(small_config, **changes)


def assert_trees_equal(first, second) -> None:
    """Every leaf equal bit for bit."""
    import jax

    for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True):
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))

"""One BRUCE and its controller for all control tests."""

import pytest

from iwalker_jax.control.controller import make_controller
from iwalker_jax.robot import load_robot_model


@pytest.fixture(scope="session")
def bruce(bruce_mujoco):
    return load_robot_model(bruce_mujoco)


@pytest.fixture(scope="session")
def controller(bruce):
    return make_controller(bruce)

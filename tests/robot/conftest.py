"""BRUCE in both engines and both precisions, loaded once."""

import jax
import mujoco
import numpy as np
import pytest

import bruce_model
from iwalker_jax.robot.model import RobotModel, load_robot_model


@pytest.fixture(scope="session")
def bruce() -> mujoco.MjModel:
    """The C model, with a contact solver that converges to rounding."""
    model = bruce_model.load_mujoco()
    model.opt.iterations, model.opt.ls_iterations, model.opt.tolerance = 100, 100, 0.0
    return model


@pytest.fixture(scope="session")
def robot(bruce) -> RobotModel:
    """In single precision."""
    return load_robot_model(bruce)


@pytest.fixture(scope="session")
def robot64(bruce) -> RobotModel:
    """In double precision."""
    with jax.enable_x64(True):
        return load_robot_model(bruce)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)

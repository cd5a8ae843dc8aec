"""The compiled robot, shared by this room's tests."""

import mujoco
import pytest

from bruce_model import load_mujoco


@pytest.fixture(scope="session")
def model() -> mujoco.MjModel:
    """The robot on its floor with default options."""
    return load_mujoco()

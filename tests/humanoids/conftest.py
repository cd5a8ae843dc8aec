import mujoco
import numpy as np
import pytest

from iwalker_jax.humanoids import RobotDescription, build_model, load_robot


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture(scope="package")
def g1() -> RobotDescription:
    return load_robot("g1")


@pytest.fixture(scope="package")
def g1_model(g1) -> mujoco.MjModel:
    return build_model(g1)


@pytest.fixture(scope="package")
def g1_as_it_is(g1) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(g1.mjcf))


@pytest.fixture
def g1_original(g1, g1_as_it_is) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The robot's own model, compiled by MuJoCo as it is, in the standing pose of the description."""
    model = g1_as_it_is
    data = mujoco.MjData(model)
    for joint, angle in g1.anatomy.standing.items():
        data.qpos[model.joint(joint).qposadr[0]] = angle
    return model, data

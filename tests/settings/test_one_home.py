"""What a planner was trained with reaches everything that uses it; what cannot be combined is refused."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from iwalker_jax.commands import train as train_command
from iwalker_jax.data.frame_set import FrameSet
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.frames.sequences import evaluate_sequence
from iwalker_jax.navigation.navigators import make_navigator
from iwalker_jax.optimization import HlipParameters, StepMpcWeights
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.planning.ipath import IPathConfig
from iwalker_jax.planning.models import PlannerModels
from iwalker_jax.planning.planner import Planner, PlannerConfig
from iwalker_jax.planning.robot_state import RobotState, StepGeometry
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.whole_body_losses import load_controlled_robot, swing_instants
from tests.evaluation.frame_results import make_sequence

OTHER = PlannerConfig(
    ipath=IPathConfig(trunk_width=4, hidden=8, camera=dataclasses.replace(Intrinsics(), fx=100.0, fy=100.0)),
    steps=StepGeometry(length=0.06, width=0.12, count=12),
    hlip=HlipParameters(single_support_time=0.3, com_height=0.355),
    step_weights=StepMpcWeights(orbit_position=30.0),
)
"""Nothing about it is the default."""


@pytest.fixture(scope="module")
def planner() -> Planner:
    return Planner(OTHER, nnx.Rngs(0))


@pytest.mark.parametrize("policy", ["default", "published"])
def test_a_navigator_walks_and_sees_as_its_planner_was_trained(planner, policy):
    """Oracle: the planner's own configuration, and sqrt(g / z0)."""
    navigator = make_navigator(policy, planner)
    controller = navigator.walker.controller
    assert navigator.intrinsics == OTHER.ipath.camera
    assert controller.gait.hlip == OTHER.hlip and controller.gait.mpc == OTHER.step_weights
    assert float(controller.gains.rate) == pytest.approx(np.sqrt(9.81 / 0.355), rel=1e-6)


def test_whole_body_losses_judge_steps_of_the_configured_time():
    """Oracle: the pendulum at mid-stance moves farther in a longer step, p cosh(lambda t) with p at touchdown."""
    state = RobotState(jnp.asarray([0.0, -0.05]), jnp.zeros(2), jnp.ones(()), jnp.zeros(()))
    robot = load_controlled_robot(OTHER)
    assert robot.controller.gait.hlip == OTHER.hlip and robot.controller.gait.mpc == OTHER.step_weights
    com = swing_instants(robot, jnp.tile(jnp.asarray([0.0, -0.1]), (6, 1)), state, 0.1).com[:2, 1]
    rate = np.sqrt(9.81 / 0.355)
    np.testing.assert_allclose(com, -0.05 * np.cosh(rate * 0.3 * np.asarray([0.25, 0.75])), rtol=1e-5)


def test_training_frames_are_asked_for_through_the_planners_camera(monkeypatch, small_frames_of):
    asked = []

    def load(source, camera, **_):
        asked.append(camera)
        return small_frames_of(camera)

    monkeypatch.setattr(train_command, "load_training_frames", load)
    config = dataclasses.replace(TrainConfig(), planner=OTHER)
    data = train_command.prepare_data(config)
    assert asked == [OTHER.ipath.camera]
    default = train_command.prepare_data(TrainConfig())
    assert not np.array_equal(np.asarray(data.esdf), np.asarray(default.esdf))


@pytest.fixture
def small_frames_of():
    """Two frames of a wall, seen through any camera of the default size."""

    def frames(camera: Intrinsics) -> FrameSet:
        depth = np.full((2, 90, 160), 2000, np.uint16)
        mounts = np.tile(np.float32([0.58, 0.26, 0.0, 0.028, 0.0]), (2, 1))
        return FrameSet(
            depth, mounts, np.ones((2, 1, 2), np.float32), mounts[:, :3], np.zeros(2, np.int32), ("wall",), camera
        )

    return frames


def test_frames_of_another_camera_are_not_evaluated(planner):
    with pytest.raises(InputError, match=r"seen through .*fx=80\.0.* but the planner's camera is .*fx=100\.0"):
        evaluate_sequence(planner, PlannerModels(), make_sequence())


def test_a_gait_without_double_support_refuses_a_pendulum_that_has_it():
    hlip = HlipParameters(double_support_time=0.05)
    with pytest.raises(InputError, match="double_support_time of 0"):
        make_navigator("default", Planner(dataclasses.replace(OTHER, hlip=hlip), nnx.Rngs(0)))


def test_a_planner_configuration_is_hashable():
    """Programs take it as a static argument."""
    assert len({OTHER, PlannerConfig(), PlannerConfig()}) == 2
    assert jax.tree.leaves(OTHER) == [OTHER]

"""The planner for one frame. Oracles: the batched planner's rows, and the side on which each footstep lies."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import Side
from iwalker_jax.optimization import HlipParameters
from iwalker_jax.perception.camera import CameraMount
from iwalker_jax.planning.ipath import IPathConfig
from iwalker_jax.planning.planner import PATH_POINTS, Planner, PlannerConfig
from iwalker_jax.planning.robot_state import StepGeometry, next_foot, sample_robot_state, standing_state
from iwalker_jax.planning.split_module import split_module

SIZE = (90, 160)


@pytest.fixture(scope="module")
def planner() -> Planner:
    """The light network, small."""
    return Planner(PlannerConfig(ipath=IPathConfig(trunk_width=4, hidden=16)), nnx.Rngs(0))


@pytest.fixture(scope="module")
def frames():
    depth = np.random.default_rng(0).uniform(0.5, 5.0, (3, *SIZE)).astype(np.float32)
    return depth, np.array([[2.0, 0.5], [1.0, -1.0], [-3.0, 0.2]], np.float32)


def row_of(tree, row):
    return jax.tree.map(lambda leaf: leaf[row], tree)


def assert_same_plan(one, other, atol=1e-5):
    for name, value in one._asdict().items():
        np.testing.assert_allclose(value, getattr(other, name), atol=atol, err_msg=name)


def test_one_frame_is_a_row_of_a_batch(planner, frames):
    depth, goal = frames
    keys = jax.random.split(jax.random.key(4), 3)
    state = jax.vmap(lambda key: sample_robot_state(key, StepGeometry(), HlipParameters()))(keys)
    mount = np.array([[0.58, 0.26, 0.0, 0.03, 0.0], [0.6, 0.2, 0.1, 0.0, 0.0], [0.5, 0.3, -0.1, 0.0, 0.02]], np.float32)
    batch = planner(depth, goal, state, mount)
    for row in range(3):
        single = planner(depth[row], goal[row], row_of(state, row), mount[row])
        assert single.path.shape == (PATH_POINTS, 2) and single.footsteps.shape == (StepGeometry().count, 2)
        assert single.waypoints.shape == (5, 2) and single.fear.shape == () and single.first_swing.shape == ()
        assert_same_plan(single, row_of(batch, row))


def test_left_out_state_and_mount_are_a_standing_robot_and_the_nominal_mount(planner, frames):
    depth, goal = frames[0][0], frames[1][0]
    wanted = planner(depth, goal, standing_state(StepGeometry()), CameraMount())
    short = planner(depth, goal)
    assert_same_plan(short, wanted, atol=0)
    assert_same_plan(short, row_of(planner(*frames), 0))


def test_a_standing_robot_has_its_com_midway_and_steps_with_the_left_foot_first(planner, frames):
    """Oracle: left feet stand at +width/2 of a path, and the right foot's stance side is -1."""
    state = standing_state(StepGeometry(width=0.12))
    np.testing.assert_allclose(-state.com_from_stance, [0.0, -0.06], atol=1e-7)
    assert int(next_foot(state)) == Side.LEFT and int(next_foot(state.mirrored())) == Side.RIGHT
    plan = planner(frames[0][0], (3.0, 0.0))
    assert int(plan.first_swing) == Side.LEFT
    to_left = np.asarray(plan.footsteps[:-1] - plan.footsteps[1:])
    heading = np.asarray(plan.path[-1] - plan.path[0])
    lateral = heading[0] * to_left[:, 1] - heading[1] * to_left[:, 0]
    assert lateral[0] > 0 and (lateral[::2] > 0).mean() > 0.8


def test_lists_and_numpy_arrays_do(planner, frames):
    depth, goal = frames[0][1], [1, -1]
    plan = planner(depth.tolist(), goal, mount=[0.58, 0.26, 0, 0.028, 0])
    assert_same_plan(plan, row_of(planner(jnp.asarray(frames[0]), jnp.asarray(frames[1])), 1))


def test_a_single_frame_passes_through_jit_vmap_and_grad(planner, frames):
    network = split_module(planner)
    plans = jax.jit(jax.vmap(lambda network, depth, goal: network.merge()(depth, goal), in_axes=(None, 0, 0)))
    batch = planner(*frames)
    assert_same_plan(plans(network, *frames), batch)
    slope = jax.grad(lambda goal: planner(frames[0][0], goal).path[-1, 0])(jnp.asarray([2.0, 0.5]))
    assert np.isfinite(slope).all() and float(jnp.abs(slope).max()) > 0


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"depth": np.full(SIZE, 1500.0)}, "millimetres"),
        ({"depth": np.full(SIZE, 1500, np.uint16)}, "floating-point metres"),
        ({"depth": np.ones((160, 90))}, "resize_depth"),
        ({"depth": np.ones(160)}, "depth of shape"),
        ({"depth": np.ones((1, 1, *SIZE))}, "depth of shape"),
        ({"goal": [1.0, 2.0, 3.0]}, "The goal for depth"),
        ({"goal": [[1.0, 2.0]]}, "The goal for depth"),
        ({"mount": [0.6, 0.2]}, "The mount for depth"),
        ({"mount": [0.6, 15.0, 0.0, 0.0, 0.0]}, "pitch is 15"),
        ({"mount": [580.0, 0.2, 0.0, 0.0, 0.0]}, "height is 580"),
        ({"state": standing_state(StepGeometry())._replace(stance_sign=jnp.ones(2))}, "stance_sign has shape"),
    ],
)
def test_bad_input_is_one_sentence(planner, changes, sentence, unchecked_types):
    with pytest.raises(InputError, match=sentence):
        planner(**({"depth": np.ones(SIZE), "goal": [1.0, 0.0]} | changes))

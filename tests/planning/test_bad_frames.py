"""Bad depth frames and goals at the library's doors: finite maps and plans, or one clear sentence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from iwalker_jax.errors import InputError
from iwalker_jax.optimization import HlipParameters
from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.perception.local_map import build_local_map
from iwalker_jax.planning.ipath import IPathConfig
from iwalker_jax.planning.planner import Planner, PlannerConfig
from iwalker_jax.planning.robot_state import StepGeometry, sample_robot_state

SIZE = (90, 160)


def wall(distance: float) -> np.ndarray:
    return np.full(SIZE, distance, np.float32)


def speckled(value: float) -> np.ndarray:
    """A wall at 2 m in which every seventh pixel has another value."""
    image = wall(2.0)
    image.ravel()[::7] = value
    return image


FRAMES = {
    "empty": wall(0.0),
    "all NaN": wall(np.nan),
    "all inf": wall(np.inf),
    "all -inf": wall(-np.inf),
    "all negative": wall(-1.0),
    "all blocked": wall(0.2),
    "touching the lens": wall(1e-6),
    "denormal": wall(1e-40),
    "far beyond the sensor": wall(1e30),
    "NaN speckles": speckled(np.nan),
    "inf speckles": speckled(np.inf),
    "negative speckles": speckled(-3.0),
    "zero speckles": speckled(0.0),
    "half NaN": np.where(np.arange(160) < 80, np.nan, 3.0) * np.ones(SIZE, np.float32),
}
GOALS = {
    "ahead": (3.0, 0.5),
    "behind": (-2.0, 0.3),
    "at the feet": (0.0, 0.0),
    "100 m away": (100.0, -20.0),
    "astronomically far": (1e30, 1e30),
    "NaN": (np.nan, 1.0),
    "inf": (np.inf, -np.inf),
}


@pytest.fixture(scope="module")
def images() -> np.ndarray:
    return np.stack([image.astype(np.float32) for image in FRAMES.values()])


@pytest.fixture(scope="module")
def maps(images):
    mount = CameraMount().as_array()
    return jax.jit(jax.vmap(lambda depth: build_local_map(depth, mount, Intrinsics())))(images)


def make_planner(variant: str) -> Planner:
    return Planner(PlannerConfig(ipath=IPathConfig(variant=variant, trunk_width=4, hidden=16)), nnx.Rngs(0))


@pytest.fixture(scope="module")
def planner() -> Planner:
    return make_planner("light")


@pytest.fixture(scope="module")
def plan(planner):
    """The compiled planner for a batch of as many frames as there are bad ones."""
    compiled = jax.jit(lambda depth, goal, state: planner(depth, goal, state))

    def run(depth, goal):
        keys = jax.random.split(jax.random.key(0), len(depth))
        state = jax.vmap(lambda key: sample_robot_state(key, StepGeometry(), HlipParameters()))(keys)
        return compiled(jnp.asarray(depth), jnp.asarray(goal, jnp.float32), state)

    return run


@pytest.mark.parametrize("name", FRAMES)
def test_every_bad_frame_gives_valid_maps(maps, name):
    row = list(FRAMES).index(name)
    local = jax.tree.map(lambda x: np.asarray(x[row]), maps)
    assert (local.occupied.astype(int) + local.known_free + local.unknown == 1).all()
    assert np.isfinite(local.esdf).all() and np.isfinite(local.published).all()
    assert (local.published >= 0).all()


@pytest.mark.parametrize("name", ["empty", "all NaN", "all inf", "all -inf", "all negative", "far beyond the sensor"])
def test_frames_without_returns_are_unknown_but_for_the_feet(maps, name):
    """Property: nothing seen means nothing occupied, and nothing free beyond the disc under the robot."""
    row = list(FRAMES).index(name)
    assert not maps.occupied[row].any()
    assert 0 < int(maps.known_free[row].sum()) < 0.6**2 * np.pi / 0.05**2
    np.testing.assert_array_equal(maps.known_free[row], maps.known_free[list(FRAMES).index("empty")])


def test_invalid_pixels_mean_the_same_whatever_they_hold(maps):
    """Property: NaN, inf, negative and zero pixels all are `no return`."""
    rows = [list(FRAMES).index(f"{kind} speckles") for kind in ("NaN", "inf", "negative", "zero")]
    for field in maps:
        for row in rows[1:]:
            np.testing.assert_array_equal(field[rows[0]], field[row])
    assert maps.occupied[rows[0]].any()


def test_every_bad_frame_gives_a_finite_plan(plan, images):
    outcome = plan(images, np.tile([3.0, 0.5], (len(images), 1)))
    for name, value in outcome._asdict().items():
        finite = np.isfinite(value).reshape(len(images), -1).all(axis=1)
        assert finite.all(), f"{name}: {[frame for frame, ok in zip(FRAMES, finite) if not ok]}"
    rows = [list(FRAMES).index(f"{kind} speckles") for kind in ("NaN", "inf", "negative", "zero")]
    for row in rows[1:]:
        np.testing.assert_allclose(outcome.path[row], outcome.path[rows[0]], atol=1e-5)


def test_the_published_network_takes_every_bad_frame_too(images):
    """Its input is the bare image, so that invalid pixels must be gone before."""
    planner = make_planner("paper")
    outcome = jax.jit(lambda depth, goal: planner.plan_path(depth, goal))(
        images, jnp.tile(jnp.asarray([3.0, 0.5]), (len(images), 1))
    )
    for value in outcome:
        assert np.isfinite(value).all()


def test_every_goal_gives_a_finite_plan(plan, images):
    goals = np.resize(np.array(list(GOALS.values())), (len(images), 2))
    outcome = plan(np.tile(wall(3.0), (len(images), 1, 1)), goals)
    for value in outcome:
        assert np.isfinite(value).all()
    assert np.abs(outcome.path).max() < 50.0


def test_raw_sensor_units_are_one_sentence(planner, unchecked_types):
    """uint16 millimetres read as metres would be a room of kilometres."""
    raw = np.full(SIZE, 1500, np.uint16)
    with pytest.raises(InputError, match="floating-point metres"):
        build_local_map(jnp.asarray(raw), CameraMount().as_array(), Intrinsics())
    with pytest.raises(InputError, match="floating-point metres"):
        planner.plan_path(jnp.asarray(raw)[None], jnp.zeros((1, 2)))


@pytest.mark.parametrize("shape", [(90, 160), (1, 160, 90), (2, 90, 160)])
def test_a_wrong_image_size_or_batch_is_one_sentence(planner, shape, unchecked_types):
    with pytest.raises(InputError, match="depth"):
        planner.plan_path(jnp.ones(shape), jnp.zeros((1, 2)))


def test_goals_of_a_wrong_shape_are_one_sentence(planner, unchecked_types):
    with pytest.raises(InputError, match="goal"):
        planner.plan_path(jnp.ones((1, *SIZE)), jnp.zeros((1, 3)))

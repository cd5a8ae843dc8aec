"""iPath: published size, both variants' shapes, goals of every kind, and batch rows that ignore their neighbours."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.planning.ipath import IPath, IPathConfig, evenly_spaced, reduced_goal
from iwalker_jax.planning.residual_network import conv2d, max_pool_3x3
from tests.gradients import assert_gradients_agree

LIGHT = IPathConfig()


@pytest.fixture(scope="module")
def light():
    return functools.partial(nnx.jit(IPath.__call__), IPath(LIGHT, nnx.Rngs(0)))


def _count(config: IPathConfig) -> int:
    shapes = nnx.state(nnx.eval_shape(lambda: IPath(config, nnx.Rngs(0))), nnx.Param)
    return sum(int(np.prod(leaf.shape)) for leaf in jax.tree.leaves(shapes))


def test_paper_network_has_the_published_number_of_parameters():
    """Oracle: 53.3 M parameters at 360 x 640, 33.6 M of them in the first fully connected layer."""
    config = IPathConfig.published()
    assert _count(config) == pytest.approx(53.3e6, rel=2e-3)
    network = nnx.eval_shape(lambda: IPath(config, nnx.Rngs(0)))
    assert np.prod(network.head.dense1.kernel.shape) == pytest.approx(33.6e6, rel=2e-3)


def test_light_network_is_an_order_of_magnitude_smaller():
    assert _count(LIGHT) < 2e6


@pytest.mark.parametrize("config", [LIGHT, IPathConfig(variant="paper", trunk_width=8, goal_is_end=True, even=False)])
def test_output_shapes_and_published_end(config):
    network = IPath(config, nnx.Rngs(1))
    goal = jnp.asarray([[2.0, 1.0], [0.0, 0.0]])
    out = network(jnp.full((2, 90, 160), 2.0), goal)
    assert out.waypoints.shape == (2, 5, 2)
    assert out.fear.shape == (2,)
    assert np.isfinite(out.waypoints).all()
    if config.goal_is_end:
        np.testing.assert_allclose(out.waypoints[:, -1], goal)


@pytest.mark.parametrize("config", [LIGHT, IPathConfig(variant="paper", trunk_width=8)])
def test_a_mirrored_frame_gets_the_mirrored_plan(config):
    """Oracle: the image from right to left, the goal and the camera's mount on the other side, and the plan too."""
    network = nnx.jit(IPath.__call__)
    ipath = IPath(config, nnx.Rngs(2))
    depth = jax.random.uniform(jax.random.key(3), (2, 90, 160), maxval=5.0) * (jnp.arange(160) < 110)
    goal = jnp.asarray([[2.0, 1.0], [3.0, -0.5]])
    mount = jnp.asarray([[0.6, 0.3, 0.1, 0.05, 0.02], [0.5, 0.2, -0.05, 0.0, 0.1]])
    plan = network(ipath, depth, goal, mount)
    sides = jnp.asarray([1.0, -1.0])
    other = network(ipath, depth[:, :, ::-1], goal * sides, mount * jnp.asarray([1.0, 1.0, -1.0, 1.0, -1.0]))
    np.testing.assert_allclose(other.waypoints, plan.waypoints * sides, atol=1e-4)
    np.testing.assert_allclose(other.fear, plan.fear, atol=1e-4)
    assert float(jnp.abs(plan.waypoints[..., 1]).max()) > 1e-3  # nothing that is symmetric by being zero


def test_even_waypoints_keep_directions_and_mean_interval():
    """Oracle: NumPy, interval by interval."""
    waypoints = np.array([[0.4, 0.1], [0.5, 0.1], [1.2, -0.5], [1.3, 0.6], [1.0, 0.6]])
    intervals = np.diff(waypoints, axis=0, prepend=0.0)
    lengths = np.hypot(*intervals.T)
    wanted = np.cumsum(intervals / lengths[:, None] * lengths.mean(), axis=0)
    even = evenly_spaced(jnp.asarray(waypoints, jnp.float32))
    np.testing.assert_allclose(even, wanted, atol=1e-4)
    np.testing.assert_allclose(evenly_spaced(even), even, atol=1e-4)


def test_even_waypoints_have_the_gradient_of_finite_differences(x64):
    waypoints = jnp.asarray(np.random.default_rng(3).normal(size=(2, 5, 2)))
    assert_gradients_agree(jax.jit(evenly_spaced), waypoints)


def test_even_waypoints_may_stand_still():
    value, gradient = jax.value_and_grad(lambda w: jnp.sum(evenly_spaced(w)))(jnp.zeros((5, 2)))
    assert float(value) == 0.0
    assert np.isfinite(gradient).all()


def test_the_default_network_plans_even_waypoints(light):
    depth = jax.random.uniform(jax.random.key(1), (3, 90, 160), maxval=5.0)
    out = light(depth, jnp.asarray([[2.0, 0.0], [1.0, 1.0], [3.0, -1.0]]))
    lengths = np.linalg.norm(np.diff(out.waypoints, axis=1, prepend=0.0), axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(lengths[:, :1], lengths.shape), rtol=1e-4)


def test_rows_do_not_depend_on_their_neighbours(light):
    depth = jax.random.uniform(jax.random.key(0), (3, 90, 160), maxval=5.0)
    goal = jnp.asarray([[2.0, 0.0], [1.0, 1.0], [3.0, -1.0]])
    together = light(depth, goal).waypoints
    changed = light(depth.at[1:].set(0.0), goal).waypoints
    np.testing.assert_allclose(together[0], changed[0], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("goal", [(0.0, 0.0), (-3.0, 0.5), (100.0, 0.0), (1e30, 1e30), (np.nan, 1.0), (np.inf, 0.0)])
def test_any_goal_gives_a_finite_path(light, goal):
    out = light(jnp.zeros((1, 90, 160)), jnp.asarray([goal]))
    assert np.isfinite(out.waypoints).all()
    assert np.isfinite(out.fear).all()


def test_far_goals_keep_their_bearing():
    goal = reduced_goal(jnp.asarray([300.0, -400.0]), 6.0)
    np.testing.assert_allclose(goal, [3.6, -4.8], rtol=1e-5)
    np.testing.assert_allclose(reduced_goal(jnp.asarray([1.0, 2.0]), 6.0), [1.0, 2.0], rtol=1e-6)


def test_max_pool_equals_numpy_windows():
    """Oracle: the maximum over explicit 3 x 3 windows of a padded array."""
    x = np.random.default_rng(0).normal(size=(1, 7, 10, 2)).astype(np.float32)
    padded = np.pad(x, ((0, 0), (1, 1), (1, 1), (0, 0)), constant_values=-np.inf)
    expected = np.stack(
        [[padded[0, 2 * i : 2 * i + 3, 2 * j : 2 * j + 3].max(axis=(0, 1)) for j in range(5)] for i in range(4)]
    )
    np.testing.assert_array_equal(max_pool_3x3(jnp.asarray(x))[0], expected)


def test_convolution_equals_a_direct_sum():
    """Oracle: NumPy loops over the kernel."""
    rng = np.random.default_rng(1)
    x, kernel = rng.normal(size=(1, 6, 8, 3)), rng.normal(size=(3, 3, 3, 4))
    padded = np.pad(x, ((0, 0), (1, 1), (1, 1), (0, 0)))
    expected = sum(padded[:, i : i + 5 : 2, j : j + 7 : 2] @ kernel[i, j] for i in range(3) for j in range(3))
    got = conv2d(jnp.asarray(x, jnp.float32), jnp.asarray(kernel, jnp.float32), 2, 1)
    np.testing.assert_allclose(got, expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"variant": "huge"}, "variant"),
        ({"camera": Intrinsics(160, 32)}, "64 x 96"),
        ({"waypoints": 1}, "waypoints"),
        ({"goal_is_end": True}, "even"),
    ],
)
def test_impossible_configurations_are_refused_in_one_sentence(change, word, unchecked_types):
    with pytest.raises(InputError, match=word):
        IPathConfig(**change)

"""Losses: gradient routing, finite differences through both optima, and what each term asks for."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.optimization import HlipParameters
from iwalker_jax.perception.grid import DEFAULT_GRID, PUBLISHED_GRID
from iwalker_jax.perception.seen_route import ROUTE_GRID
from iwalker_jax.planning.footsteps import nominal_footsteps
from iwalker_jax.planning.models import PlannerModels
from iwalker_jax.planning.planner import PlannerConfig, waypoints_to_path
from iwalker_jax.planning.robot_state import sample_robot_state
from iwalker_jax.planning.split_module import split_module
from iwalker_jax.training.batches import gather_batch
from iwalker_jax.training.losses import LossWeights, overlap, path_losses, step_losses, weighted_sum
from iwalker_jax.training.maps import FrameMaps
from iwalker_jax.training.objectives import batch_losses
from iwalker_jax.training.train_step import make_planner
from tests.gradients import assert_gradients_agree

PLANNER, MODELS = PlannerConfig(), PlannerModels()


def _smooth_maps(dtype=jnp.float64) -> FrameMaps:
    """An obstacle at (1.2, 0.3) as smooth fields, so that finite differences meet no kink."""
    fine, coarse = DEFAULT_GRID.centres().astype(dtype), ROUTE_GRID.centres().astype(dtype)
    esdf = jnp.sqrt(jnp.sum((fine - jnp.asarray([1.2, 0.3])) ** 2, axis=-1) + 0.01) - 0.2
    unknown = jax.nn.sigmoid(4.0 * (coarse[..., 0] - 2.0))
    to_go = jnp.sqrt(jnp.sum((coarse - jnp.asarray([2.5, -0.2])) ** 2, axis=-1) + 0.01)
    route = jnp.stack([jnp.linspace(0, 2.5, 50), -0.3 * jnp.sin(jnp.linspace(0, np.pi, 50))], axis=1).astype(dtype)
    published = jnp.exp(-jnp.sum((PUBLISHED_GRID.centres() - jnp.asarray([1.2, 0.3])) ** 2, axis=-1))
    return FrameMaps(esdf, unknown, to_go, route, published.astype(dtype))


def _waypoints() -> jax.Array:
    return jnp.asarray([[0.5, 0.06], [0.95, -0.1], [1.5, -0.31], [1.9, -0.25], [2.3, -0.12]])


@pytest.mark.parametrize("gradient", ["implicit", "unrolled"])
def test_u_path_gradient_equals_finite_differences(x64, gradient):
    """Oracle: central differences of the whole of U_path, unicycle optimum included."""
    maps = _smooth_maps()
    models = dataclasses.replace(MODELS, unicycle=dataclasses.replace(MODELS.unicycle, tolerance=1e-9))

    def loss(waypoints, fear):
        path = waypoints_to_path(waypoints[None])[0]
        return weighted_sum(path_losses(path, fear, maps, models, gradient), LossWeights())[None]

    assert_gradients_agree(jax.jit(loss), _waypoints(), jnp.asarray(0.3))


def test_u_step_gradient_equals_finite_differences(x64):
    """Oracle: central differences of the whole of U_step, H-LIP optimum included, for footsteps and path."""
    maps = _smooth_maps()
    state = jax.tree.map(
        lambda x: x.astype(jnp.float64), sample_robot_state(jax.random.key(1), PLANNER.steps, HlipParameters())
    )
    path = waypoints_to_path(_waypoints()[None])[0]
    footsteps, _ = nominal_footsteps(path, state.stance_sign, PLANNER.steps)

    def loss(steps, along):
        return weighted_sum(step_losses(steps, along, state, maps, PLANNER, MODELS, "implicit"), LossWeights())[None]

    moved = footsteps + 0.013 * jax.random.normal(jax.random.key(2), footsteps.shape)
    assert_gradients_agree(jax.jit(loss), moved, path)


def test_stopped_mode_leaves_the_gradient_of_the_difference_alone(x64):
    """With phi* constant, d MSE / d path is 2 (path - phi*) / N: the published way."""
    maps = _smooth_maps()
    path = waypoints_to_path(_waypoints()[None])[0]
    only_tracking = LossWeights(tracking=1.0, route=0, arrival=0, regret=0, progress=0, clearance=0, fear=0)

    def loss(p, mode):
        return weighted_sum(path_losses(p, jnp.zeros(()), maps, MODELS, mode), only_tracking)

    stopped, implicit = (
        jax.jit(jax.grad(lambda p, mode=mode: loss(p, mode)))(path) for mode in ("stopped", "implicit")
    )
    assert float(jnp.max(jnp.abs(stopped - implicit))) > 1e-6
    value = loss(path, "stopped")
    assert float(jnp.sum(stopped**2)) == pytest.approx(4 * float(value) / path.shape[0], rel=1e-6)


def _norms(config, data, part: str) -> tuple[float, float]:
    """Gradient norms of U_path or U_step with respect to iPath's and iStepper's parameters."""
    batch = gather_batch(data, jnp.arange(4), jax.random.key(0), True, config.planner)
    loss = jax.grad(lambda network: batch_losses(network.merge(), batch, config)[1][0][part])
    gradient = jax.jit(loss)(split_module(make_planner(config))).params

    def norm(tree):
        return float(sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(tree)))

    return norm(gradient["ipath"]), norm(gradient["istepper"])


def test_u_path_reaches_ipath_alone(small_config, small_data):
    ipath, istepper = _norms(small_config, small_data, "U_path")
    assert ipath > 0
    assert istepper == 0


def test_u_step_reaches_both_unless_switched_off(small_config, small_data):
    ipath, istepper = _norms(small_config, small_data, "U_step")
    assert ipath > 0
    assert istepper > 0
    alone = dataclasses.replace(small_config, weights=LossWeights(step_to_path=False))
    ipath, istepper = _norms(alone, small_data, "U_step")
    assert ipath == 0
    assert istepper > 0


def test_overlap_is_one_at_contact_with_the_axis_and_zero_beyond_the_margin():
    reach = MODELS.traversal.body_radius + MODELS.safety_margin
    np.testing.assert_allclose(overlap(jnp.asarray([0.0, reach, 1.0]), MODELS), [1.0, 0.0, 0.0], atol=1e-6)


def test_walking_around_costs_less_than_walking_through():
    maps = _smooth_maps(jnp.float32)
    around = waypoints_to_path(_waypoints()[None])[0]
    through = jnp.linspace(0, 1, 100)[:, None] * jnp.asarray([[2.4, 0.6]])
    clearance = jax.jit(lambda path: path_losses(path, jnp.zeros(()), maps, MODELS, "stopped").clearance)
    cost = [float(clearance(path)) for path in (around, through)]
    assert cost[0] < 0.5 * cost[1]


def test_negative_weights_are_refused():
    with pytest.raises(InputError, match="not negative"):
        LossWeights(regret=-1.0)

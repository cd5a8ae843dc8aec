"""Traversal cost and the coarse grid: values, order, gradients and the pooling filters."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

from iwalker_jax.errors import InputError
from iwalker_jax.perception.grid import DEFAULT_GRID, GridSpec, halved, pool_2x2, softened
from iwalker_jax.perception.traversal import TraversalParameters, traversal_cost
from tests.gradients import assert_gradients_agree

PARAMETERS = TraversalParameters()


def _cost(clearance: float, unknown: float) -> float:
    """The cost per metre, written with branches instead of clips."""
    cost = 1.0 + PARAMETERS.unknown * unknown
    if clearance < PARAMETERS.body_radius:
        cost += PARAMETERS.discomfort
    elif clearance < PARAMETERS.comfort:
        cost += (
            PARAMETERS.discomfort
            * ((PARAMETERS.comfort - clearance) / (PARAMETERS.comfort - PARAMETERS.body_radius)) ** 2
        )
    depth = PARAMETERS.body_radius + PARAMETERS.contact_ramp / 2 - clearance
    if depth >= PARAMETERS.contact_ramp:
        cost += PARAMETERS.contact
    elif depth > 0:
        t = depth / PARAMETERS.contact_ramp
        cost += PARAMETERS.contact * (3 * t**2 - 2 * t**3)
    return cost


def test_cost_equals_a_rederivation(x64):
    """Oracle: a scalar re-derivation with branches."""
    rng = np.random.default_rng(0)
    clearance, unknown = rng.uniform(-0.3, 1.0, 300), rng.uniform(0.0, 1.0, 300)
    wanted = [_cost(c, u) for c, u in zip(clearance, unknown)]
    np.testing.assert_allclose(
        traversal_cost(jnp.asarray(clearance), jnp.asarray(unknown), PARAMETERS), wanted, rtol=1e-12
    )


def test_landmarks_of_the_cost():
    """Oracle: what the parameters' docstring promises in the open, just fitting, in contact and unseen."""
    clearance = jnp.asarray([5.0, PARAMETERS.comfort, PARAMETERS.body_radius, -1.0, 5.0])
    unknown = jnp.asarray([0.0, 0.0, 0.0, 0.0, 1.0])
    both = 1.0 + PARAMETERS.discomfort
    wanted = [1.0, 1.0, both + PARAMETERS.contact / 2, both + PARAMETERS.contact, 1.0 + PARAMETERS.unknown]
    np.testing.assert_allclose(traversal_cost(clearance, unknown, PARAMETERS), wanted, rtol=1e-6)


def test_less_clearance_never_costs_less():
    """Property: monotone in clearance and in the unknown share, finite even deep inside."""
    cost = np.asarray(traversal_cost(jnp.linspace(-100.0, 2.0, 2001), jnp.zeros(2001), PARAMETERS))
    assert np.isfinite(cost).all() and (np.diff(cost) <= 1e-6).all()
    assert (np.diff(np.asarray(traversal_cost(jnp.full(50, 0.3), jnp.linspace(0.0, 1.0, 50), PARAMETERS))) > 0).all()


def test_cost_gradient_equals_finite_differences(x64):
    """Oracle: central differences, away from the contact ramp's ends where the second derivative jumps."""
    clearance = jnp.asarray([-0.2, 0.09, 0.11, 0.15, 0.25, 0.4, 0.6])
    assert_gradients_agree(lambda c, u: traversal_cost(c, u, PARAMETERS), clearance, jnp.linspace(0.1, 0.9, 7))


def test_pooling_keeps_a_linear_field_on_the_same_ground():
    """Oracle: the mean of a linear function over a block is its value at the block's centre."""

    def field(grid):
        centres = np.asarray(grid.centres())
        return 2.0 + 0.7 * centres[..., 0] - 1.3 * centres[..., 1]

    coarse = halved(DEFAULT_GRID)
    assert (coarse.x_min, coarse.y_min, coarse.resolution) == (-0.8, -4.0, 0.1)
    assert coarse.shape == (80, 80)
    np.testing.assert_allclose(pool_2x2(jnp.asarray(field(DEFAULT_GRID))), field(coarse), atol=1e-5)


def test_odd_rows_and_columns_are_dropped_alike_by_grid_and_field():
    """Oracle: a NumPy loop over blocks."""
    grid = GridSpec(rows=7, columns=5)
    field = np.random.default_rng(1).normal(size=grid.shape)
    pooled = np.asarray(pool_2x2(jnp.asarray(field)))
    assert pooled.shape == halved(grid).shape == (3, 2)
    for i in range(3):
        for j in range(2):
            assert pooled[i, j] == pytest.approx(field[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].mean(), abs=1e-6)


def test_softened_equals_scipys_uniform_filter(x64):
    """Oracle: scipy.ndimage.uniform_filter with repeated borders."""
    field = np.random.default_rng(2).uniform(size=(9, 12))
    wanted = ndimage.uniform_filter(field, 3, mode="nearest")
    np.testing.assert_allclose(softened(jnp.asarray(field)), wanted, rtol=1e-12)


@pytest.mark.parametrize(
    "changes", [{"body_radius": 0.5}, {"body_radius": 0.0}, {"contact_ramp": 0.0}, {"contact": -1.0}, {"unknown": -0.1}]
)
def test_impossible_parameters_are_refused(changes):
    with pytest.raises(InputError, match=r"TraversalParameters|negative"):
        TraversalParameters(**changes)

"""Bounded quadratic programs in the space of the inverse Hessian against SciPy's bounded least squares."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from iwalker_jax.optimization.steps.box_qp import PENALTIES, bound_solver, find_active_bounds

find = jax.jit(
    lambda inverse, operators, free, low, high: find_active_bounds(lambda i: operators[i], inverse, free, low, high)
)


@pytest.mark.parametrize("seed", range(6))
def test_equals_bounded_least_squares(x64, seed):
    """Oracle: scipy.optimize.lsq_linear on the Cholesky factor of H; the multipliers must have the right signs."""
    rng = np.random.default_rng(seed)
    size = 12
    factor = rng.normal(size=(size, size)) + 2 * np.eye(size)
    hessian, free = factor.T @ factor, rng.normal(size=size) * (0.5 + 0.2 * seed)
    low, high = -rng.uniform(0.1, 1, size), rng.uniform(0.1, 1, size)
    inverse = np.linalg.inv(hessian)
    base = 1 / np.mean(np.diag(inverse))
    operators = np.stack([p * base * np.linalg.inv(hessian + p * base * np.eye(size)) for p in PENALTIES])
    found = find(inverse, operators, free, low, high)
    bound = np.where(found.sides > 0, high, low)
    y = bound_solver(jnp.asarray(inverse), found.sides)(jnp.asarray(free - bound))
    expected = lsq_linear(factor, factor @ free, (low, high), method="bvls", tol=1e-14).x
    assert 0 < np.count_nonzero(found.sides) < size
    np.testing.assert_allclose(free - inverse @ y, expected, atol=1e-9)
    assert np.all(y * found.sides >= 0)
    assert np.all((found.within >= low) & (found.within <= high))


def test_inactive_bounds_cost_nothing(x64):
    """Property: if the free optimum satisfies the bounds, no round is spent and no bound is active."""
    found = find(np.eye(3), np.zeros((len(PENALTIES), 3, 3)), np.zeros(3), -np.ones(3), np.ones(3))
    assert found.rounds == 0 and not np.any(found.sides)

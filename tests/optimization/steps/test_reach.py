"""Step bounds and catchable states against linear programs and hand-worked cases."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog

from iwalker_jax.errors import InputError
from iwalker_jax.optimization.steps.reach import (
    StepReach,
    capture_margin,
    heading_axes,
    sanitise_reach,
    step_bounds,
)


def test_bounds_by_hand():
    """Oracle: by hand. On the left foot the right foot moves next, to the right, which is negative y."""
    low, high = step_bounds(StepReach(0.2, 0.04, 0.15), jnp.asarray(1.0), 3)
    np.testing.assert_allclose(low, [[-0.2, -0.15], [-0.2, 0.04], [-0.2, -0.15]], rtol=1e-6)
    np.testing.assert_allclose(high, [[0.2, -0.04], [0.2, 0.15], [0.2, -0.04]], rtol=1e-6)
    other_low, other_high = step_bounds(StepReach(0.2, 0.04, 0.15), jnp.asarray(-1.0), 3)
    np.testing.assert_allclose(other_low[:, 1], -high[:, 1])
    np.testing.assert_allclose(other_high[:, 1], -low[:, 1])
    np.testing.assert_allclose(heading_axes(jnp.asarray([np.pi / 2])), [[[0, 1], [-1, 0]]], atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_capture_margin_equals_linear_program(x64, seed):
    """Oracle: scipy.optimize.linprog stretches the divergent component until no 60 reachable steps catch it."""
    rng = np.random.default_rng(seed)
    pole, horizon, total = rng.uniform(1.5, 4.0), 5, 60
    headings = np.cumsum(rng.normal(0, 0.4, horizon))
    low, high = step_bounds(StepReach(0.2, 0.04, 0.2), jnp.asarray(1.0), total)
    axes = heading_axes(jnp.asarray(headings))
    direction = rng.normal(size=2) * 0.1
    ratio, centre = capture_margin(jnp.asarray(pole), axes, low[:horizon], high[:horizon], jnp.asarray(direction))
    turned = np.asarray(heading_axes(jnp.asarray(np.concatenate([headings, np.full(total - horizon, headings[-1])]))))
    columns = np.concatenate([pole**-k * turned[k].T for k in range(total)], axis=1)
    ray = direction - np.asarray(centre)
    bounds = [*zip(np.ravel(low), np.ravel(high)), (0, None)]
    result = linprog(
        np.append(np.zeros(2 * total), -1.0), A_eq=np.column_stack([columns, -ray]), b_eq=centre, bounds=bounds
    )
    np.testing.assert_allclose(ratio, 1 / result.x[-1], rtol=1e-6)


@pytest.mark.parametrize(
    ("limits", "finite", "empty"),
    [
        ((0.2, 0.04, 0.2), True, False),
        ((0.2, 0.1, 0.05), True, True),
        ((-0.1, 0.04, 0.2), True, True),
        ((0.2, np.nan, 0.2), False, False),
    ],
)
def test_contradicting_bounds_are_told(limits, finite, empty):
    """Oracle: by hand; the bounds returned always leave a millimetre, and good ones are untouched."""
    reach, was_finite, was_empty = sanitise_reach(StepReach(*jnp.asarray(limits)), jnp.float32)
    assert (bool(was_finite), bool(was_empty)) == (finite, empty)
    assert reach.sagittal >= 0.999e-3 and reach.lateral_max - reach.lateral_min > 0.99e-3
    if finite and not empty:
        np.testing.assert_allclose([reach.sagittal, reach.lateral_min, reach.lateral_max], limits, rtol=1e-6)
    if limits[1] > limits[2]:
        np.testing.assert_allclose((reach.lateral_min + reach.lateral_max) / 2, 0.075, rtol=1e-5)


@pytest.mark.parametrize(
    ("fields", "match"), [({"sagittal": -1.0}, "sagittal"), ({"lateral_min": 0.3}, "below lateral_max")]
)
def test_bad_reach_is_refused(fields, match):
    """The message names the field."""
    with pytest.raises(InputError, match=match):
        StepReach(**fields)

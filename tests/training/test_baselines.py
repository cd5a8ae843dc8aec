"""Heuristic losses of the baseline against a NumPy re-derivation."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from iwalker_jax.perception.grid import PUBLISHED_GRID
from iwalker_jax.planning.planner import waypoints_to_path
from iwalker_jax.training.baselines import HeuristicWeights, heuristic_losses, heuristic_sum
from iwalker_jax.training.maps import FrameMaps
from tests.gradients import assert_gradients_agree

AXES = [low + (np.arange(100) + 0.5) * 0.1 for low in (PUBLISHED_GRID.x_min, PUBLISHED_GRID.y_min)]
PUBLISHED = np.exp(-((AXES[0][:, None] - 1.6) ** 2 + (AXES[1] - 0.2) ** 2) / 0.3)
WAYPOINTS = np.array([[0.5, 0.1], [1.05, 0.0], [1.5, 0.3], [2.2, 0.4], [2.6, -0.1]])
GOAL = np.array([3.0, 0.5])


def maps() -> FrameMaps:
    """Only the published map matters to these losses."""
    unused = jnp.zeros((2, 2))
    return FrameMaps(unused, unused, unused, unused, jnp.asarray(PUBLISHED))


def path(waypoints=WAYPOINTS):
    return waypoints_to_path(jnp.asarray(waypoints)[None])[0]


score = jax.jit(heuristic_losses)


def rederived(points: np.ndarray, fear: float, goal: np.ndarray) -> dict[str, float]:
    """The four terms from their definitions over every second point, with SciPy's bilinear interpolation."""
    end, points = points[-1], points[::2]
    inside = np.clip(points, [axis[0] for axis in AXES], [axis[-1] for axis in AXES])
    cost = RegularGridInterpolator(AXES, PUBLISHED)(inside)
    steps = [np.hypot(*(b - a)) for a, b in itertools.pairwise(points)]
    walked, danger = 0.0, False
    for k, value in enumerate(cost):
        walked += np.hypot(*(points[k] - points[k - 1])) if k else 0.0
        danger |= walked < 2.0 and value > 0.5
    probability = 1.0 / (1.0 + np.exp(-fear))
    return {
        "obstacle": float(np.sum(cost)),
        "motion": sum(abs(np.hypot(*goal) / len(steps) - step) for step in steps),
        "goal": float(np.log(1.0 + np.hypot(*(goal - end)))),
        "fear": float(-np.log(probability if danger else 1.0 - probability)),
    }


@pytest.mark.parametrize("shift", [0.0, 1.5])
@pytest.mark.parametrize("fear", [-2.0, 0.7])
def test_terms_equal_a_rederivation(x64, shift, fear):
    """Oracle: NumPy and SciPy; shifted sideways the path is safe and the fear label the other one."""
    waypoints = WAYPOINTS + np.array([0.0, shift]) * np.linspace(0.4, 1.0, 5)[:, None]
    points = path(waypoints)
    losses = score(points, jnp.asarray(fear), jnp.asarray(GOAL), maps())
    wanted = rederived(np.asarray(points), fear, GOAL)
    for name, value in wanted.items():
        assert float(getattr(losses, name)) == pytest.approx(value, rel=1e-9), name
    weighted = 0.5 * wanted["obstacle"] + 2.0 * wanted["motion"] + 5.0 * wanted["goal"] + wanted["fear"]
    assert float(heuristic_sum(losses)) == pytest.approx(weighted, rel=1e-9)


def test_the_fear_label_looks_at_the_first_two_metres_only(x64):
    """Oracle: the label flips exactly when the obstacle moves beyond the looked-at length."""
    far = np.stack([np.linspace(0.0, 4.0, 100), np.full(100, 0.2)], axis=1)
    for distance, danger in ((2.0, True), (0.8, False)):
        weights = HeuristicWeights(fear_distance=distance)
        arguments = (jnp.asarray(far), jnp.asarray(1.0), jnp.asarray(GOAL), maps(), weights)
        fear = float(heuristic_losses(*arguments).fear)
        assert fear == pytest.approx(np.log1p(np.exp(-1.0)) if danger else np.log1p(np.exp(1.0)), rel=1e-9)


def test_gradient_equals_finite_differences(x64):
    """Oracle: central differences for waypoints (through the spline), fear and goal."""

    def loss(waypoints, fear, goal):
        return heuristic_sum(heuristic_losses(path(waypoints), fear, goal, maps()))[None]

    assert_gradients_agree(jax.jit(loss), jnp.asarray(WAYPOINTS), jnp.asarray(0.3), jnp.asarray(GOAL))


def test_standing_still_at_the_goal_is_finite():
    """A goal at the feet and waypoints there: zero loss but for fear, and a finite gradient."""

    def loss(waypoints):
        return heuristic_sum(heuristic_losses(path(waypoints), jnp.zeros(()), jnp.zeros(2), maps()))

    value, gradient = jax.jit(jax.value_and_grad(loss))(jnp.zeros((5, 2)))
    assert np.isfinite(gradient).all()
    assert float(value) == pytest.approx(np.log(2.0) + 0.5 * 50 * float(PUBLISHED[0, 49:51].mean()), abs=1e-5)


def test_losses_always_count():
    losses = score(path(), jnp.zeros(()), jnp.asarray(GOAL), maps())
    assert bool(losses.converged)

"""The range scan about the goal's direction. Oracle: NumPy, point by point."""

import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.planning.goal_scan import GoalScan, goal_scan

SCAN = GoalScan()


def expected_scan(points: np.ndarray, valid: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """The scan by a loop over the points, in double precision."""
    wanted = np.zeros((SCAN.bins, 3))
    for (x, y, z), has_return in zip(points.reshape(-1, 3).astype(float), valid.ravel()):
        distance = np.sqrt(x**2 + y**2 + 1e-6)
        bearing = np.arctan2(y * ahead[0] - x * ahead[1], x * ahead[0] + y * ahead[1])
        index = int(np.floor((bearing + SCAN.half_span) / (2 * SCAN.half_span) * SCAN.bins))
        if not has_return or not 0 <= index < SCAN.bins or z >= SCAN.high:
            continue
        if z > SCAN.low + SCAN.low_slope * distance:
            wanted[index, 0] = max(wanted[index, 0], 1 / max(distance, SCAN.nearest))
        wanted[index, 1] = max(wanted[index, 1], min(distance / SCAN.reach, 1.0))
        wanted[index, 2] = 1.0
    return wanted


@pytest.mark.parametrize("bearing", [0.0, 0.9, -2.5])
def test_scan_equals_a_loop_over_the_points(bearing):
    rng = np.random.default_rng(3)
    points = rng.uniform([0.1, -4.0, -0.1], [10.0, 4.0, 1.0], (12, 20, 3)).astype(np.float32)
    valid = (rng.random((12, 20)) < 0.8).astype(np.float32)
    ahead = np.array([np.cos(bearing), np.sin(bearing)])
    scan = goal_scan(jnp.asarray(points), jnp.asarray(valid), jnp.asarray(ahead, jnp.float32), SCAN)
    np.testing.assert_allclose(scan, expected_scan(points, valid, ahead), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("changes", [{"bins": 2}, {"half_span": 4.0}, {"low": 0.8}, {"low": -0.1}])
def test_impossible_scans_are_refused(changes):
    with pytest.raises(InputError, match="needs"):
        GoalScan(**changes)

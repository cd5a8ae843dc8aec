"""The G1 stands, steps on the spot and walks on C MuJoCo, with one compiled controller."""

import numpy as np
import pytest

from iwalker_jax.api import walk
from iwalker_jax.walking import Motion


@pytest.fixture(scope="module")
def walked(g1):
    return walk(Motion("straight", distance=0.5), robot=g1, engine="mujoco")


def test_it_walks_as_far_as_it_was_told(walked):
    """Oracle: the planned footsteps, and the weight that the floor carries of a robot at rest."""
    metrics, record = walked.metrics[0], walked.records[0]
    assert not metrics.fallen and metrics.qp_failures == 0
    assert metrics.steps == metrics.planned
    assert np.max(metrics.footstep_errors) < 0.05
    end = record.planned.positions[-2:].mean(axis=0)
    assert end[0] > 0.5
    np.testing.assert_allclose(record.com[-1, :2], end, atol=0.03)
    weight = 9.81 * 33.341 * float(walked.conditions.mass_scale[0])
    assert np.mean(record.forces[-10:, :, 2].sum(axis=1)) == pytest.approx(weight, rel=0.01)


def test_it_stands_a_second_before_it_walks(walked):
    """The COM stays where it is wanted: over the soles, at its height."""
    record = walked.records[0]
    first = record.time < 1.0
    assert np.ptp(record.com[first, 2]) < 0.01
    assert np.all(np.abs(record.com[first, 0] - record.foot_positions[first, :, 0].mean(axis=1)) < 0.05)


def test_feet_that_carry_stand_flat_on_all_their_points(walked):
    """Property: at rest every corner of both soles presses."""
    assert walked.records[0].forces.shape[1] == 8
    assert np.all(walked.records[0].forces[-1, :, 2] > 1.0)

"""`walk`: the plan that was commanded, walked to its end; its records and figures are those of the samples."""

import numpy as np
import pytest

from iwalker_jax.api import walk
from iwalker_jax.errors import InputError
from iwalker_jax.walking import Disturbances, Motion


@pytest.fixture(scope="module")
def stepped():
    """A second of stepping in place on C MuJoCo, pushed a little."""
    pushes = Disturbances(push_impulse=0.2, push_after=0.5)
    return walk(Motion("in_place", seconds=1.0), engine="mujoco", disturbances=pushes, seed=2)


def test_the_walk_is_made_to_its_end(stepped):
    (metrics,) = stepped.metrics
    assert not metrics.fallen
    assert metrics.steps == metrics.planned == int(stepped.walk.plan.count) == 4
    assert metrics.seconds == pytest.approx(stepped.walk.seconds, abs=0.03)


def test_record_and_figures_are_those_of_the_samples(stepped):
    (record,) = stepped.records
    sample = stepped.batch.sample
    np.testing.assert_array_equal(record.com, sample.com[0])
    np.testing.assert_array_equal(record.foot_positions, sample.feet[0])
    shares = np.max(sample.torques[0], axis=0) / record.torque_limits
    np.testing.assert_allclose(stepped.metrics[0].torque_shares, shares)
    errors = np.linalg.norm(record.actual[:, :2] - np.asarray(stepped.walk.plan.positions)[:4], axis=1)
    np.testing.assert_allclose(stepped.metrics[0].footstep_errors, errors, atol=1e-6)


def test_the_record_knows_push_and_floor(stepped):
    (record,) = stepped.records
    assert record.push_times == (pytest.approx(float(stepped.conditions.push_start[0])),)
    assert 0.5 <= record.push_times[0] <= 0.5 + 2 * 0.24
    assert record.friction == pytest.approx(float(stepped.conditions.friction[0]))


def test_a_motions_kind_stands_for_the_motion():
    result = walk("stand", engine="mujoco")
    assert int(result.walk.plan.count) == 0
    assert result.records[0].push_times == ()


def test_bad_options_are_refused():
    with pytest.raises(InputError, match="Unknown engine 'bullet'; choose mjx or mujoco"):
        walk("stand", engine="bullet")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="C MuJoCo walks one robot at a time, not 4"):
        walk("stand", 4, engine="mujoco")
    with pytest.raises(InputError, match="Unknown motion 'hop'"):
        walk("hop")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="0 robots"):
        walk("stand", 0)

"""`walk`: the plan that was commanded, walked to its end; its records and figures are those of the samples."""

import numpy as np
import pytest

from iwalker_jax.api import walk, walking
from iwalker_jax.errors import InputError
from iwalker_jax.walking import Disturbances, Motion


@pytest.fixture(scope="module")
def stepped():
    """Two robots that step in place for a second on C MuJoCo, pushed a little."""
    pushes = Disturbances(push_impulse=0.2, push_after=0.5)
    return walk(Motion("in_place", seconds=1.0), 2, engine="mujoco", disturbances=pushes, seed=2)


def test_the_walks_are_made_to_their_end(stepped):
    assert len(stepped.metrics) == len(stepped.records) == 2
    for metrics in stepped.metrics:
        assert not metrics.fallen
        assert metrics.steps == metrics.planned == int(stepped.walk.plan.count) == 4
        assert metrics.seconds == pytest.approx(stepped.walk.seconds, abs=0.03)


def test_bruce_walks_as_before_there_were_other_robots(stepped):
    """Oracle: the COM [m] of this walk, written down when BRUCE was all that could walk; other machines round
    otherwise, which contacts amplify."""
    before = [
        [[0.048903, -0.008517, 0.364091], [0.036347, -0.007345, 0.364489], [0.041253, 0.009006, 0.364246]],
        [[0.058104, -0.004165, 0.362674], [0.056326, -0.007570, 0.362955], [0.052942, 0.008820, 0.362648]],
    ]
    np.testing.assert_allclose(stepped.batch.sample.com[:, [25, 75, 105]], before, atol=2e-4)


@pytest.mark.parametrize("robot", [0, 1])
def test_record_and_figures_are_those_of_the_samples(stepped, robot):
    record, sample = stepped.records[robot], stepped.batch.sample
    np.testing.assert_array_equal(record.com, sample.com[robot])
    np.testing.assert_array_equal(record.foot_positions, sample.feet[robot])
    shares = np.max(sample.torques[robot], axis=0) / record.torque_limits
    np.testing.assert_allclose(stepped.metrics[robot].torque_shares, shares)
    errors = np.linalg.norm(record.actual[:, :2] - np.asarray(stepped.walk.plan.positions)[:4], axis=1)
    np.testing.assert_allclose(stepped.metrics[robot].footstep_errors, errors, atol=1e-6)


def test_records_know_their_own_push_and_floor(stepped):
    for k, record in enumerate(stepped.records):
        assert record.push_times == (pytest.approx(float(stepped.conditions.push_start[k])),)
        assert 0.5 <= record.push_times[0] <= 0.5 + 2 * 0.24
        assert record.friction == pytest.approx(float(stepped.conditions.friction[k]))
    assert stepped.records[0].friction != stepped.records[1].friction


def test_a_motions_kind_stands_for_the_motion(monkeypatch):
    simulated = []

    def simulate(walker, model, commanded, *others):
        simulated.append(commanded)
        raise InterruptedError

    monkeypatch.setattr(walking, "simulate_walk", simulate)
    for motion in ("sideways", Motion("sideways")):
        with pytest.raises(InterruptedError):
            walk(motion)
    np.testing.assert_array_equal(simulated[0].plan.positions, simulated[1].plan.positions)
    assert np.ptp(simulated[0].plan.positions[:, 1]) > 0.5


@pytest.mark.parametrize(("engine", "physics"), [("mjx", "own"), ("mjx.step", "mjx.step")])
def test_the_engine_says_whose_step_moves_the_robot(engine, physics, monkeypatch):
    """Property: the program is made of a walker with that step."""
    walkers = []

    def program(walker, *others, **more):
        walkers.append(walker)
        raise InterruptedError

    monkeypatch.setattr(walking, "WalkProgram", program)
    with pytest.raises(InterruptedError):
        walk("in_place", engine=engine)
    assert walkers[0].physics == physics


def test_bad_options_are_refused(unchecked_types):
    with pytest.raises(InputError, match=r"Unknown engine 'bullet'; choose one of mjx, mjx\.step, mujoco"):
        walk("stand", engine="bullet")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="Unknown motion 'hop'"):
        walk("hop")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="0 robots"):
        walk("stand", 0)

"""Batches: rows that depend on nobody else, an early end, and dumps that replay a robot that broke."""

import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.walking.batch import WalkProgram
from iwalker_jax.walking.commands import Motion, make_walk
from iwalker_jax.walking.replay import load_dump, retrace, save_dump
from iwalker_jax.walking.setup import Disturbances, default_walker, sample_conditions

HUGE = 1e38  # [N], a push that overflows
BEGINS = 1.1  # [s]


@pytest.fixture(scope="module")
def setup():
    walker, model = default_walker()
    walk = make_walk(Motion("in_place", seconds=1.0), model, walker.controller.gait)
    return walker, walk, WalkProgram(walker, 2, 64)


@pytest.fixture(scope="module")
def result(setup):
    """Three robots in groups of two, the second one broken by its push."""
    walker, walk, program = setup
    conditions = sample_conditions(walker.robot, Disturbances(), 3, 0)
    conditions = conditions._replace(
        push_force=conditions.push_force.at[1, 0].set(HUGE), push_start=conditions.push_start.at[1].set(BEGINS)
    )
    heard: list[tuple[float, int]] = []
    return program.run(conditions, walk.plan, 20.0, lambda done, up: heard.append((done, up))), heard


def test_a_batch_ends_when_all_are_done(result, setup):
    out, heard = result
    _, walk, _ = setup
    samples = out.sample.time.shape[1]
    assert out.sample.qpos.shape == (3, samples, 23)
    assert samples * 0.02 < 10  # of the 20 s allowed
    assert heard[-1][1] == 2 and heard[-1][0] == pytest.approx(samples * 0.02)
    np.testing.assert_array_equal(out.sample.fallen[:, -1], [False, True, False])
    assert list(out.sample.step[[0, 2], -1]) == [int(walk.plan.count)] * 2
    assert out.robot_seconds_per_second > 0
    np.testing.assert_allclose(np.diff(out.sample.time, axis=1), 0.02, atol=1e-4)


def test_a_row_is_the_same_in_any_company(result, setup):
    out, _ = result
    walker, walk, program = setup
    conditions = sample_conditions(walker.robot, Disturbances(), 1, 0)
    alone = program.run(conditions, walk.plan, 2.0)
    assert not alone.broken
    np.testing.assert_array_equal(alone.sample.qpos[0], out.sample.qpos[0, :100])


def test_a_broken_robot_is_replayed_to_the_tick(result, setup, tmp_path):
    out, _ = result
    walker, _, _ = setup
    (broken,) = out.broken
    assert broken.row == 1
    states = save_dump(tmp_path / "nan_dump.npz", walker, broken)
    assert len(states.tick) == 100 and states.tick[-1] == pytest.approx(BEGINS / 0.002, abs=2)
    assert np.isfinite(states.qpos).all() and np.isfinite(states.qvel).all()
    # It was frozen there; one robot alone is another program, whose sums are rounded otherwise.
    np.testing.assert_allclose(states.qpos[-1], out.sample.qpos[1, -1], atol=1e-3)
    again, stored = load_dump(tmp_path / "nan_dump.npz", walker)
    for first, second, third in zip(states, stored, retrace(walker, again), strict=True):
        np.testing.assert_array_equal(first, second)
        np.testing.assert_array_equal(first, third)


def test_bad_input_is_one_sentence(setup, tmp_path):
    walker, walk, program = setup
    with pytest.raises(InputError, match="devices were asked for"):
        WalkProgram(walker, 2, 64, devices=99)
    conditions = sample_conditions(walker.robot, Disturbances(), 1, 0)
    with pytest.raises(InputError, match="pad the plan"):
        program.run(conditions, walk.plan._replace(yaws=walk.plan.yaws[:10]), 1.0)
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(InputError, match="no dump"):
        load_dump(tmp_path / "other.npz", walker)

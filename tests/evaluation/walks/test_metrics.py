"""Figures of walks against synthetic records whose errors are known by construction, and the tables made of them."""

import csv

import numpy as np
import pytest

from iwalker_jax.control import FootstepPlan
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.walks.metrics import find_landings, robot_rows, speed_error, walk_metrics, walk_record
from iwalker_jax.evaluation.walks.tables import (
    EMPTY_WALK_TABLE,
    WalkLabels,
    has_case,
    load_walk_table,
    summarise,
    with_case,
)
from iwalker_jax.geometry import Side
from iwalker_jax.walking import Sample

STEP_TIME, INTERVAL = 0.24, 0.02
LIMITS = np.full(16, 10.5)


def straight_plan(steps: int, length: float, turn: float = 0.0) -> FootstepPlan:
    """Left foot first, 0.1 m wide, along x; a turn [rad] a step on the spot."""
    sides = np.where(np.arange(steps) % 2 == 0, 1.0, -1.0)
    yaws = turn * np.arange(1, steps + 1)
    normals = np.stack([-np.sin(yaws), np.cos(yaws)], axis=1)
    centres = np.stack([length * np.arange(1, steps + 1), np.zeros(steps)], axis=1)
    positions = centres + 0.05 * sides[:, None] * normals
    return FootstepPlan(positions, yaws, np.asarray(1), np.asarray(steps))


def walk_of(plan: FootstepPlan, samples_a_step: int = 12, miss=(0.0, 0.0), fall: int | None = None) -> Sample:
    """A robot that lands `miss` [m] beside every footstep; its feet rest only 40 ms after touchdown.

    COM at touchdown 1 cm to the left of the middle of the planned feet, heading 2 degrees off, torques of half the
    limits, the believed velocity 2 cm/s off.
    """
    steps = int(plan.count)
    n = samples_a_step * (steps + 1)
    clock = np.arange(n) // samples_a_step
    feet, yaws = np.zeros((n, 2, 3)), np.zeros((n, 2))
    feet[:, 0, 1], feet[:, 1, 1] = -0.05, 0.05
    com, heading = np.zeros((n, 3)), np.zeros(n)
    for k in range(steps):
        at, foot = samples_a_step * (k + 1), (1 + k) % 2
        feet[at : at + 2, foot, 0] = 9.9  # still rocking
        feet[at + 2 :, foot, :2] = plan.positions[k] + np.asarray(miss)
        yaws[at:, foot] = plan.yaws[k]
        if k:
            com[at, :2] = (plan.positions[k] + plan.positions[k - 1]) / 2 + np.array([0.0, 0.01])
            heading[at] = (plan.yaws[k] + plan.yaws[k - 1]) / 2 + np.radians(2.0)
    fallen = np.zeros(n, bool) if fall is None else np.arange(n) >= fall
    qpos = np.zeros((n, 23))
    qpos[:, 3] = 1.0
    velocity = np.zeros((n, 3))
    return Sample(
        time=INTERVAL * np.arange(n),
        qpos=qpos,
        com=com,
        com_velocity=velocity,
        believed_velocity=velocity + np.array([0.0, 0.02, 0.0]),
        feet=feet,
        foot_yaws=yaws,
        heading=heading,
        mode=np.full(n, 2),
        stance=clock % 2,
        step=np.minimum(clock, steps),
        torques=np.full((n, 16), 5.25),
        forces=np.zeros((n, 4, 3)),
        qp_residual=np.zeros(n),
        qp_failures=(np.arange(n) == 5).astype(int),
        fallen=fallen,
    )


def test_errors_are_those_put_in():
    plan = straight_plan(10, 0.04)
    m = walk_metrics(walk_of(plan, miss=(0.003, 0.004)), plan, LIMITS, STEP_TIME)
    assert (m.steps, m.planned, m.fallen, m.qp_failures) == (10, 10, False, 1)
    np.testing.assert_allclose(m.footstep_errors, np.full(10, 0.005), atol=1e-12)
    np.testing.assert_allclose(m.com_errors, np.full(9, 0.01), atol=1e-12)
    np.testing.assert_allclose(np.degrees(m.heading_errors), np.full(9, 2.0), atol=1e-9)
    np.testing.assert_allclose(m.torque_shares, np.full(16, 0.5))
    assert m.velocity_rms == pytest.approx(0.02)
    assert m.speed == pytest.approx(0.04 / STEP_TIME) == m.planned_speed
    assert speed_error(m) == pytest.approx(0.0, abs=1e-9)


def test_slow_steps_are_a_speed_error():
    plan = straight_plan(10, 0.04)
    m = walk_metrics(walk_of(plan, samples_a_step=15), plan, LIMITS, STEP_TIME)  # 0.30 s a step
    assert m.speed == pytest.approx(0.04 / 0.30)
    assert speed_error(m) == pytest.approx(-20.0)


def test_a_turn_on_the_spot_is_judged_by_its_rate():
    plan = straight_plan(60, 0.0, turn=np.radians(7.2))  # more than a whole turn
    m = walk_metrics(walk_of(plan, samples_a_step=15), plan, LIMITS, STEP_TIME)
    assert m.on_the_spot and np.isnan(summarise([m])["speed m/s"])
    assert np.degrees(m.planned_turn_rate) == pytest.approx(30.0)
    assert np.degrees(m.turn_rate) == pytest.approx(24.0)
    assert speed_error(m) == pytest.approx(-20.0)
    np.testing.assert_allclose(np.degrees(m.heading_errors), np.full(59, 2.0), atol=1e-9)


def test_nothing_counts_after_a_fall():
    plan = straight_plan(10, 0.04)
    sample = walk_of(plan, fall=12 * 5 + 1)  # before the fifth foot rests
    sample.torques[-1] = 99.0
    sample.time[62:] = sample.time[61]  # as in the C engine
    sample.believed_velocity[-1] = np.nan
    m = walk_metrics(sample, plan, LIMITS, STEP_TIME)
    assert m.fallen and m.steps == 4
    assert m.seconds == pytest.approx(61 * INTERVAL)
    assert m.torque_shares.max() == pytest.approx(0.5) and m.velocity_rms == pytest.approx(0.02)
    landed = find_landings(sample, plan)
    assert np.isfinite(landed.feet[:4]).all() and np.isnan(landed.feet[4:]).all()


def test_a_robot_that_stands_or_breaks_at_once_has_no_figures():
    still = straight_plan(0, 0.0)
    m = walk_metrics(walk_of(still), still, LIMITS, STEP_TIME)
    assert m.steps == 0 and np.isnan(m.speed) and np.isnan(speed_error(m))
    plan = straight_plan(6, 0.04)
    m = walk_metrics(walk_of(plan, fall=0), plan, LIMITS, STEP_TIME)
    assert m.fallen and m.steps == 0 and m.seconds == 0.0 and np.isnan(m.velocity_rms)


def test_the_record_tells_roll_and_pitch_and_times_every_footstep():
    plan = straight_plan(6, 0.04)
    sample = walk_of(plan, fall=12 * 3 + 1)
    clock = sample.time.copy()
    sample.time[40:] = sample.time[39]
    half = np.radians(10.0) / 2
    sample.qpos[:, 3:7] = np.cos(half), 0.0, np.sin(half), 0.0
    record = walk_record(sample, plan, LIMITS, STEP_TIME, commanded_speed=0.15)
    np.testing.assert_allclose(np.degrees(record.base_rpy[0, :2]), [0.0, 10.0], atol=1e-9)
    np.testing.assert_allclose(record.planned.times, STEP_TIME * np.arange(1, 7), atol=1e-9)
    np.testing.assert_allclose(record.time, clock, atol=1e-9)
    assert np.isnan(record.actual[2:]).all() and np.isfinite(record.actual[:2]).all()
    assert list(record.planned.sides) == [Side.LEFT, Side.RIGHT] * 3


def test_tables_gather_robots_and_can_be_read_back(tmp_path):
    plan = straight_plan(10, 0.04)
    batch = Sample(*(np.stack(leaves) for leaves in zip(walk_of(plan, miss=(0.01, 0.0)), walk_of(plan, fall=30))))
    row = summarise([walk_metrics(robot_rows(batch, k), plan, LIMITS, STEP_TIME) for k in range(2)])
    assert (row["robots"], row["falls"], row["survived %"]) == (2, 1, 50)
    # Ten footsteps 1 cm off, and two of the other robot before it fell, without error.
    assert row["footstep mean cm"] == pytest.approx(10 / 12) and row["footstep max cm"] == pytest.approx(1.0)
    assert row["steps made %"] == pytest.approx((100 + 20) / 2)
    labels = WalkLabels("nominal", "straight", "mjx", "7")
    table = with_case(EMPTY_WALK_TABLE, labels, row)
    table.save(tmp_path, "study", checksums=True)
    with (tmp_path / "study.csv").open() as stream:
        (line,) = csv.DictReader(stream)
    assert line["case"] == "straight" and float(line["footstep mean cm"]) == row["footstep mean cm"]
    assert "| nominal | straight | mjx | 7 | 2 | 1 | 50.0 | 60.0 |" in (tmp_path / "study.md").read_text()
    again = load_walk_table(tmp_path / "study.csv")
    assert again.rows[0][0] == labels and again.text() == table.text()
    assert again.rows[0][1][0] == pytest.approx(row, abs=0, nan_ok=True)
    assert (
        has_case(again, labels, 2)
        and not has_case(again, labels, 3)
        and not has_case(again, labels._replace(seed="8"), 2)
    )


def test_a_robot_that_stops_early_has_not_made_its_steps():
    """By construction: it stands for the last 6 of 10 footsteps; nothing is planned for one that only stands."""
    plan = straight_plan(10, 0.04)
    sample = walk_of(plan)
    sample.step[:] = np.minimum(sample.step, 4)
    row = summarise([walk_metrics(sample, plan, LIMITS, STEP_TIME)])
    assert (row["falls"], row["steps made %"]) == (0, 40.0)
    nothing = FootstepPlan(plan.positions, plan.yaws, plan.first_swing, np.asarray(0))
    assert np.isnan(summarise([walk_metrics(sample, nothing, LIMITS, STEP_TIME)])["steps made %"])


@pytest.mark.parametrize("text", ["", "suite,case\nnominal,straight\n", None])
def test_other_tables_are_refused(tmp_path, text):
    """Property: empty, foreign and damaged files are one sentence; no file is an empty table."""
    file = tmp_path / "walk_study.csv"
    assert load_walk_table(file).rows == ()
    if text is None:
        row = summarise([walk_metrics(walk_of(straight_plan(10, 0.04)), straight_plan(10, 0.04), LIMITS, STEP_TIME)])
        with_case(EMPTY_WALK_TABLE, WalkLabels("nominal", "straight", "mjx", "0"), row).save(
            tmp_path, "walk_study", checksums=True
        )
        text = file.read_text()[:-40]
    file.write_text(text)
    with pytest.raises(InputError, match="move it away"):
        load_walk_table(file)
    with pytest.raises(InputError, match="choose another folder"):
        load_walk_table(tmp_path / (300 * "x"))

"""Metrics of closed-loop episodes, against lengths and intervals worked out by other means."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import minimize

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes.metrics import (
    batch_metrics,
    episode_metrics,
    landing_errors,
    path_shaking,
    row_of,
    shortest_route,
    walked_distance,
)
from iwalker_jax.navigation.record import Outcome
from iwalker_jax.scenes.scene import Scene
from iwalker_jax.tasks.task import Task
from tests.evaluation.episode_records import FRAME, make_record, make_task, room


def test_a_reached_episode_by_hand():
    """Oracle: the polyline's own length; the sway of the steps adds a tenth to the raw track but not to the figure."""
    record, task = make_record(seconds=20.0), make_task()
    got = episode_metrics(row_of(record, 0), task, shortest=4.5)
    length = 2 * np.hypot(2.0, 1.7)
    raw = np.linalg.norm(np.diff(record.base[0, :, :2], axis=0), axis=1).sum()
    assert raw > 1.1 * length
    assert got.walked == pytest.approx(length, rel=0.02)
    assert got.success and got.goals == 1.0
    assert got.seconds == pytest.approx(20.0 - 2 * FRAME)
    assert got.spl == pytest.approx(4.5 / got.walked)
    assert got.speed == pytest.approx(got.walked / got.seconds)
    assert got.clearance == pytest.approx(0.2, abs=1e-3)
    assert got.torque_peak == 0.5 and got.qp_failures == 0.0 and got.detours == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("outcome", [Outcome.COLLIDED, Outcome.FELL, Outcome.GAVE_UP, Outcome.TIMED_OUT])
def test_a_failed_episode_is_worth_nothing_but_its_goals(outcome):
    record = make_record(outcomes=(outcome,))
    # The robot believes to be at the first goal half way, where it is.
    goal = np.minimum(2 * np.arange(len(record.time[0])) // len(record.time[0]), 1)[None]
    record = record._replace(goal=goal, qp_failures=np.full_like(record.qp_failures, 3))
    task = make_task(goals=((3.0, 2.7), (5.0, 1.0), (5.0, 2.0), (5.0, 3.0)))
    got = episode_metrics(row_of(record, 0), task, shortest=4.5)
    assert got.outcome is outcome and not got.success
    assert got.spl == 0.0 and got.goals == 0.25
    # Three of the 33 ticks of 2 ms in every frame.
    assert got.qp_failures == pytest.approx(3 * 0.002 / FRAME, rel=0.01)


@pytest.mark.parametrize(("off", "success"), [(0.39, True), (0.41, False)])
def test_success_is_where_the_robot_truly_stands(off, success):
    """Oracle: the end of the track; the robot always believes that it has arrived."""
    record = row_of(make_record(sway=0.0), 0)
    gap = np.linalg.norm(record.base[-1, :2] - (5.0, 1.0))
    goal = record.base[-1, :2] + off * np.array([0.6, -0.8])
    got = episode_metrics(record, make_task(goals=((float(goal[0]), float(goal[1])),)), shortest=4.5)
    assert gap < 0.1 and got.end == pytest.approx(off)
    assert (got.outcome, got.goals) == (Outcome.REACHED if success else Outcome.MISTAKEN, float(success))
    assert got.success == success == (got.spl > 0.8)


@pytest.mark.parametrize(("off", "reached"), [(0.38, True), (0.45, False)])
def test_each_goal_on_the_way_must_truly_be_passed(off, reached):
    """Oracle: the distance of a goal above the bend at (3, 2.7) from the track; only while it is aimed at."""
    record = row_of(make_record(sway=0.0), 0)
    task = make_task(goals=((3.0, 2.7 + off), (5.0, 1.0)))
    n, middle = len(record.time), len(record.time) // 2
    goal = (np.arange(n) > middle + 3).astype(int)
    got = episode_metrics(record._replace(goal=goal), task, shortest=4.5)
    assert got.success == reached and got.goals == (1.0 if reached else 0.5)
    too_early = (np.arange(n) > middle // 2).astype(int)
    assert episode_metrics(record._replace(goal=too_early), task, shortest=4.5).outcome is Outcome.MISTAKEN


def test_every_episode_ends_where_its_outcome_begins():
    record = make_record(outcomes=(Outcome.REACHED, Outcome.RUNNING))
    assert len(row_of(record, 0).time) == len(record.time[0]) - 2
    assert len(row_of(record, 1).time) == len(record.time[0])
    got = batch_metrics(record, [make_task("a"), make_task("b")])
    assert [m.outcome for m in got] == [Outcome.REACHED, Outcome.RUNNING]
    with pytest.raises(InputError, match="1 tasks and 2 episodes"):
        batch_metrics(record, [make_task()])
    with pytest.raises(InputError, match="no episode 2"):
        row_of(record, 2)


def test_the_shortest_route_goes_around_the_partition_and_through_all_goals():
    """Oracle: the taut string around the partition's end, 2 m from the wall, with the route's margin of 0.2 m.

    It ends 0.3 m before the last goal; a corner at a goal is cut by as much as the bisector's place at 0.3 m saves.
    """
    corner = np.array([[2.95, 2.0], [3.05, 2.0]])
    radius = 0.2
    reach = np.linalg.norm(corner[0] - [1.0, 1.0])
    straight = np.sqrt(reach**2 - radius**2)
    # From (1, 1) tangent to the circle about the left corner, then over the top by symmetry.
    bearing = np.arctan2(1.0, 1.95) + np.arcsin(radius / reach)
    arc = radius * bearing
    expected = 2 * (straight + arc) + 0.1
    one = shortest_route(make_task())
    assert one == pytest.approx(expected - 0.3, rel=0.05)
    # Straight on at the first goal nothing is saved there.
    last = shortest_route(make_task(goals=((5.0, 1.0), (5.0, 2.5))))
    before = shortest_route(make_task(goals=((5.0, 2.5),)))
    straight_on = shortest_route(make_task(goals=((5.0, 1.5), (5.0, 1.0))))
    assert one - 0.1 < straight_on < one + 0.3
    assert before < last < one + 1.5


@pytest.mark.parametrize("degrees", [0.0, 60.0, 120.0, 180.0])
def test_what_a_corner_at_a_goal_spares(degrees):
    """Oracle: SciPy's shortest tour of discs of 0.3 m in an open hall: the bound spares that much or a little more."""
    boxes = np.array([[-0.05, 4.0, 0.75, 0.05, 4.0, 0.75, 0.0]])
    hall = Scene("hall", "test", boxes, np.zeros((0, 5)), (0, 0, 8, 8), 2.4)
    turned = np.radians(degrees) + np.pi  # from straight back to straight on
    start, corner = np.array([1.5, 4.0]), np.array([4.0, 4.0])
    end = corner + 2.5 * np.array([np.cos(turned), np.sin(turned)])

    def length(polar):
        places = [corner, end] + 0.3 * polar[:2, None] * np.stack([np.cos(polar[2:]), np.sin(polar[2:])], axis=1)
        return np.linalg.norm(np.diff([start, *places], axis=0), axis=1).sum()

    guesses = [[1.0, 1.0, first, turned + np.pi] for first in np.linspace(0.0, 6.0, 7)]
    best = min(minimize(length, guess, bounds=[(0, 1)] * 2 + [(-10, 10)] * 2).fun for guess in guesses)
    legs = sum(shortest_route(Task("leg", hall, (*a, 0.0), b[None])) + 0.3 for a, b in ((start, corner), (corner, end)))
    spared = legs - shortest_route(Task("tour", hall, (*start, 0.0), np.array([corner, end])))
    # The directions of a grid's ways are a few degrees off.
    assert -0.01 < spared - (5.0 - best) < 0.1


def test_no_route_is_nan_and_leaves_the_path_length_unweighted():
    closed = room().boxes.copy()
    closed[4, [1, 4]] = 2.0  # the partition from wall to wall
    walled_in = dataclasses.replace(make_task(), scene=dataclasses.replace(room(), boxes=closed))
    assert np.isnan(shortest_route(walled_in))
    assert np.isnan(episode_metrics(row_of(make_record(), 0), walled_in).spl)


def test_a_standing_robot_walks_nowhere():
    assert walked_distance(np.ones((30, 2)), np.arange(30) * FRAME) == 0.0
    assert walked_distance(np.ones((1, 2)), np.zeros(1)) == 0.0


def test_shaking_is_the_lateral_change_of_new_paths():
    """Oracle: parallel straight paths, every second one moved by 4 cm; progress along the path does not count."""
    x = np.linspace(0.0, 2.0, 41)
    paths = np.stack([np.stack([x + 0.01 * k, np.full(41, 0.04 * (k % 2))], axis=1) for k in range(10)])
    assert path_shaking(paths) == pytest.approx(0.04)
    assert path_shaking(paths[::2]) == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(path_shaking(np.repeat(paths[:1], 5, axis=0)))
    assert np.isnan(path_shaking(0.2 * paths))


def test_landing_errors_are_those_of_feet_that_have_just_landed():
    """By hand: the right foot lands 3 cm off, then the left one 1 cm; a new plan of a standing robot does not count."""
    right, left = [0.0, -0.05, 0.0], [0.0, 0.05, 0.0]
    swinging, landed = [0.04, -0.05, 0.02], [0.08, -0.02, 0.0]
    feet = [(right, left), (swinging, left), (landed, left), (landed, [0.1, 0.05, 0.02]), (landed, [0.15, 0.05, 0.0])]
    feet = [(right, left)] * 4 + feet + [feet[-1]] * 4
    aims = [[0.08, -0.05]] * 6 + [[0.16, 0.05]] * 2 + [[0.2, -0.05]] * 5
    aims[1] = aims[2] = [0.0, -0.06]
    record = row_of(make_record(seconds=12 / 15), 0)
    steps = np.repeat(np.array(aims)[:, None], 2, axis=1)
    episode = record._replace(footsteps=steps, feet=np.array(feet))
    np.testing.assert_allclose(landing_errors(episode), [0.03, 0.01], atol=1e-12)

"""Whole episodes: reaching a goal, and what must not happen when camera, odometry, scene or goal fail.

One compiled program walks all of them at once; each test looks at its own row. The oracle is the simulated robot's true
state.
"""

import dataclasses

import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.navigation.episodes import EpisodeProgram, TaskBatch
from iwalker_jax.navigation.faults import make_faults
from iwalker_jax.navigation.navigators import make_navigator
from iwalker_jax.navigation.record import Outcome
from iwalker_jax.scenes.scene import Scene
from iwalker_jax.tasks.task import Task
from iwalker_jax.training.pretrained import load_planner

WALLS = np.array(
    [[2.0, 2.1, 0.6, 2.6, 0.1, 0.6, 0], [2.0, -2.1, 0.6, 2.6, 0.1, 0.6, 0], [4.6, 0, 0.6, 0.1, 2.0, 0.6, 0]], float
)
PILLAR = np.array([[1.8, 0.1, 0.6, 0.2, 0.6]])
BARRIER = np.array([[2.6, 0.0, 0.6, 0.1, 2.1, 0.6, 0.0]])
BACK = np.array([[-0.8, 0.0, 0.6, 0.1, 2.0, 0.6, 0.0]])  # else there would be a way out, and around all walls
BOUNDS = (-1.0, -2.5, 5.0, 2.5)
GOAL = np.array([[3.4, 0.0]])


def task(name: str, boxes: np.ndarray = WALLS, cylinders: np.ndarray = PILLAR) -> Task:
    return Task(name, Scene(name, "test", boxes, cylinders, BOUNDS), (0.0, 0.0, 0.0), GOAL, 60.0)


EPISODES = {
    "plain": (task("plain"), make_faults()),
    "blind": (task("blind"), make_faults(blind=(4.0, 1e6))),
    "dark": (task("dark"), make_faults(blind=(0.0, 1e6))),
    "frozen": (task("frozen"), make_faults(frozen=(4.0, 7.0))),
    "odometry": (task("odometry"), make_faults(odometry=(5.0, 6.0))),
    "moved": (
        task("moved", cylinders=np.zeros((0, 5))),
        make_faults(box=(1.9, 0.0, 0.4, 0.15, 0.3, 0.4, 0.0), present=(3.0, 1e6)),
    ),
    "unreachable": (task("unreachable", np.concatenate([WALLS, BARRIER, BACK]), np.zeros((0, 5))), make_faults()),
}


@pytest.fixture(scope="module")
def program():
    """What walks all episodes at once, on all devices."""
    return EpisodeProgram(make_navigator("default", load_planner()[0]), len(EPISODES))


@pytest.fixture(scope="module")
def record(program):
    """All episodes, by name: the record's row."""
    tasks, faults = zip(*EPISODES.values(), strict=True)
    rows = program.run(tasks, seed=3, faults=faults)
    return {name: type(rows)(*(leaf[k] for leaf in rows)) for k, name in enumerate(EPISODES)}


def end(row) -> Outcome:
    return Outcome(int(row.outcome[-1]))


def test_nobody_touches_anything_or_falls(record):
    for name, row in record.items():
        assert end(row) not in (Outcome.COLLIDED, Outcome.FELL), f"{name}: {end(row).sentence}"
        assert row.clearance.min() > 0


@pytest.mark.parametrize("name", ["plain", "frozen", "odometry", "moved"])
def test_goals_that_can_be_reached_are_reached(record, name):
    row = record[name]
    assert end(row) == Outcome.REACHED
    assert np.linalg.norm(row.base[-1, :2] - GOAL[0]) < 0.4


@pytest.mark.parametrize(("name", "begins"), [("blind", 4.0), ("frozen", 4.0)])
def test_a_robot_without_eyes_stops_within_a_second_and_a_half(record, name, begins):
    row = record[name]
    span = (row.time > begins + 1.5) & (row.time < begins + 3.0)
    assert row.stopped[span].all()
    places = row.base[span, :2]
    assert np.ptp(places, axis=0).max() < 0.08


def test_a_robot_that_never_saw_anything_never_takes_a_step(record):
    assert end(record["dark"]) == Outcome.GAVE_UP
    assert np.ptp(record["dark"].feet[..., :2], axis=0).max() < 0.02


@pytest.mark.parametrize("name", ["blind", "unreachable"])
def test_where_there_is_no_way_the_robot_says_so_and_stands(record, name):
    row = record[name]
    assert end(row) == Outcome.GAVE_UP
    speeds = np.linalg.norm(np.diff(row.base[-8:, :2], axis=0), axis=1)
    assert speeds.max() < 0.02


def test_lost_odometry_leaves_the_robot_near_where_it_believes_to_be(record):
    row = record["odometry"]
    apart = np.linalg.norm(row.believed[1:, :2] - row.base[:-1, :2], axis=1)
    assert apart.max() < 0.15


def test_finished_episodes_stay_as_they_ended(record):
    row = record["plain"]
    over = np.flatnonzero(row.outcome == Outcome.REACHED)
    np.testing.assert_array_equal(row.qpos[over], np.broadcast_to(row.qpos[over[0]], row.qpos[over].shape))


def test_episodes_are_the_same_where_they_begin_in_rows_of_ended_ones(program):
    """Oracle: batches walked one after the other; bit for bit, whoever walks before and beside."""
    names = tuple(EPISODES)

    def batch(seed: int, *limits: float) -> TaskBatch:
        chosen = [EPISODES[names[(seed + k) % len(names)]] for k in range(len(limits))]
        tasks = [dataclasses.replace(own, time_limit=limit) for (own, _), limit in zip(chosen, limits, strict=True)]
        return TaskBatch(tasks, seed, [faults for _, faults in chosen])

    batches = [
        batch(1, 1.0, 7.5, 2.5, 0.5, 5.0, 3.0, 1.0, *[0.5] * (program.width - 7)),
        batch(2, 5.0, 1.0),
        batch(3, 3.0, 1.0, 3.0, 5.0),
        # One more than there are rows, so that it begins after another of its own batch.
        batch(4, *[1.5] * (program.width + 1)),
    ]
    apart, heard, stretches = [], [], []
    for each in batches:
        apart.append(program.run(each.tasks, each.seed, each.faults, lambda *progress: stretches.append(progress)))
    together = dict(program.run_batches(batches, heard.append))
    assert sorted(together) == [0, 1, 2, 3]
    assert heard[-1].ended == sum(len(each.tasks) for each in batches) and heard[-1].running == 0
    assert len(heard) < len(stretches) and heard[-1].seconds == pytest.approx(stretches_walked(apart, program))
    for number, record in enumerate(apart):
        assert record.outcome.shape[0] == len(batches[number].tasks)
        for before, after in zip(record, together[number], strict=True):
            np.testing.assert_array_equal(after, before)
    first = program.run(batches[0].tasks[:1], batches[0].seed, batches[0].faults[:1])
    frames = first.outcome.shape[1]
    for alone, among in zip(first, together[0], strict=True):
        np.testing.assert_array_equal(among[:1, :frames], alone)


def stretches_walked(records, program) -> float:
    """[s] of all stretches that the episodes of some records have begun."""
    frames = np.concatenate([np.argmax(record.outcome != Outcome.RUNNING, axis=1) + 1 for record in records])
    return float(np.sum(-(-frames // program.frames))) * program.frames * program.navigator.frame_time


def test_wrong_requests_are_one_sentence():
    planner = load_planner()[0]
    with pytest.raises(InputError, match="Unknown policy 'clever'"):
        make_navigator("clever", planner)
    navigator = make_navigator("networks", planner)
    with pytest.raises(InputError, match="give at least one"):
        EpisodeProgram(navigator, 2).run([])
    with pytest.raises(InputError, match="devices were asked for"):
        EpisodeProgram(navigator, 2, devices=64)
    with pytest.raises(InputError, match="goals have shape"):
        Task("none", EPISODES["plain"][0].scene, (0, 0, 0), np.zeros((0, 2)))

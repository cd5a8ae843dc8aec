"""Named tasks: walkable whatever the seed, by SciPy on a raster of the scene, and as demanding as they claim."""

import math

import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.scenes import room_is_passable
from iwalker_jax.tasks import named as demonstrations
from iwalker_jax.tasks.named import ROOM_TASK_NAMES, TASK_NAMES, demonstration, named_task
from iwalker_jax.tasks.task import GOAL_CAPACITY, stack_tasks
from tests.tasks.free_space import bottleneck, cell_of, clearance_map, connected


@pytest.mark.parametrize("name", [name for name in TASK_NAMES if name not in ROOM_TASK_NAMES])
def test_every_seed_leaves_a_route(name):
    """Oracle: connected components of a Euclidean distance transform at 0.2 m; room to start and to stand."""
    for seed in range(4):
        task = named_task(name, seed)
        clearance = clearance_map(task.scene)
        stops = np.concatenate([[task.start[:2]], task.goals])
        assert connected(task.scene, clearance, stops, 0.19)
        spare = [clearance[cell_of(task.scene, stop)] for stop in stops]
        assert spare[0] > 0.35 - 0.04
        assert min(spare[1:]) > 0.30 - 0.04
        direct = np.linalg.norm(np.diff(stops, axis=0), axis=1).sum()
        assert direct * 16 + 20 < task.time_limit < 2.2 * direct * 16 + 20
        again = named_task(name, seed)
        assert again.start == task.start
        np.testing.assert_array_equal(again.scene.boxes, task.scene.boxes)
        task.scene.arrays()


@pytest.mark.parametrize("name", ROOM_TASK_NAMES)
def test_hard_rooms_have_a_way_or_none_as_they_claim(name):
    """Oracle: connected components of a Euclidean distance transform, between the widths of 0.40 and 0.45 m."""
    for seed in range(2):
        task = named_task(name, seed)
        clearance = clearance_map(task.scene)
        stops = np.concatenate([[task.start[:2]], task.goals])
        passable = room_is_passable(name.removeprefix("room_"))
        assert passable is None or connected(task.scene, clearance, stops, 0.21) == passable
        assert clearance[cell_of(task.scene, stops[0])] > 0.35 - 0.04


def test_seeds_move_the_start_and_small_things_only():
    """Property: starts stay within 5 cm and 5 degrees of each other's middle; most boxes never move."""
    tasks = [demonstration("office", seed) for seed in range(6)]
    starts = np.array([task.start for task in tasks])
    assert len(set(starts[:, 0])) == 6
    assert (np.ptp(starts, axis=0) <= [0.1, 0.1, math.radians(10)]).all()
    moved = np.ptp([task.scene.boxes for task in tasks], axis=0)
    assert (moved[:, 3:6] == 0).all()
    assert 0.3 < (moved == 0).all(axis=1).mean() < 0.95
    assert (moved[:, :2] < 0.3).all()


def test_the_factory_has_one_narrow_gap_before_its_second_goal():
    """Oracle: the widest disc that gets through, on a 2.5 cm raster."""
    task = demonstration("factory")
    assert len(task.goals) == 3
    clearance = clearance_map(task.scene)
    assert 0.29 < bottleneck(task.scene, clearance, task.goals[:2]) < 0.36
    assert bottleneck(task.scene, clearance, np.array([task.start[:2], task.goals[0]])) > 0.3


def test_the_corridor_turns_both_ways_and_hides_its_goal():
    """Property: ten metres of way, four turns by design, and walls across the straight line."""
    task = demonstration("corridor")
    clearance = clearance_map(task.scene)
    line = np.linspace(task.start[:2], task.goals[0], 200)
    inside = [clearance[cell_of(task.scene, point)] for point in line]
    crossings = np.diff((np.array(inside) == 0).astype(int)) == 1
    assert crossings.sum() >= 2
    assert 9 < (task.time_limit - 20) / 16 < 11


def test_the_office_has_tops_and_legs_in_the_body_s_way():
    """Property: things that hang or stand free between the knee and the head of the robot."""
    task = demonstration("office")
    tops = task.scene.boxes[(task.scene.boxes[:, 2] - task.scene.boxes[:, 5] > 0.3)]
    assert ((tops[:, 2] - tops[:, 5] < 0.72) & (tops[:, 3] > 0.15)).sum() >= 8
    assert (task.scene.cylinders[:, 3] < 0.04).sum() >= 4
    assert 6 < (task.time_limit - 20) / 16 < 9


def test_tasks_stack_to_one_shape():
    """Property: the batch's arrays hold every task's goals, the last one repeated."""
    tasks = [named_task(name) for name in TASK_NAMES]
    stacked = stack_tasks(tasks)
    assert stacked.goals.shape == (len(TASK_NAMES), GOAL_CAPACITY, 2)
    np.testing.assert_array_equal(stacked.goal_count, [len(task.goals) for task in tasks])


def test_bad_requests_are_refused():
    """Property: one sentence names what can be chosen."""
    with pytest.raises(InputError, match="choose one of factory"):
        named_task("roof")
    with pytest.raises(InputError, match="Unknown demonstration"):
        demonstration("stair")
    with pytest.raises(InputError, match="Unknown test sequence"):
        demonstrations.sequence_task("factory")
    with pytest.raises(InputError, match="negative"):
        named_task("office", -1)

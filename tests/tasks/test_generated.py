"""Generated tasks: blocked in a straight line and solvable around, by SciPy on a raster of the scene."""

import math

import jax
import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.built.training_scenes import FAMILIES
from iwalker_jax.tasks.generated import TaskSampling, generated_task, generated_tasks, training_task
from tests.tasks.free_space import CELL, cell_of, clearance_map, connected


def shortest_length(scene, clearance, start, goal, radius):
    """SciPy's Dijkstra on a king's-move graph of every second cell, at most 8 % above the geodesic length [m]."""
    free = clearance[::2, ::2] > radius
    number = np.arange(free.size).reshape(free.shape)
    heads, tails, lengths = [], [], []
    for a, b in ((1, 0), (0, 1), (1, 1), (1, -1)):
        i, j = np.mgrid[0 : free.shape[0] - a, max(0, -b) : free.shape[1] - max(0, b)]
        both = free[i, j] & free[i + a, j + b]
        heads.append(number[i, j][both])
        tails.append(number[i + a, j + b][both])
        lengths.append(np.full(both.sum(), 2 * CELL * math.hypot(a, b)))
    graph = coo_matrix((np.concatenate(lengths), (np.concatenate(heads), np.concatenate(tails))), (free.size,) * 2)
    ends = [number[tuple(np.array(cell_of(scene, point)) // 2)] for point in (start, goal)]
    return dijkstra(graph.tocsr(), directed=False, indices=ends[0])[ends[1]]


@pytest.mark.parametrize(("draw", "count"), [(generated_task, 20), (training_task, 12)])
def test_tasks_need_a_detour_and_have_one(draw, count):
    """Oracle: distance transform, connected components and Dijkstra on a raster, for every rule of a task."""
    rules = TaskSampling()
    slack = 2 * CELL
    for seed in range(count):
        task = draw(seed)
        start, goal = np.array(task.start[:2]), task.goals[0]
        assert len(task.goals) == 1
        distance = math.dist(start, goal)
        assert rules.nearest <= distance <= rules.farthest
        clearance = clearance_map(task.scene)
        assert clearance[cell_of(task.scene, start)] > 0.35 - slack
        assert clearance[cell_of(task.scene, goal)] > 0.30 - slack
        line = np.linspace(start, goal, 300)
        assert min(clearance[cell_of(task.scene, point)] for point in line) < rules.blocked_clearance + slack
        assert connected(task.scene, clearance, [start, goal], 0.18)
        length = shortest_length(task.scene, clearance, start, goal, 0.17)
        assert length / 1.09 <= rules.most_detour * distance
        assert length / 1.09 * 16 <= task.time_limit - 20 <= 2 * distance * 16
        assert abs(task.start[2]) <= math.pi


def test_headings_follow_the_way_out_and_spread():
    """Property: most robots look where they can go, and nobody stands nose to the wall."""
    room = []
    for seed in range(20):
        task = generated_task(seed)
        clearance = clearance_map(task.scene)
        ahead = np.array(task.start[:2]) + 0.3 * np.array([math.cos(task.start[2]), math.sin(task.start[2])])
        room.append(clearance[cell_of(task.scene, ahead)])
    assert min(room) > 0.05
    assert np.mean(np.array(room) > 0.25) > 0.7


def test_a_seed_is_a_task():
    """Property: the same seed gives the same task, other seeds others; scenes come from where they should."""
    first, again = generated_task(7), generated_task(7)
    assert first.start == again.start
    np.testing.assert_array_equal(first.goals, again.goals)
    np.testing.assert_array_equal(first.scene.boxes, again.scene.boxes)
    batch = generated_tasks(3, seed=6)
    assert [task.name for task in batch] == ["unseen-6", "unseen-7", "unseen-8"]
    assert batch[1].start == first.start
    assert len({task.start for task in batch}) == 3
    assert all(task.scene.family == "held_out" for task in batch)
    assert training_task(7).scene.family in FAMILIES


def test_the_precision_makes_no_difference():
    """Property: double precision draws the same task."""
    single = generated_task(3)
    with jax.enable_x64(True):
        double = generated_task(3)
    assert single.start == pytest.approx(double.start, abs=1e-6)
    np.testing.assert_array_equal(single.goals, double.goals)


def test_bad_requests_are_refused():
    """Property: one sentence says what to give."""
    with pytest.raises(InputError, match="negative"):
        generated_task(-1)
    with pytest.raises(InputError, match="negative"):
        training_task(-1)
    with pytest.raises(InputError, match="at least one task"):
        generated_tasks(0)
    with pytest.raises(InputError, match="nearest < farthest"):
        TaskSampling(nearest=3.0, farthest=2.0)

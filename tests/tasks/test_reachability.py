"""Which tasks are refused: by hand in rooms with gaps, and by a distance transform of finely drawn scenes."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.clearance_grid import clearance_grid
from iwalker_jax.scenes.scene import Scene, obstacle_distance
from iwalker_jax.tasks.generated import generated_tasks
from iwalker_jax.tasks.reachability import check_task
from iwalker_jax.tasks.task import Task
from tests.evaluation.episode_records import room
from tests.tasks.free_space import clearance_map, connected


def divided(gap: float, turn: float = 0.0) -> Scene:
    """Two rooms with a gap in the wall between them, all turned about the origin."""
    half = (3.0 - gap / 2) / 2
    walls = [[0, sign * (gap / 2 + half), 0.5, 0.05, half, 0.5, 0] for sign in (-1, 1)]
    walls += [[0, sign * 3, 0.5, 3, 0.05, 0.5, 0] for sign in (-1, 1)]
    walls += [[sign * 3, 0, 0.5, 0.05, 3, 0.5, 0] for sign in (-1, 1)]
    rows = np.array(walls)
    place = (rows[:, 0] + 1j * rows[:, 1]) * np.exp(1j * turn)
    rows[:, 0], rows[:, 1], rows[:, 6] = place.real, place.imag, turn
    return Scene("divided", "test", rows, np.empty((0, 5)), (-4.5, -4.5, 4.5, 4.5))


def through(scene: Scene, turn: float = 0.0) -> Task:
    end = 1.5 * np.exp(1j * turn)
    return Task("t", scene, (-end.real, -end.imag, 0.0), np.array([[end.real, end.imag]]))


@pytest.mark.parametrize("turn", [0.0, 0.3, 0.785])
def test_gaps_that_the_body_fits_through_are_ways(turn):
    """By hand: the body is 36 cm wide; 45 cm are a way at any angle to the grid, 30 cm and a closed wall are none."""
    for gap in (0.45, 0.6):
        check_task(through(divided(gap, turn), turn))
    for gap in (0.3, 0.0001):
        with pytest.raises(InputError, match=r"No way .* 36 cm.*\(the nearest is .*another goal.*unreachable"):
            check_task(through(divided(gap, turn), turn))
        check_task(through(divided(gap, turn), turn), unreachable=True)


@pytest.mark.parametrize(
    ("start", "goal", "words"),
    [
        ((580, 0, 0), (5, 1), "start at 580, 0 is outside room, which reaches from 0, 0 to 6, 4"),
        ((1, 1, 0), (8, 1), "goal at 8, 1 is outside room"),
        (
            (3, 1, 0),
            (5, 1),
            r"start at 3, 1 in room is inside an obstacle; .* 20 cm .*nearest is (2.725|3.275), (0.975|1.025)",
        ),
        ((1, 1, 0), (5.9, 1), "goal at 5.9, 1 in room is 10 cm from an obstacle"),
    ],
)
def test_places_outside_or_in_a_wall_are_refused(start, goal, words):
    """By hand, and whether or not the robot shall find out for itself."""
    for unreachable in (False, True):
        with pytest.raises(InputError, match=words):
            check_task(Task("t", room(), start, np.array([goal])), unreachable)


def test_goals_after_the_first_are_looked_at_too():
    with pytest.raises(InputError, match="goal at 9, 1 is outside"):
        check_task(Task("t", room(), (1, 1, 0), np.array([[5, 1], [9, 1]])))


def test_the_verdict_is_that_of_a_finely_drawn_scene():
    """Oracle: SciPy's distance transform and regions of generated scenes at 2.5 cm, with random starts and goals."""
    rng = np.random.default_rng(5)
    for task in generated_tasks(6, 40):
        fine = clearance_map(task.scene)
        for _ in range(8):
            ends = rng.uniform(task.scene.bounds[:2], task.scene.bounds[2:], (2, 2))
            drawn = Task("t", task.scene, (*ends[0], 0.0), ends[1:])
            try:
                check_task(drawn)
            except InputError:
                assert not connected(task.scene, fine, ends, 0.23)
            else:
                assert connected(task.scene, fine, ends, 0.14)


def test_the_grid_is_the_distance_cut_off():
    """Oracle: the distance to every obstacle at once, of a room with turned boxes and a column."""
    scene = room()
    grid = clearance_grid(scene, 0.1, 0.5)
    cells = np.argwhere(np.ones(grid.distance.shape, bool))
    exact = np.asarray(obstacle_distance(scene.arrays(), jnp.asarray(grid.centres(cells))))
    np.testing.assert_allclose(grid.distance.ravel(), np.minimum(exact, 0.5), atol=1e-5)


@pytest.mark.parametrize(
    "change",
    [{"start": ("a", "b", "c")}, {"start": (0.0, 0.0)}, {"goals": [[0.0, 1j]]}, {"scene": "office"},
     {"time_limit": math.inf}, {"time_limit": "60"}],
)  # fmt: skip
def test_what_makes_no_task_is_refused(change, unchecked_types):
    good = {"name": "t", "scene": room(), "start": (1.0, 1.0, 0.0), "goals": [[2.0, 1.0]], "time_limit": 60.0}
    with pytest.raises(InputError, match="Task t: "):
        Task(**good | change)

"""Each policy walks one short task. Oracle: the simulated robot's true state and the scene's own distances.

`default` walks in `test_closed_loop`, where more is asked of it; `published` has no feedback and falls soon.
"""

import numpy as np
import pytest

from iwalker_jax.navigation.episodes import EpisodeProgram
from iwalker_jax.navigation.navigators import make_navigator
from iwalker_jax.navigation.record import Outcome
from iwalker_jax.scenes.scene import Scene
from iwalker_jax.tasks.task import Task
from iwalker_jax.training.on_policy import memory_ipath_for
from iwalker_jax.training.pretrained import load_planner

GOAL = np.array([[1.3, 0.1]])
ROOM = Scene(
    "room",
    "test",
    np.array([[1.0, 1.3, 0.6, 2.0, 0.1, 0.6, 0], [1.0, -1.3, 0.6, 2.0, 0.1, 0.6, 0], [3.0, 0, 0.6, 0.1, 1.4, 0.6, 0]]),
    np.array([[1.1, -0.6, 0.6, 0.15, 0.6]]),
    (-1.0, -1.5, 3.2, 1.5),
)


@pytest.mark.parametrize("policy", ["networks", "memory", "classical"])
def test_a_policy_walks_to_a_near_goal_past_a_pillar(policy):
    navigator = make_navigator(policy, load_planner()[0], memory_ipath=memory_ipath_for(policy))
    program = EpisodeProgram(navigator, 1, devices=1)
    record = program.run([Task(policy, ROOM, (0.0, 0.0, 0.0), GOAL, 15.0)], seed=1)
    assert Outcome(int(record.outcome[0, -1])) == Outcome.REACHED
    assert np.linalg.norm(record.base[0, -1, :2] - GOAL[0]) < 0.4
    assert record.clearance.min() > 0
    assert not record.detour.any()

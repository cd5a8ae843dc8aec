"""`run_episodes`: tasks by name or as they are, one record and one row of figures each; the walking is pretended."""

from typing import ClassVar

import numpy as np
import pytest

from iwalker_jax.api import episodes, run_episodes
from iwalker_jax.errors import InputError
from iwalker_jax.navigation.record import Outcome
from iwalker_jax.tasks import Task, named_task
from iwalker_jax.walking import Disturbances
from tests.evaluation.episode_records import make_record


class Program:
    """Pretends to walk: the first task ends in a collision, the second with the robot at its goal."""

    made: ClassVar[list] = []
    compile_seconds, run_seconds = 3.0, 2.0

    def __init__(self, navigator, width, devices, images, disturbances):
        self.made.append((width, devices, images, disturbances))

    def run(self, tasks, seed, faults, on_progress):
        self.made.append((tuple(task.name for task in tasks), seed))
        on_progress(1.0, len(tasks))
        return make_record(outcomes=(Outcome.COLLIDED, Outcome.REACHED)[: len(tasks)], images=False)


@pytest.fixture
def pretended(monkeypatch):
    monkeypatch.setattr(Program, "made", [])
    monkeypatch.setattr(episodes, "EpisodeProgram", Program)
    return Program.made


def test_each_task_gets_its_record_and_figures(pretended):
    heard = []
    task = named_task("office", 5)
    result = run_episodes(
        [task, "corridor"], "classical", seed=4, images=True, disturbances=Disturbances(mass=0.2),
        on_progress=lambda seconds, running: heard.append((seconds, running)),
    )  # fmt: skip
    assert result.tasks[0] is task
    assert result.tasks[1].start == named_task("corridor", 4).start
    assert pretended == [(2, None, True, Disturbances(mass=0.2)), (("office", "corridor"), 4)]
    assert heard == [(1.0, 2)]
    assert len(result.records) == len(result.metrics) == 2
    assert result.outcomes[0] is Outcome.COLLIDED
    assert (result.compile_seconds, result.run_seconds) == (3.0, 2.0)
    for record, outcome in zip(result.records, result.outcomes, strict=True):
        assert int(record.outcome[-1]) == outcome
        assert np.all(np.asarray(record.outcome[:-1]) == Outcome.RUNNING)


def test_one_task_need_not_be_in_a_list(pretended):
    assert run_episodes("factory").tasks[0].name == "factory"
    assert run_episodes(named_task("factory")).outcomes == (Outcome.COLLIDED,)
    assert [width for width, *_ in pretended[::2]] == [1, 1]


def test_bad_options_are_refused(pretended):
    with pytest.raises(InputError, match="Unknown task 'moon'; choose one of factory"):
        run_episodes("moon")
    with pytest.raises(InputError, match="Unknown policy 'telepathy'; choose one of default"):
        run_episodes("office", "telepathy")
    task = named_task("factory")
    cut_off = Task("t", task.scene, task.start, np.array([[99.0, 0.0]]))
    with pytest.raises(InputError, match="goal at 99, 0 is outside"):
        run_episodes(["office", cut_off])
    assert pretended == []

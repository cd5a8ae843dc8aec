"""An episode in a scene: what is refused, how long it may take, and what it leaves, with the walking pretended.

Oracles: hand arithmetic, the demonstrations' own limits, and the command's sentences.
"""

import json
import math
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import trimesh
import tyro

from bruce_model import load_mujoco
from iwalker_jax.commands import walk
from iwalker_jax.commands.shared import scene_episode
from iwalker_jax.commands.shared.walk_options import EpisodeOptions, SharedOptions, WalkOptions, option_values
from iwalker_jax.errors import InputError
from iwalker_jax.navigation.body_volume import load_body_volume
from iwalker_jax.navigation.record import Outcome
from iwalker_jax.perception import Intrinsics
from iwalker_jax.tasks.named import demonstration
from iwalker_jax.tasks.routes import time_limit
from iwalker_jax.walking import Motion
from tests.evaluation.episode_records import make_record, room
from tests.experiments.commands import fails_with_one_sentence
from tests.scenes.test_user_scene import mesh_of


class Program:
    """Pretends to walk around the partition of `room`; keeps what it was made and run with."""

    made: ClassVar[list] = []
    compile_seconds = run_seconds = 1.0

    def __init__(self, navigator, width, devices, images, disturbances):
        self.made.append(disturbances)

    def run(self, tasks, seed, on_progress):
        self.made.append(tasks[0])
        return make_record(outcomes=(Outcome.COLLIDED,), images=True)


@pytest.fixture
def pretended(monkeypatch):
    class Navigator:
        volume = load_body_volume(load_mujoco())
        intrinsics = Intrinsics()

    monkeypatch.setattr(Program, "made", [])
    monkeypatch.setattr(scene_episode, "EpisodeProgram", Program)
    monkeypatch.setattr(scene_episode, "planner_of", lambda run: (None, None, "pretrained"))
    monkeypatch.setattr(scene_episode, "make_navigator", lambda *arguments, memory_ipath: Navigator())
    return Program.made


@pytest.fixture
def file(tmp_path):
    """The room as a mesh."""
    mesh_of(room()).export(tmp_path / "room.stl")
    return tmp_path / "room.stl"


def test_a_machine_that_cannot_draw_keeps_its_other_results(pretended, file, tmp_path, capsys, monkeypatch):
    """Property: the missing film is a sentence; the outcome is a name; the file's own surfaces are measured."""

    def blind(*arguments):
        raise InputError("there is nothing to draw with.")

    monkeypatch.setattr(scene_episode, "write_film", blind)
    options = ["--scene", str(file), "--start", "1", "1", "0", "--goals", "5", "1", "--out", str(tmp_path / "out")]
    assert walk.main([*options, "--push-impulse", "1"]) == 0
    printed = capsys.readouterr().out
    assert "No film: there is nothing to draw with." in printed and "Trace and figures are in" in printed
    assert "Least distance to the surfaces of room.stl itself" in printed
    figures = json.loads((tmp_path / "out" / "figures.json").read_text())
    assert (figures["task"], figures["outcome"]) == ("room", "COLLIDED")
    # The record passes the partition's corner at (3, 2) on its way through (3, 2.7).
    assert 0.2 < figures["surface_distance"] < 0.7
    assert (tmp_path / "out" / "trace.png").exists() and not (tmp_path / "out" / "film.mp4").exists()
    disturbances, task = pretended
    assert disturbances.push_impulse == 1
    # Around the partition's end at (3, 2) the way is longer than straight ahead; the push comes halfway at 0.25 m/s.
    length = scene_episode.allowed_length(task)
    assert 2 * math.dist((1, 1), (3, 2.2)) < length < 6
    assert disturbances.push_after == pytest.approx(length / 0.25 / 2)
    assert task.time_limit == pytest.approx(time_limit(length))


def task_of(*options):
    command = tyro.cli(walk.Command, args=list(options))
    return scene_episode.task_of(command.episode, command.shared.seed)


def test_the_time_limit_is_that_of_the_tour():
    """Oracle: the demonstration's own limit for its own goals; there and back takes twice as long."""
    own = demonstration("office")
    goals = own.goals.ravel().tolist()
    assert task_of("--scene", "office").time_limit == own.time_limit
    same = task_of("--scene", "office", "--goals", *map(str, goals))
    assert same.time_limit == pytest.approx(own.time_limit)
    back = [*goals, *own.start[:2]]
    task = task_of("--scene", "office", "--goals", *map(str, back))
    assert task.time_limit - time_limit(0) == pytest.approx(2 * (own.time_limit - time_limit(0)), rel=0.05)
    x, y = own.start[0] + 0.2, own.start[1]
    moved = task_of("--scene", "office", "--start", str(x), str(y), "90")
    assert moved.start == pytest.approx((x, y, math.pi / 2)) and np.array_equal(moved.goals, own.goals)


def test_the_robot_may_find_out_that_a_goal_is_cut_off(tmp_path):
    """By hand: twice the straight line is allowed where no way leads."""
    box = trimesh.creation.box(bounds=[[2.9, -1, 0], [3.1, 5, 1]])
    trimesh.util.concatenate([mesh_of(room()), box]).export(tmp_path / "cut.stl")
    options = ("--scene", str(tmp_path / "cut.stl"), "--start", "1", "1", "0", "--goals", "5", "1")
    with pytest.raises(InputError, match="No way"):
        task_of(*options)
    assert task_of(*options, "--unreachable").time_limit == pytest.approx(time_limit(2 * 4))


def test_bounds_cut_a_scene_file(file):
    options = ("--scene", str(file), "--start", "1", "1", "0", "--goals", "2", "1")
    assert task_of(*options, "--bounds", "-0.5", "0", "2.5", "4").scene.bounds == (
        -0.5,
        0,
        2.5,
        4,
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--start", "3", "1", "0", "--goals", "5", "1"], "3, 1 in room is inside an obstacle"),
        (["--start", "2.85", "1", "0", "--goals", "5", "1"], "is 10 cm from an obstacle"),
        (["--start", "1", "1", "0", "--goals", "8", "1"], "goal at 8, 1 is outside"),
        (["--start", "1", "1", "0"], "Where to"),
        (["--goals", "1", "1", "--robots", "3", "--push-axis", "y"], "with --scene takes no --robots;"),
        (
            ["--goals", "1", "1", "--motion", "turn", "--step-length", "0.1", "--view"],
            "no --motion, --step-length, --view",
        ),
    ],
)
def test_what_a_scene_file_cannot_do_is_one_sentence(file, tmp_path, capsys, options, words):
    run = lambda: walk.main(["--scene", str(file), *options, "--out", str(tmp_path)])  # noqa: E731
    assert words in fails_with_one_sentence(run, capsys)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--goals", "1", "2"], "without --scene takes no --goals"),
        (
            ["--start", "0", "0", "0", "--run", "runs/x", "--policy", "classical"],
            "--policy, --run, --start",
        ),
        (["--scene", "office", "--bounds", "0", "0", "1", "1"], "--bounds belongs to a scene file"),
        (["--scene", "ballroom"], "Unknown scene 'ballroom'"),
    ],
)
def test_options_of_the_other_kind_of_walk_are_one_sentence(tmp_path, capsys, options, words):
    assert words in fails_with_one_sentence(lambda: walk.main([*options, "--out", str(tmp_path)]), capsys)


def test_every_option_belongs_to_a_kind_of_walk():
    """Property: what neither kind refuses is heeded by both, and no two kinds share a name."""
    kinds = [set(option_values(options())) for options in (EpisodeOptions, WalkOptions, SharedOptions)]
    names = set(option_values(walk.Command()))
    assert names == set.union(*kinds) and len(names) == sum(map(len, kinds))


def test_a_motion_is_asked_for_by_the_names_of_its_fields():
    """Oracle: the motion written by hand."""
    options = ["--motion", "turn", "--turn", "20", "--seconds", "3", "--width", "0.12"]
    assert tyro.cli(walk.Command, args=options).walk.motion.motion() == Motion("turn", turn=20, seconds=3, width=0.12)
    steps = tyro.cli(walk.Command, args=["--footsteps", "steps.csv"]).walk.motion.motion()
    assert steps == Motion("footsteps", file=Path("steps.csv"))

"""The walking commands run in this process: what they print and leave, and one sentence for bad input."""

import csv
import json

import cv2
import numpy as np
import pytest

from iwalker_jax.commands import walk, walk_study
from iwalker_jax.commands.shared.console import console
from iwalker_jax.evaluation.walks.tables import WALK_COLUMNS
from iwalker_jax.walking import Disturbances, Motion
from tests.experiments.commands import fails_with_one_sentence


def test_a_walk_leaves_figures_pictures_and_records(tmp_path):
    options = ["--motion", "in_place", "--seconds", "1", "--robots", "2", "--no-video", "--out", str(tmp_path)]
    with console.capture() as printed:
        assert walk.main(options) == 0
    text = printed.get()
    for words in ("Footstep error", "COM error", "Heading error", "Torque peak", "Falls", "robot-seconds a second"):
        assert words in text
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["figures"]["falls"] == 0
    assert [robot["steps"] for robot in summary["robots"]] == [4, 4]
    assert 0 < summary["figures"]["torque peak %"] <= 100
    with np.load(tmp_path / "samples.npz") as record:
        assert record["qpos"].shape[0] == 2 and np.isfinite(record["qpos"]).all()
        assert np.all((record["conditions_friction"] >= 0.5) & (record["conditions_friction"] <= 1.0))
    for name in ("walk.png", "traces.png"):
        assert cv2.imread(str(tmp_path / name)).std() > 5


def test_a_study_writes_a_row_a_case(tmp_path, monkeypatch):
    cases = [
        walk_study.Case("stand", Motion("stand", seconds=1.0)),
        walk_study.Case("pushed", Motion("in_place", seconds=1.0), Disturbances(push_impulse=0.5), many=True),
    ]
    monkeypatch.setattr(walk_study, "SUITES", {"small": lambda: cases})
    monkeypatch.setattr(walk_study, "_ROWS", 64)
    options = ["--suites", "small", "--seeds", "2", "--trials", "3", "--out", str(tmp_path)]
    assert walk_study.main(options) == 0
    with (tmp_path / "walk_study.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["case"], float(row["robots"]), float(row["falls"])) for row in rows] == [
        ("stand", 2, 0),
        ("pushed", 3, 0),
    ]
    assert [row["steps made %"] for row in rows] == ["nan", "100.0"]
    assert "falls: walks that ended in a fall" in (tmp_path / "walk_study.md").read_text()


@pytest.fixture
def measured(monkeypatch):
    """Three cases that only pretend to be walked; the names of those that were, "c" being stopped the first time."""
    walked = []

    def measure(case, walker, engine, robots, seed):
        walked.append(case.name)
        if case.name == "c" and walked.count("c") == 1:
            raise KeyboardInterrupt
        return dict.fromkeys([column.title for column in WALK_COLUMNS], 1.0) | {"robots": float(robots)}

    cases = [walk_study.Case(name, Motion("stand", seconds=1.0), many=name == "b") for name in "abc"]
    monkeypatch.setattr(walk_study, "SUITES", {"small": lambda: cases})
    monkeypatch.setattr(walk_study, "measure", measure)
    monkeypatch.setattr(walk_study, "CompiledWalker", lambda *arguments: None)
    return walked


def test_a_stopped_study_goes_on_where_it_was(measured, tmp_path, capsys):
    """Only what the tables do not hold with as many robots and the same seed is walked; what they hold stays."""
    options = ["--suites", "small", "--out", str(tmp_path), "--seeds", "2"]
    assert walk_study.main([*options, "--trials", "3"]) == 130
    assert "goes on" in capsys.readouterr().out
    assert walk_study.main([*options, "--trials", "3"]) == 0
    assert "1/3 small, a, mjx: is there already, 2 robots" in capsys.readouterr().out
    assert measured == ["a", "b", "c", "c"]
    assert walk_study.main([*options, "--trials", "4"]) == 0
    assert measured[4:] == ["b"]
    assert walk_study.main([*options, "--trials", "4", "--seed", "1"]) == 0
    assert measured[5:] == ["a", "b", "c"]
    with (tmp_path / "walk_study.csv").open() as stream:
        rows = [(row["case"], row["seed"], float(row["robots"])) for row in csv.DictReader(stream)]
    first = [("a", "0", 2.0), ("b", "0", 3.0), ("c", "0", 2.0), ("b", "0", 4.0)]
    assert rows == [*first, ("a", "1", 2.0), ("b", "1", 4.0), ("c", "1", 2.0)]


def test_the_study_asks_for_what_it_says():
    cases = walk_study.cases_of("nominal, pushes,robust,limits")
    names = [(suite, case.name) for suite, case in cases]
    assert {suite for suite, case in cases if case.many} == {"pushes", "robust"}
    assert all(case.many == (suite in ("pushes", "robust")) for suite, case in cases)
    assert len(names) == len(set(names)) == 14 + 4 + 3 + 7
    assert ("nominal", "S-curve 3 m, 6 cm steps") in names and ("pushes", "push y 1 N s") in names


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--speed", "7"], "speed"),
        (["--robots", "0"], "0 robots were asked for; give 1 to"),
        (["--robots", "1000000000"], "give 1 to 65536"),
        (["--seed", "-1"], "seed of the robots' conditions is -1"),
        (["--path", "long.csv"], "at most 1000 m"),
        (["--motion", "straight", "--distance", "900", "--speed", "1e-9"], "100000 steps"),
        (["--footsteps", "missing.csv"], "cannot be read"),
        (["--footsteps", "a.csv", "--path", "b.csv"], "choose one"),
        (["--friction", "1", "0.5"], "smaller first"),
        (["--motion", "path"], "give a file"),
        (["--devices", "99"], "devices"),
        (["--scene", "office", "--run", "nowhere"], "nowhere holds no checkpoints"),
        (["--scene", "office", "--policy", "runs/mine"], "Unknown policy"),
    ],
)
def test_bad_options_are_one_sentence(tmp_path, capsys, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "long.csv").write_text("0, 0\n1e6, 0\n")
    assert words in fails_with_one_sentence(lambda: walk.main([*options, "--out", str(tmp_path)]), capsys)


def test_bad_suites_are_one_sentence(tmp_path, capsys):
    sentence = fails_with_one_sentence(lambda: walk_study.main(["--suites", "fast", "--out", str(tmp_path)]), capsys)
    assert "nominal, pushes, robust, limits" in sentence

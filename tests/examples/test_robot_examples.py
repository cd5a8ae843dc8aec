"""The examples that simulate the robot or train its networks, in small: what they say and write."""

import re

from tests.examples.example_runs import is_picture, numbers, run


def test_walk(tmp_path):
    text = run("walk", tmp_path, "--speed", "0.2", "--distance", "0.4", "--sensors", "none", "--out", "out")
    made, planned = numbers(text)[:2]
    assert made == planned > 4
    assert "fallen: False" in text
    assert is_picture(tmp_path / "out/walk_sheet.png")


def test_push_recovery(tmp_path):
    text = run("push_recovery", tmp_path, "--robots", "2", "--seconds", "1", "--impulse", "0.5", "--out", "out")
    assert "2 of 2 robots kept their feet after a push of 0.5 N s along y." in text
    assert is_picture(tmp_path / "out/pushes.png")


def test_navigate(tmp_path):
    text = run("navigate", tmp_path, "--task", "corridor", "--time-limit", "2", "--out", "out")
    assert re.search(r"corridor: TIMED_OUT after 2\.\d s", text)
    assert is_picture(tmp_path / "out/episode.png")


def test_train_on_folder(tmp_path):
    text = run("train_on_folder", tmp_path, "--images", "8", "--epochs", "1", "--out", "out")
    assert re.search(r"8 images, 1 steps: loss \S+ at first", text)
    assert len(list((tmp_path / "out/recording").glob("*.png"))) == 8
    assert (tmp_path / "out/run/checkpoints").is_dir()

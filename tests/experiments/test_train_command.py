"""The training command from arguments to tables, its resumption after a kill, and every bad input in one sentence."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest

from iwalker_jax.commands import train
from iwalker_jax.training.checkpoints import CheckpointStore
from iwalker_jax.training.run_log import read_metrics
from tests.data.recording_folders import write_yaml_recording
from tests.experiments.commands import SCENES, SMALL, fails_with_one_sentence, train_command
from tests.training.conftest import assert_trees_equal


def final_state(folder):
    store = CheckpointStore(folder / "checkpoints")
    try:
        found = store.restore_latest()
    finally:
        store.close()
    assert found is not None
    return found[0]


def test_a_run_leaves_everything_it_promises(finished_run, cache):
    folder, status, _ = finished_run
    assert status == 0
    config = train.parse(["--config", str(folder / "config.json")]).training
    assert (config.source.frames, config.epochs, config.batch_size) == (16, 2, 8)
    assert (config.planner.ipath.trunk_width, config.planner.ipath.hidden) == (4, 16)
    lines = read_metrics(folder / "metrics.jsonl")
    assert [line["step"] for line in lines] == [0, 1, 2, 3]
    assert all(np.isfinite(list(line.values())).all() for line in lines)
    assert int(final_state(folder).step) == 4
    for scene in (*SCENES, "unseen"):
        sheet = cv2.imread(str(folder / "evaluation" / f"{scene}.png"))
        assert sheet is not None and sheet.std() > 10
    with (folder / "evaluation" / "table.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    plans = ("planner", "stand still", "straight line")
    assert [(row["scene"], row["plans"]) for row in rows] == [(s, p) for s in (*SCENES, "unseen") for p in plans]
    assert all(np.isfinite(float(row["feasibility"])) and 0 <= float(row["served %"]) <= 100 for row in rows)
    assert list((cache / "frames").glob("16-0-*.npz"))


def test_the_console_shows_progress_table_and_legend(finished_run):
    printed = finished_run.printed
    for words in ("depth frames", "maps", "training", "U_path", "served %", "lower is better", "All done in"):
        assert words in printed


def test_the_same_command_again_resumes_and_changes_nothing(finished_run, tmp_path, capsys):
    """A finished run is evaluated again, not trained again."""
    folder = tmp_path / "copy"
    shutil.copytree(finished_run.folder, folder)
    before, metrics = final_state(folder), (folder / "metrics.jsonl").read_text()
    assert train_command(folder) == 0
    assert_trees_equal(final_state(folder), before)
    assert (folder / "metrics.jsonl").read_text() == metrics


def test_the_file_of_a_run_repeats_it_bit_for_bit(finished_run, tmp_path):
    """Oracle: the run itself, which was told every option; only its speed may differ."""
    folder = tmp_path / "again"
    arguments = ["--config", str(finished_run.folder / "config.json"), "--out", str(folder)]
    assert train.main([*arguments, "--unseen-scenes", "0"]) == 0
    assert_trees_equal(final_state(folder), final_state(finished_run.folder))
    first, again = (read_metrics(path / "metrics.jsonl") for path in (finished_run.folder, folder))
    for line in (*first, *again):
        line.pop("frames_per_second")
    assert again == first
    before, after = (json.loads((path / "config.json").read_text()) for path in (finished_run.folder, folder))
    assert before | {"unseen_scenes": 0} == after


def test_another_configuration_in_the_same_folder_is_refused(finished_run, capsys):
    sentence = fails_with_one_sentence(lambda: train_command(finished_run.folder, "--learning-rate", "0.5"), capsys)
    assert "another configuration" in sentence


def test_a_killed_run_resumes_to_the_same_result(finished_run, cache, tmp_path):
    """Kill -9 in mid-training; oracle: the parameters of the uninterrupted run."""
    folder = tmp_path / "killed"
    environment = os.environ | {"IWALKER_CACHE": str(cache)}
    command = [sys.executable, "-m", "experiments.train", "--out", str(folder), *SMALL]
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        deadline = time.monotonic() + 300
        while not (folder / "checkpoints" / "2").is_dir() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        _, stderr = process.communicate()
    assert process.returncode == -signal.SIGKILL, stderr
    assert (folder / "checkpoints" / "2").is_dir()
    assert not (folder / "config.json").exists()
    assert train_command(folder) == 0
    assert [line["step"] for line in read_metrics(folder / "metrics.jsonl")] == [0, 1, 2, 3]
    for whole, resumed in zip(_leaves(final_state(finished_run.folder)), _leaves(final_state(folder)), strict=True):
        np.testing.assert_allclose(whole, resumed, atol=1e-4)


def _leaves(state):
    import jax

    return [np.asarray(leaf) for leaf in jax.tree.leaves(state.params)]


def test_ones_own_recording_trains(tmp_path, capsys):
    """With a damaged image in it, which is said and left out."""
    recording = write_yaml_recording(tmp_path / "walk", count=4, poses=[[0.1 * k, 0.0, 0.0] for k in range(4)])
    image = recording / "depth" / "000002.png"
    image.write_bytes(image.read_bytes()[:-300])
    folder = tmp_path / "run"
    assert train_command(folder, "--data", str(recording), "--epochs", "1", "--unseen-scenes", "0") == 0
    printed = capsys.readouterr().out
    assert "000002.png" in printed
    assert "truncated" in printed
    config = json.loads((folder / "config.json").read_text())
    assert config["source"]["folder"] == str(recording)
    assert len(read_metrics(folder / "metrics.jsonl")) == 1


def _recording_of_truncated_images(tmp_path):
    folder = write_yaml_recording(tmp_path / "bad", count=2)
    for image in (folder / "depth").iterdir():
        image.write_bytes(image.read_bytes()[:-300])
    return folder


def _empty_folder(tmp_path):
    (tmp_path / "void").mkdir()
    return tmp_path / "void"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (_recording_of_truncated_images, "truncated"),
        (_empty_folder, "known layouts"),
        (lambda tmp_path: tmp_path / "nowhere", "no such folder"),
    ],
)
def test_bad_recordings_are_one_sentence(tmp_path, capsys, make, words):
    sentence = fails_with_one_sentence(lambda: train_command(tmp_path / "run", "--data", str(make(tmp_path))), capsys)
    assert words in sentence


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--preset", "turbo"), "Unknown preset 'turbo'"),
        (("--preset=",), "Unknown preset"),
        (("--epochs", "0"), "at least 1"),
        (("--learning-rate", "-1"), "positive"),
        (("--learning-rate", "nan"), "positive"),
        (("--source.frames", "3"), "cannot cover"),
        (("--source.frames", "-5"), "cannot cover"),
        (("--devices", "64"), "devices"),
        (("--seed", "-1"), "seed of the training is -1"),
        (("--seed", "1" + 400 * "0"), "seed of the training"),
        (("--batch-size", "1000000000"), "at most 65536"),
        (("--unseen-scenes", "1000000000"), "at most 1000000"),
    ],
)
def test_bad_options_are_one_sentence(tmp_path, capsys, arguments, words):
    assert words in fails_with_one_sentence(lambda: train_command(tmp_path, *arguments), capsys)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--planner.ipath.trunk-width", "1"), "4 trunk channels"),
        (("--source.seed", "-1"), "seed of the frames is -1"),
        (("--source.frames", "1000000000"), "at most 1000000"),
        (("--epochs", "many"), "invalid literal"),
        (("--colour", "blue"), "--colour"),
    ],
)
def test_options_that_do_not_parse_are_explained(tmp_path, capsys, arguments, words):
    """The argument parser's own exit: status 2, no traceback."""
    with pytest.raises(SystemExit) as caught:
        train_command(tmp_path, *arguments)
    assert caught.value.code == 2
    stderr = " ".join(capsys.readouterr().err.split())
    assert words in stderr.replace("│ ", "")
    assert "Traceback" not in stderr


def test_an_output_folder_that_cannot_be_made_is_one_sentence(tmp_path, capsys):
    (tmp_path / "taken").write_text("a file")
    sentence = fails_with_one_sentence(lambda: train_command(tmp_path / "taken" / "run"), capsys)
    assert "taken" in sentence


def test_a_run_with_only_damaged_checkpoints_is_one_sentence(finished_run, tmp_path, capsys):
    folder = tmp_path / "damaged"
    shutil.copytree(finished_run.folder, folder)
    for file in (folder / "checkpoints").rglob("*"):
        if file.is_file():
            file.write_bytes(b"")
    sentence = fails_with_one_sentence(lambda: train_command(folder), capsys)
    assert "cannot be read" in sentence


def test_a_reader_who_has_gone_ends_a_command_without_a_word(tmp_path):
    """`--help | head -1`. Oracle: the shell's status of a program that a closed pipe ended.

    The pipe is closed before the command begins: a reader that leaves after its first line can come too late.
    """
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "experiments.train", "--help"]
    try:
        done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    finally:
        os.close(writer)
    assert (done.stderr, done.returncode) == ("", 128 + signal.SIGPIPE)

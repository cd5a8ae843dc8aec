"""The evaluation command: the same table as after training, one's own recording, and bad runs in one sentence."""

import csv
import json
import re
import shutil

import cv2
import jax
import pytest
from flax import nnx

from iwalker_jax.commands import evaluate
from iwalker_jax.commands.shared.config_file import parse_options
from iwalker_jax.commands.shared.planners import fingerprint, planner_of
from iwalker_jax.planning import MemoryIPath, MemoryIPathConfig
from iwalker_jax.training.on_policy import NETWORK_FILE, OnPolicyConfig, load_memory_ipath, save_memory_ipath
from tests.data.recording_folders import write_yaml_recording
from tests.evaluation.episode_records import StubProgram
from tests.experiments.commands import SCENES, evaluate_command, evaluate_episodes_command, fails_with_one_sentence


def read_table(folder):
    with (folder / "table.csv").open() as stream:
        return {row.pop("scene"): row for row in csv.DictReader(stream) if row.pop("plans") == "planner"}


def test_evaluation_repeats_the_table_of_training(finished_run, tmp_path, capsys):
    """Oracle: the table that the training command left, from the parameters it had in memory."""
    assert evaluate_command(finished_run.folder, "--out", str(tmp_path / "new")) == 0
    again, first = read_table(tmp_path / "new"), read_table(finished_run.folder / "evaluation")
    assert list(again) == list(SCENES)
    for scene, row in again.items():
        for title, value in row.items():
            assert float(value) == pytest.approx(float(first[scene][title]), rel=1e-3, abs=1e-3, nan_ok=True)
    printed = capsys.readouterr().out
    assert "Checkpoint of step 4 (iwalker)" in printed
    assert "lower is better" in printed


def test_an_earlier_checkpoint_gives_another_table(finished_run, tmp_path, capsys):
    assert evaluate_command(finished_run.folder, "--out", str(tmp_path), "--checkpoint", "2") == 0
    assert "Checkpoint of step 2" in capsys.readouterr().out
    first = read_table(finished_run.folder / "evaluation")
    assert read_table(tmp_path)["office"]["feasibility"] != first["office"]["feasibility"]


def test_ones_own_recording_is_scored_without_ground_truth(finished_run, tmp_path):
    recording = write_yaml_recording(tmp_path / "walk", count=2)
    assert evaluate_command(finished_run.folder, "--data", str(recording), "--out", str(tmp_path / "out")) == 0
    again = parse_options(evaluate.Command, ["--config", str(tmp_path / "out" / "config.json")])
    assert (again.run, again.data, again.scenes) == (finished_run.folder, recording, SCENES)
    row = read_table(tmp_path / "out")["recording"]
    assert row["served %"] == "nan"
    assert float(row["feasibility"]) > 0
    sheet = cv2.imread(str(tmp_path / "out" / "recording.png"))
    assert sheet is not None and sheet.std() > 10


@pytest.fixture
def pretended(monkeypatch):
    """Programs that only pretend to walk; the policies that were made."""
    made = []

    def runner_maker(command, planners):
        def make(policy, width, images):
            made.append(policy)
            return StubProgram(images)

        return make

    monkeypatch.setattr(evaluate, "runner_maker", runner_maker)
    return made


def test_walks_are_logged_tabled_and_reported_and_not_repeated(finished_run, pretended, tmp_path, capsys):
    arguments = ("--episodes", "corridor,office", "--policies", "default,classical", "--out", str(tmp_path))
    assert evaluate_episodes_command(finished_run.folder, *arguments) == 0
    assert pretended == ["default", "classical"]
    with (tmp_path / "episodes.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["policy"], row["episode_set"]) for row in rows[::2]] == [
        (policy, walks) for policy in pretended for walks in ("corridor", "office")
    ]
    assert "success %" in capsys.readouterr().out
    assert "step 4" in (tmp_path / "report.html").read_text()
    assert not (tmp_path / "table.csv").exists()
    assert evaluate_episodes_command(finished_run.folder, *arguments) == 0
    assert len(pretended) == 2 and "4 of 4 batches" in capsys.readouterr().out


def test_networks_of_several_runs_walk_in_one_table(finished_run, pretended, tmp_path):
    folder = finished_run.folder
    policies = f"classical,networks,networks@{folder}"
    assert evaluate.main(["--unseen-scenes", "0", "--scenes", "--no-videos", "--episodes", "corridor", "--seeds", "2",
                          "--policies", policies, "--out", str(tmp_path)]) == 0  # fmt: skip
    own, other = (planner_of(run)[2] for run in (None, folder))
    assert own.startswith("pretrained (") and other.startswith(f"{folder}, step 4 (")
    assert pretended == ["classical", "networks", f"networks@{other}"]
    with (tmp_path / "episodes.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["policy"], row["planner"]) for row in rows[::2]] == [
        ("classical", own),
        ("networks", own),
        ("networks", other),
    ]
    with (tmp_path / "episode_table.csv").open() as stream:
        assert {row["policy"] for row in csv.DictReader(stream)} == set(pretended)
    assert len(list((tmp_path / "sheets").glob("*.png"))) == 3


def test_a_trained_memory_walks_beside_the_shipped_one(pretended, tmp_path):
    """Oracle: the rows' names hold the fingerprint of the very parameters."""
    config = OnPolicyConfig(network=MemoryIPathConfig(hidden=8, judging=8))
    network = MemoryIPath(config.network, nnx.Rngs(1))
    save_memory_ipath(tmp_path / NETWORK_FILE, network, config)
    assert evaluate.main(["--unseen-scenes", "0", "--scenes", "--no-videos", "--episodes", "corridor", "--seeds", "2",
                          "--policies", f"memory,memory@{tmp_path}", "--out", str(tmp_path / "out")]) == 0  # fmt: skip
    shipped, own = load_memory_ipath()[0], load_memory_ipath(tmp_path / NETWORK_FILE)[0]
    assert pretended == [f"memory@shipped ({fingerprint(shipped)})", f"memory@{tmp_path} ({fingerprint(own)})"]


def test_a_planners_name_changes_with_its_parameters(finished_run):
    """Another checkpoint of the same run has other parameters, as has a run that is trained again into its folder."""
    planner = planner_of(finished_run.folder)[0]
    prints = {
        fingerprint(planner),
        fingerprint(planner_of(finished_run.folder, 2)[0]),
        fingerprint(planner_of(None)[0]),
    }
    assert len(prints) == 3 and all(re.fullmatch("[0-9a-f]{8}", digits) for digits in prints)
    assert fingerprint(planner_of(finished_run.folder)[0]) in prints
    params = nnx.state(planner, nnx.Param)
    leaves, structure = jax.tree.flatten(params)
    leaves[0] = leaves[0].at[(0,) * leaves[0].ndim].add(1e-3)
    nnx.update(planner, jax.tree.unflatten(structure, leaves))
    assert fingerprint(planner) not in prints


def test_a_stopped_command_says_how_to_go_on(finished_run, tmp_path, monkeypatch, capsys):
    def stopped(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluate, "runner_maker", lambda command, planners: stopped)
    assert evaluate_episodes_command(finished_run.folder, "--episodes", "corridor", "--out", str(tmp_path)) == 130
    assert "goes on" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--episodes", "ballroom"), "ballroom"),
        (("--policies", "psychic"), "psychic"),
        (("--policies", "networks@nowhere"), "nowhere"),
    ],
)
def test_unknown_walks_and_policies_are_one_sentence(finished_run, tmp_path, capsys, arguments, words):
    run = lambda: evaluate_episodes_command(finished_run.folder, "--out", str(tmp_path), *arguments)  # noqa: E731
    assert words in fails_with_one_sentence(run, capsys)


def test_a_checkpoint_without_a_run_is_one_sentence(capsys):
    assert "--run" in fails_with_one_sentence(lambda: evaluate.main(["--checkpoint", "3"]), capsys)


def _copy(finished_run, tmp_path):
    shutil.copytree(finished_run.folder, tmp_path / "copy")
    return tmp_path / "copy"


def test_a_damaged_newest_checkpoint_is_said_and_the_one_before_is_used(finished_run, tmp_path, capsys):
    run = _copy(finished_run, tmp_path)
    for file in (run / "checkpoints" / "4" / "state").rglob("*"):
        if file.is_file():
            file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert evaluate_command(run, "--out", str(tmp_path / "out")) == 0
    printed = capsys.readouterr().out
    assert "Checkpoint 4" in printed and "cannot be read" in printed
    assert "Checkpoint of step 2" in printed


def test_only_damaged_checkpoints_are_one_sentence(finished_run, tmp_path, capsys):
    run = _copy(finished_run, tmp_path)
    for file in (run / "checkpoints").rglob("*"):
        if file.is_file():
            file.write_bytes(b"")
    assert "cannot be read" in fails_with_one_sentence(lambda: evaluate_command(run), capsys)


def test_a_checkpoint_of_another_version_is_one_sentence(finished_run, tmp_path, capsys):
    run = _copy(finished_run, tmp_path)
    for file in (run / "checkpoints").glob("*/meta/metadata"):
        meta = json.loads(file.read_text())
        meta["config"]["colour"] = "blue"
        file.write_text(json.dumps(meta))
    sentence = fails_with_one_sentence(lambda: evaluate_command(run), capsys)
    assert "colour" in sentence


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--checkpoint", "3"), "no checkpoint 3"),
        (("--data", "nowhere"), "no such folder"),
        (("--scenes", "ballroom"), "ballroom"),
    ],
)
def test_bad_options_are_one_sentence(finished_run, tmp_path, capsys, arguments, words):
    run = lambda: evaluate_command(finished_run.folder, "--out", str(tmp_path), *arguments)  # noqa: E731
    assert words in fails_with_one_sentence(run, capsys)


@pytest.mark.parametrize("made", [False, True])
def test_a_missing_or_empty_run_is_one_sentence(tmp_path, capsys, made):
    folder = tmp_path / "absent"
    if made:
        (folder / "checkpoints").mkdir(parents=True)
    sentence = fails_with_one_sentence(lambda: evaluate_command(folder), capsys)
    assert "checkpoint" in sentence
    assert "iwalker-train" in sentence

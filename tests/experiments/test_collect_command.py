"""The collecting command: batches that are kept as they come, and going on with them after Ctrl-C."""

from types import SimpleNamespace

import numpy as np
import pytest

from iwalker_jax.commands import collect
from iwalker_jax.commands.shared.config_file import parse_options
from iwalker_jax.data.frame_set import FrameSet, load_frames
from iwalker_jax.navigation.episodes import RunProgress
from iwalker_jax.navigation.record import Outcome
from iwalker_jax.perception import Intrinsics
from tests.evaluation.episode_records import make_task
from tests.experiments.commands import fails_with_one_sentence


@pytest.fixture
def run_seeds(monkeypatch):
    """Batches of two that only pretend to be run; the seeds of those that were, of which 4 is stopped once."""
    seeds = []

    class Program:
        width = 2

        def __init__(self, *arguments, **options):
            pass

        def run(self, tasks, seed):
            seeds.append(seed)
            if seed == 4 and seeds.count(4) == 1:
                raise KeyboardInterrupt
            return SimpleNamespace(outcome=np.array([[Outcome.RUNNING, Outcome.REACHED]] * len(tasks)))

        def run_batches(self, batches, on_progress):
            for number, batch in enumerate(batches):
                on_progress(RunProgress(0.0, 0, len(batch.tasks)))
                yield number, self.run(batch.tasks, batch.seed)

    def frames(camera, intrinsics, tasks, record, stride, seed):
        n = len(tasks)
        depth, zeros = np.full((n, 2, 3), seed, np.uint16), np.zeros((n, 5), np.float32)
        return FrameSet(depth, zeros, zeros[:, None, :2], zeros[:, :3], np.zeros(n, np.int32), (f"{seed}",), intrinsics)

    monkeypatch.setattr(collect, "EpisodeProgram", Program)
    monkeypatch.setattr(collect, "frames_from_episodes", frames)
    monkeypatch.setattr(collect, "training_task", lambda seed: make_task(f"training-{seed}"))
    monkeypatch.setattr(collect, "planner_of", lambda run: (None, None, f"networks of {run}"))
    navigator = SimpleNamespace(camera=None, intrinsics=Intrinsics(3, 2, 2.0, 2.0, 1.0, 0.5))
    monkeypatch.setattr(collect, "make_navigator", lambda policy, planner, memory_ipath: navigator)
    return seeds


def test_a_stopped_collection_goes_on_where_it_was(run_seeds, tmp_path, capsys):
    """Oracle: which batches were run, and their frames, filled with their own seeds."""
    file = tmp_path / "episodes.npz"
    options = ["--tasks", "5", "--out", str(file)]
    assert collect.main(options) == 130
    assert "goes on" in capsys.readouterr().out and not file.exists()
    sentence = fails_with_one_sentence(lambda: collect.main([*options, "--stride", "3"]), capsys)
    assert "other options" in sentence
    assert collect.main(options) == 0
    assert run_seeds == [0, 2, 4, 4]
    printed = capsys.readouterr().out
    assert "2 batches are there already" in printed and "5 frames of 5 episodes (5 reached)" in printed
    frames = load_frames(file)
    assert list(frames.depth[:, 0, 0]) == [0, 0, 2, 2, 4] and frames.scene_names == ("0", "2", "4")
    assert not (tmp_path / "episodes.parts").exists()
    again = parse_options(collect.Command, ["--config", str(tmp_path / "episodes.json")])
    assert (again.tasks, again.seed, again.out) == (5, 0, collect.Command.out)


@pytest.mark.parametrize("what", ["frames", "ends", "no ends", "settings"])
def test_a_collection_goes_on_after_damage_and_a_kill_between_two_files(run_seeds, tmp_path, capsys, what):
    """Oracle: which batches were run; the one whose files are not whole is run again."""
    file = tmp_path / "episodes.npz"
    options, folder = ["--tasks", "5", "--out", str(file)], tmp_path / "episodes.parts"
    if what == "settings":
        folder.mkdir()
        (folder / "settings.part.json").write_text('{"tas')
        assert collect.main(options) == 130 and run_seeds == [0, 2, 4]
        return
    assert collect.main(options) == 130
    damaged = folder / ("2.npz" if what == "frames" else "2.json")
    if what == "no ends":
        damaged.unlink()
    else:
        damaged.write_bytes(damaged.read_bytes().replace(b"reached", b"seached")[:-3] + b'"]\n')
    assert collect.main(options) == 0
    assert run_seeds == [0, 2, 4, 2, 4]
    printed = capsys.readouterr().out
    assert "recorded anew" in printed and "(5 reached)" in printed


def test_a_folder_of_something_else_is_left_alone(run_seeds, tmp_path, capsys):
    (tmp_path / "episodes.parts").mkdir()
    (tmp_path / "episodes.parts" / "mine").write_text("mine")
    run = lambda: collect.main(["--out", str(tmp_path / "episodes.npz")])  # noqa: E731
    assert "something else" in fails_with_one_sentence(run, capsys)
    assert (tmp_path / "episodes.parts" / "mine").read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--tasks", "0"], "--tasks is 0; give at least 1"),
        (["--stride", "0"], "--stride"),
        (["--width", "0"], "--width"),
        (["--seconds", "nan"], "positive time"),
        (["--seconds", "inf"], "positive time"),
        (["--tasks", "1000000000"], "--tasks is 1000000000; give at most"),
        (["--seed", "-1"], "--seed is -1"),
        (["--policy", "psychic"], "psychic"),
    ],
)
def test_bad_options_are_one_sentence(tmp_path, capsys, options, words):
    run = lambda: collect.main([*options, "--out", str(tmp_path / "episodes.npz")])  # noqa: E731
    assert words in fails_with_one_sentence(run, capsys)

"""Runs the commands in this process with settings so small that they take seconds."""

from pathlib import Path

import pytest

from iwalker_jax.commands import evaluate, train
from iwalker_jax.evaluation.frames import report, sequences
from iwalker_jax.perception import Intrinsics

SMALL = [
    "--source.frames",
    "16",
    "--epochs",
    "2",
    "--batch-size",
    "8",
    "--checkpoint-every",
    "2",
    "--planner.ipath.trunk-width",
    "4",
    "--planner.ipath.hidden",
    "16",
    "--unseen-scenes",
    "1",
]
SCENES = ("office", "corner")


def shorten_evaluation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two test sequences of three frames, instead of four of sixty."""

    def standard(names=SCENES, unseen_scenes=1, seed=0, say=lambda sentence: None, camera=Intrinsics()):
        recorded = [sequences.record_held_out_sequence(name, frames=3, seed=seed, camera=camera) for name in names]
        if unseen_scenes:
            recorded.append(sequences.record_unseen_scenes(unseen_scenes, 3, seed, camera=camera))
        return recorded

    monkeypatch.setattr(train, "standard_sequences", standard)
    monkeypatch.setattr(evaluate, "standard_sequences", standard)
    monkeypatch.setattr(report, "standard_sequences", standard)


def train_command(out: Path, *arguments: str) -> int:
    return train.main(["--out", str(out), *SMALL, *arguments])


def evaluate_command(run: Path, *arguments: str) -> int:
    frames_only = ["--scenes", *SCENES, "--unseen-scenes", "0", "--episodes", "none"]
    return evaluate.main(["--run", str(run), *frames_only, *arguments])


def evaluate_episodes_command(run: Path, *arguments: str) -> int:
    episodes_only = ["--scenes", "--unseen-scenes", "0", "--no-videos", "--width", "2", "--seeds", "2"]
    return evaluate.main(["--run", str(run), *episodes_only, *arguments])


def fails_with_one_sentence(run, capsys) -> str:
    """The sentence on stderr of a command that must leave with status 1 and no traceback."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as caught:
        run()
    assert caught.value.code == 1
    stderr = capsys.readouterr().err.strip()
    assert "Traceback" not in stderr
    assert len(stderr.splitlines()) == 1
    assert stderr.startswith("error: ")
    return stderr

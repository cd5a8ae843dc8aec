"""Evaluate a trained planner on test sequences and unseen scenes: python -m experiments.evaluate --run runs/default."""

from iwalker_jax.runtime import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from experiments.console import console, exit_with, say
from iwalker_jax.errors import CheckpointError, InputError
from iwalker_jax.evaluation.report import evaluate_all, standard_sequences
from iwalker_jax.evaluation.sequences import Sequence
from iwalker_jax.evaluation.tables import legend
from iwalker_jax.simulation.test_scenes import TEST_NAMES
from iwalker_jax.training.checkpoints import load_run
from iwalker_jax.training.recording_frames import frames_from_recording
from iwalker_jax.training.train_step import planner_from


@dataclass(frozen=True)
class Command:
    """Evaluate a trained planner on the test sequences and on unseen scenes.

    Attributes:
        run: folder of the training run.
        checkpoint: step to load; the newest readable one if left out.
        out: folder for the tables and pictures; <run>/evaluation if left out.
        scenes: test sequences to evaluate.
        unseen_scenes: number of held-out generated scenes; 0 leaves them out.
        data: also evaluate on the frames of your own recording (only what needs no ground truth).
        seed: of walks, noise and robot states.
    """

    run: Path = Path("runs/default")
    checkpoint: int | None = None
    out: Path | None = None
    scenes: tuple[str, ...] = TEST_NAMES
    unseen_scenes: int = 60
    data: Path | None = None
    seed: int = 0


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    command = tyro.cli(Command, args=arguments if arguments is not None else sys.argv[1:])
    try:
        state, config = load_run(command.run, command.checkpoint, say)
        say(f"Checkpoint of step {int(state.step)} ({config.method}).")
        planner = planner_from(config, state.params)
        sequences = standard_sequences(command.scenes, command.unseen_scenes, command.seed, say=say)
        if command.data is not None:
            sequences.append(Sequence("recording", frames_from_recording(command.data, say=say), None))
        out = command.out or command.run / "evaluation"
        table = evaluate_all(planner, config.models, sequences, out, say=say)
    except (InputError, CheckpointError, OSError) as error:
        exit_with(error)
    console.print()
    say(table.text())
    say(legend())
    say(f"Pictures and tables are in {out}.")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

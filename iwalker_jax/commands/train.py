"""Train iPath and iStepper end to end: python -m experiments.train [--preset NAME] [--data FOLDER]."""

import dataclasses
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from iwalker_jax.commands.shared.config_file import given_value, options_from, read_options
from iwalker_jax.commands.shared.console import (
    STOPPED,
    come_together,
    config_file,
    console,
    ends_in_a_sentence,
    exit_with,
    progress_bar,
    require_counts,
    say,
)
from iwalker_jax.data.sources import load_training_frames
from iwalker_jax.errors import CheckpointError, InputError
from iwalker_jax.evaluation.frames import FrameSequence, evaluate_all, standard_sequences
from iwalker_jax.evaluation.tables import Table
from iwalker_jax.planning import Planner
from iwalker_jax.runtime.config_dict import config_to_dict
from iwalker_jax.runtime.files import require_writable, write_json
from iwalker_jax.runtime.locks import exclusive
from iwalker_jax.runtime.processes import ProcessGroup, barrier, is_first
from iwalker_jax.training.checkpoints import load_run
from iwalker_jax.training.config import PRESETS, TrainConfig
from iwalker_jax.training.loop import TrainingProgress, TrainResult, batch_mesh, run_lock, train
from iwalker_jax.training.maps import TrainingData, prepare
from iwalker_jax.training.pretrained import save_planner
from iwalker_jax.training.run_log import LoggerName, require_loggers
from iwalker_jax.training.train_step import check_batch_split, planner_from

_BESIDE = ("start_from", "devices", "unseen_scenes")
"""Options of which a run's outcome depends beside the training configuration; its config.json holds both."""


@dataclass(frozen=True)
class Command:
    """Train the depth-to-footstep planner and evaluate it.

    Attributes:
        preset: which configuration the other options start from.
        config: file of a configuration that the other options start from instead: a run's config.json, or one like it.
        data: your own depth recording, a folder or a bag, to train on instead of generated scenes.
        topic: of the depth images in a bag that has several.
        out: folder for checkpoints, metrics, tables and pictures; an existing run in it is resumed.
        fresh: start anew even if the folder holds a run, whose checkpoints are removed.
        start_from: folder of another run whose trained networks this one starts from (fine-tuning).
        devices: number of devices of each process to spread a batch over; on a CPU that many are made of its cores.
        log: loggers that hear of the metrics beside metrics.jsonl: tensorboard, wandb (Weights & Biases, offline unless
            WANDB_MODE=online).
        unseen_scenes: held-out scenes of the final evaluation; 0 leaves them out.
        group: several processes that train one planner together.
        training: the training configuration.
    """

    preset: Literal["default", "quick", "paper", "paper-small"] = "default"
    config: Path | None = None
    data: Path | None = None
    topic: str | None = None
    out: Path = Path("runs/default")
    fresh: bool = False
    start_from: Path | None = None
    devices: int = 1
    log: tuple[LoggerName, ...] = ()
    unseen_scenes: int = 60
    group: Annotated[ProcessGroup, tyro.conf.arg(name="")] = ProcessGroup()
    training: Annotated[TrainConfig, tyro.conf.arg(name="")] = TrainConfig()


def parse(arguments: list[str]) -> Command:
    """The command of the given arguments; `--preset` or `--config` decides what the other options start from."""
    preset, file = given_value(arguments, "--preset"), given_value(arguments, "--config")
    if preset is not None and file is not None:
        raise InputError("--preset and --config both say what the other options start from; give one of them.")
    default = of_preset("default" if preset is None else preset) if file is None else of_file(Path(file))
    command = tyro.cli(Command, args=arguments, default=default, description=Command.__doc__)
    if command.data is not None or command.topic is not None:
        own = command.training.source
        folder, topic = command.data or own.folder, command.topic or own.topic
        source = dataclasses.replace(own, folder=folder, topic=topic)
        command = dataclasses.replace(command, training=dataclasses.replace(command.training, source=source))
    return command


def of_preset(name: str) -> Command:
    """The command that a preset stands for."""
    if name not in PRESETS:
        raise InputError(f"Unknown preset {name!r}; choose one of {', '.join(PRESETS)}.")
    return Command(preset=name, out=Path("runs") / name, training=PRESETS[name]())  # type: ignore[arg-type]


def of_file(file: Path) -> Command:
    """The command of a configuration file; it goes to another folder than the run that wrote the file."""
    values = read_options(file)
    values["out"] = str(Path("runs") / f"{file.absolute().parent.name or 'run'}-again")
    command = options_from(Command, file, {name: values.pop(name) for name in ("out", *_BESIDE) if name in values})
    return dataclasses.replace(command, training=options_from(TrainConfig, file, values))


def prepare_data(config: TrainConfig) -> TrainingData:
    """Frames of the configured source with their maps, progress shown."""
    camera = config.planner.ipath.camera
    with progress_bar("depth frames", config.source.frames) as show:
        frames = load_training_frames(config.source, camera, on_progress=lambda done, total: show(done), say=say)
        show(config.source.frames)
    with progress_bar("maps", len(frames)) as show:
        return prepare(frames, config.models.traversal, on_progress=show)


def starting_planner(command: Command) -> Planner | None:
    """The networks that the training starts from, if it does not start from fresh ones.

    Raises:
        InputError: for networks of other sizes.
        CheckpointError: for a run that cannot be read.
    """
    if command.start_from is None:
        return None
    state, other = load_run(command.start_from, say=say)
    if other.planner != command.training.planner:
        raise InputError(f"The networks of {command.start_from} have other sizes; use the options it was made with.")
    return planner_from(other, state.params)


def run_training(command: Command) -> TrainResult:
    """Make the data and train, progress shown; what needs no data is refused before."""
    config = command.training
    require_loggers(command.log)
    start, mesh = starting_planner(command), batch_mesh(command.devices)
    check_batch_split(config, mesh)
    data = prepare_data(config)
    frames = data.depth.shape[0]
    with progress_bar("training", config.total_steps(frames)) as show:

        def report(progress: TrainingProgress) -> None:
            losses = progress.losses
            show(
                progress.step,
                f"loss {losses['total']:.3f}  U_path {losses['U_path']:.3f}  U_step {losses['U_step']:.3f}  "
                f"{progress.frames_per_second:.0f} frames/s",
            )

        return train(
            config,
            data,
            command.out,
            resume=not command.fresh,
            start_from=start,
            mesh=mesh,
            loggers=command.log,
            on_progress=report,
            say=say,
        )


def help_training(command: Command) -> int:
    """What processes other than 0 do: the same steps, of which they keep nothing; returns the exit status."""
    with tempfile.TemporaryDirectory() as scratch:
        command = dataclasses.replace(command, out=Path(scratch), log=())
        result = run_training(command)
    if result.interrupted:
        return STOPPED
    barrier()
    return 0


def save_and_evaluate(command: Command, result: TrainResult) -> Table:
    """Write the configuration and the planner, then the evaluation's table and pictures."""
    config = command.training
    beside = {name: value for name, value in config_to_dict(command).items() if name in _BESIDE}
    write_json(config_file(command.out), config_to_dict(config) | beside)
    planner = planner_from(config, result.state.params)
    save_planner(command.out / "planner.npz", planner, config)
    camera = config.planner.ipath.camera
    sequences = standard_sequences(unseen_scenes=command.unseen_scenes, say=say, camera=camera)
    if config.source.folder is not None:
        frames = load_training_frames(config.source, camera, say=lambda sentence: None)
        sequences.append(FrameSequence("recording", frames, None))
    return evaluate_all(planner, config.models, sequences, command.out / "evaluation", say=say)


@ends_in_a_sentence("the same command goes on from the newest checkpoint")
def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    began = time.perf_counter()
    command = parse(sys.argv[1:] if arguments is None else arguments)
    require_counts(command, unseen_scenes=0)
    come_together(command.group)
    if not is_first():
        return help_training(command)
    require_writable(command.out)
    # From the start, so that a second command in the folder need not make its frames to learn of the first.
    with exclusive(run_lock(command.out), command.out):
        result = run_training(command)
        if result.interrupted:
            return STOPPED
        barrier()
        table = save_and_evaluate(command, result)
    console.print()
    say(table.text())
    say(table.legend())
    say(f"Pictures and tables are in {command.out / 'evaluation'}.")
    say(f"All done in {(time.perf_counter() - began) / 60:.1f} minutes.")
    if result.unsaved is not None:
        exit_with(CheckpointError(result.unsaved))
    return 0

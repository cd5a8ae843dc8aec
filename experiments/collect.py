"""Collect training frames from the robot's own walks: python -m experiments.collect --run runs/default."""

import sys

from iwalker_jax.runtime import configure_runtime, requested_devices

if __name__ == "__main__":
    configure_runtime(requested_devices(sys.argv))

import dataclasses
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import tyro

from experiments.console import exit_with, progress_bar, say
from experiments.planner import planner_of
from iwalker_jax.errors import CheckpointError, InputError
from iwalker_jax.navigation.episodes import EpisodeProgram
from iwalker_jax.navigation.generated_tasks import training_task
from iwalker_jax.navigation.navigators import POLICIES, make_navigator
from iwalker_jax.navigation.task import Outcome
from iwalker_jax.training.datasets import joined
from iwalker_jax.training.frames import save_frames
from iwalker_jax.training.walk_frames import frames_from_episodes


@dataclass(frozen=True)
class Command:
    """Let the robot walk in training scenes, none of which is used in any evaluation, and keep what its camera saw.

    Train on the frames with `python -m experiments.train --source.walks FILE`; no labels are needed.

    Attributes:
        run: folder of a training run; the planner that ships with the package if left out.
        out: file to write.
        tasks: number of walks.
        seconds: longest walk.
        stride: camera frames from one that is kept to the next.
        policy: who walks.
        width: walks at a time.
        devices: number of devices, all by default; on a CPU that many are made of its cores.
        seed: of tasks, noise and goals.
    """

    run: Path | None = None
    out: Path = Path("runs/walks.npz")
    tasks: int = 60
    seconds: float = 25.0
    stride: int = 12
    policy: str = "default"
    width: int = 20
    devices: int | None = None
    seed: int = 0


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    command = tyro.cli(Command, args=arguments if arguments is not None else sys.argv[1:])
    try:
        collect(command)
    except (InputError, CheckpointError, OSError) as error:
        exit_with(error)
    return 0


def collect(command: Command) -> None:
    """Walk, keep frames, say what came out."""
    if command.tasks < 1 or not command.seconds > 0 or command.stride < 1 or command.policy not in POLICIES:
        raise InputError(
            f"Give at least one task, a positive time and stride, and a policy of {', '.join(POLICIES)}; got "
            f"{command.tasks}, {command.seconds} s, {command.stride} and {command.policy!r}."
        )
    navigator = make_navigator(command.policy, planner_of(command.run)[0])
    program = EpisodeProgram(navigator, min(command.width, command.tasks), command.devices, images=True)
    parts, outcomes = [], []
    with progress_bar("walks", command.tasks) as show:
        for first in range(0, command.tasks, program.width):
            numbers = range(first, min(first + program.width, command.tasks))
            tasks = [training_task(1_000_000 * (command.seed + 1) + k) for k in numbers]
            tasks = [dataclasses.replace(task, time_limit=command.seconds) for task in tasks]
            record = program.run(tasks, seed=command.seed + first)
            outcomes += [Outcome(int(last)) for last in record.outcome[:, -1]]
            parts.append(frames_from_episodes(navigator.camera, tasks, record, command.stride, command.seed + first))
            show(numbers[-1] + 1)
    frames = reduce(joined, parts)
    save_frames(frames, command.out)
    counts = {end: outcomes.count(end) for end in Outcome if end in outcomes}
    ends = ", ".join(f"{count} {end.name.lower().replace('_', ' ')}" for end, count in counts.items())
    say(f"{len(frames)} frames of {command.tasks} walks ({ends}) are in {command.out}.")


if __name__ == "__main__":
    raise SystemExit(main())

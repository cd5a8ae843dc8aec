"""Collect training frames from the robot's own episodes: python -m experiments.collect --run runs/default."""

import dataclasses
import json
import shutil
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iwalker_jax.commands.shared.config_file import parse_options, write_options
from iwalker_jax.commands.shared.console import (
    ends_in_a_sentence,
    progress_bar,
    require_counts,
    require_devices,
    say,
)
from iwalker_jax.commands.shared.planners import planner_of
from iwalker_jax.data import FrameSet, concatenate, frames_from_episodes, load_frames, save_frames
from iwalker_jax.errors import InputError
from iwalker_jax.navigation import POLICIES, EpisodeProgram, Outcome, RunProgress, TaskBatch, make_navigator
from iwalker_jax.runtime import write_json
from iwalker_jax.runtime.devices import chosen_devices
from iwalker_jax.runtime.files import first_line, part_of, require_writable
from iwalker_jax.runtime.locks import exclusive
from iwalker_jax.streams import COLLECTION_TASKS
from iwalker_jax.tasks import training_task
from iwalker_jax.training.on_policy import memory_ipath_for

Part = tuple[FrameSet, list[str]]
"""Frames of a batch, and how its episodes ended."""

_TOGETHER = 3
"""Batches of one run; the images of one that has begun are in memory until its last episode has ended."""


@dataclass(frozen=True)
class Command:
    """Let the robot walk in training scenes, none of which is used in any evaluation, and keep what its camera saw.

    Train on the frames with `python -m experiments.train --source.episodes FILE`; no labels are needed. What is
    recorded is kept batch by batch: the same command goes on where it was stopped.

    Attributes:
        config: file of options that the others override: the .json beside an earlier file of frames, or one like it.
        run: folder of a training run; the planner that ships with the package if left out.
        out: file to write, its options in a .json beside it; until it is complete, finished batches are in a folder
            beside it that ends in .parts.
        tasks: number of episodes.
        seconds: longest episode.
        stride: camera frames from one that is kept to the next.
        policy: how to navigate: default, networks, published or classical; see experiments.evaluate.
        width: episodes at a time.
        devices: number of devices, all by default; on a CPU that many are made of its cores.
        seed: of tasks, noise and goals.
    """

    config: Path | None = None
    run: Path | None = None
    out: Path = Path("runs/episodes.npz")
    tasks: int = 60
    seconds: float = 25.0
    stride: int = 12
    policy: str = "default"
    width: int = 20
    devices: int | None = None
    seed: int = 0


@ends_in_a_sentence("the same command goes on with the batches that are not recorded yet")
def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    collect(parse_options(Command, arguments))
    return 0


def collect(command: Command) -> None:
    """Run the episodes, keep frames, say what came out."""
    require_counts(command, tasks=1, stride=1, width=1, seed=0)
    require_devices()
    if not 0 < command.seconds <= 3600 or command.policy not in POLICIES:
        raise InputError(
            f"Give a positive time of at most 3600 s and a policy of {', '.join(POLICIES)}; got {command.seconds} s "
            f"and {command.policy!r}."
        )
    require_writable(command.out, is_file=True)
    chosen_devices(command.devices)
    planner, _, name = planner_of(command.run)
    navigator = make_navigator(command.policy, planner, memory_ipath=memory_ipath_for(command.policy, command.run))
    program = EpisodeProgram(navigator, min(command.width, command.tasks), command.devices, images=True)
    with exclusive(command.out.with_suffix(".lock"), command.out):
        folder = parts_folder(command, name, program.width)
        firsts = range(0, command.tasks, program.width)
        found = {first: finished_part(part_file(folder, first)) for first in firsts}
        parts = {first: part for first, part in found.items() if part is not None}
        missing = [first for first in firsts if first not in parts]
        with progress_bar("episodes", command.tasks) as show:
            for k in range(0, len(missing), _TOGETHER):
                begun = missing[k : k + _TOGETHER]
                batches = [collection_batch(command, first, program.width) for first in begun]
                before = sum(len(part[1]) for part in parts.values())

                def report(progress: RunProgress, before: int = before) -> None:
                    show(before + progress.ended, f"{progress.running} running")

                for number, record in program.run_batches(batches, report):
                    first, (tasks, seed, _) = begun[number], batches[number]
                    names = [Outcome(int(last)).word for last in record.outcome[:, -1]]
                    write_json(part_file(folder, first).with_suffix(".json"), names)
                    kept = frames_from_episodes(
                        navigator.camera, navigator.intrinsics, tasks, record, command.stride, seed
                    )
                    save_frames(kept, part_file(folder, first))
                    parts[first] = kept, names
            show(command.tasks)
        frames = concatenate([parts[first][0] for first in firsts])
        save_frames(frames, command.out)
        write_options(command.out.with_suffix(".json"), command, ("config", "out"))
        shutil.rmtree(folder)
        ends = Counter(end for _, names in parts.values() for end in names)
        counts = ", ".join(f"{ends[end]} {end}" for end in sorted(ends))
        say(f"{len(frames)} frames of {command.tasks} episodes ({counts}) are in {command.out}.")


def collection_batch(command: Command, first: int, width: int) -> TaskBatch:
    """The batch of at most `width` tasks that begins with task `first`."""
    numbers = range(first, min(first + width, command.tasks))
    tasks = [training_task(COLLECTION_TASKS.number(command.seed, k)) for k in numbers]
    return TaskBatch([dataclasses.replace(task, time_limit=command.seconds) for task in tasks], command.seed + first)


def part_file(folder: Path, first: int) -> Path:
    """Where the frames of the batch that begins with task `first` are kept."""
    return folder / f"{first}.npz"


def finished_part(file: Path) -> Part | None:
    """Frames of a finished batch and how its episodes ended; None if it is to be recorded, or recorded anew."""
    if not file.exists():
        return None
    try:
        frames, ends = load_frames(file), json.loads(file.with_suffix(".json").read_text(encoding="utf-8"))
        known = {outcome.word for outcome in Outcome}
        if isinstance(ends, list) and known.issuperset(ends):
            return frames, ends
        why = f"{file.with_suffix('.json')} is damaged"
    except (InputError, OSError, ValueError, TypeError) as error:
        why = first_line(error)
    say(f"A batch is recorded anew: {why}")
    return None


def parts_folder(command: Command, planner: str, width: int) -> Path:
    """The folder of finished batches; says what it holds.

    Raises:
        InputError: if they were recorded with other options, or by other networks.
    """
    folder = command.out.with_suffix(".parts")
    folder.mkdir(parents=True, exist_ok=True)
    names = ("tasks", "seconds", "stride", "policy", "seed")
    wanted = {name: getattr(command, name) for name in names} | {"planner": planner, "width": width}
    settings = folder / "settings.json"
    # A process that was killed at once has left no more than the beginning of that file.
    if not set(folder.iterdir()) - {part_of(settings)}:
        write_json(settings, wanted)
    elif _read_settings(settings) != wanted:
        raise InputError(
            f"{folder} holds something else or episodes with other options; move it or choose another --out."
        )
    finished = sum(file.stem.isdigit() for file in folder.glob("*.npz"))
    if finished:
        say(f"{finished} batches are there already.")
    return folder


def _read_settings(file: Path) -> Any:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None

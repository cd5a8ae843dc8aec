"""Evaluate a planner on single frames and on walks to goals: python -m experiments.evaluate [--run FOLDER]."""

import sys

from iwalker_jax.film.headless import configure_rendering
from iwalker_jax.runtime.settings import configure_runtime, requested_devices

if __name__ == "__main__":
    configure_runtime(requested_devices(sys.argv))
    configure_rendering()

from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from experiments.shared.console import (
    Advance,
    come_together,
    console,
    exit_with,
    progress_bar,
    require_at_least,
    say,
    stopped,
)
from experiments.shared.planners import planner_of
from iwalker_jax.data.from_recording import frames_from_recording
from iwalker_jax.errors import CheckpointError, InputError
from iwalker_jax.evaluation.episodes.film import FilmSettings
from iwalker_jax.evaluation.episodes.report import Report, write_report
from iwalker_jax.evaluation.episodes.study import MakeProgram, Program, Progress, Study, run_study
from iwalker_jax.evaluation.episodes.tables import COLUMNS, navigation_table
from iwalker_jax.evaluation.episodes.walks import OF, StudySettings, policy_and_networks
from iwalker_jax.evaluation.frames.report import evaluate_all, standard_sequences
from iwalker_jax.evaluation.frames.sequences import Sequence
from iwalker_jax.evaluation.tables import Table, legend
from iwalker_jax.navigation import EpisodeProgram, make_navigator
from iwalker_jax.planning import Planner
from iwalker_jax.runtime.devices import machine
from iwalker_jax.runtime.processes import ProcessGroup, barrier, exit_process, is_first
from iwalker_jax.scenes.built.held_out_sequences import SEQUENCE_NAMES
from iwalker_jax.training.config import TrainConfig


@dataclass(frozen=True)
class Command:
    """Evaluate a planner: its plans on single frames of test sequences and unseen scenes, and its walks to goals.

    Walks are logged as they end: the same command goes on where it was stopped.

    Attributes:
        run: folder of a training run; the planner that ships with the package if left out.
        checkpoint: step of the run to load; the newest readable one if left out.
        out: folder for everything; <run>/evaluation, or runs/pretrained/evaluation, if left out.
        scenes: test sequences whose frames to evaluate.
        unseen_scenes: number of held-out generated scenes whose frames to evaluate; 0 leaves them out.
        data: also evaluate on the frames of your own recording (only what needs no ground truth).
        walks: comma-separated sets of walks: generated, factory, corridor, office, test_stair, test_office,
            test_corridor, test_corner; `none` for no walks.
        count: of generated walks.
        seeds: of every other set.
        policies: comma-separated: default (iPath leads to the next way point of the remembered route), networks
            (iPath and iStepper alone choose the way; the step MPC still corrects footsteps while walking), published
            (networks without that correction) and classical (the route instead of iPath's path); networks@FOLDER asks
            the networks of another training run, in the same table.
        depth: noisy or ideal depth images.
        state: what the robot knows of its own state: estimated from noisy sensors, or true.
        width: episodes walked at a time.
        devices: number of devices of each process, all by default; on a CPU that many are made of its cores.
        videos: film the first policy on the first walk of every set.
        seed: of walks, noise and robot states.
        group: several processes that walk their shares of the batches and log them in one folder.
    """

    run: Path | None = None
    checkpoint: int | None = None
    out: Path | None = None
    scenes: tuple[str, ...] = SEQUENCE_NAMES
    unseen_scenes: int = 60
    data: Path | None = None
    walks: str = "generated,factory,corridor,office"
    count: int = 200
    seeds: int = 10
    policies: str = "default,networks,classical"
    depth: Literal["noisy", "ideal"] = "noisy"
    state: Literal["estimated", "true"] = "estimated"
    width: int = 20
    devices: int | None = None
    videos: bool = True
    seed: int = 0
    group: Annotated[ProcessGroup, tyro.conf.arg(name="")] = ProcessGroup()


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    command = tyro.cli(Command, args=arguments if arguments is not None else sys.argv[1:])
    try:
        require_at_least(command, unseen_scenes=0)
        come_together(command.group)
        planner, config, name = planner_of(command.run, command.checkpoint)
        # Wrong names are said before an hour of work.
        settings, planners = study_settings(command, planner, name)
        out = command.out or (command.run or Path("runs/pretrained")) / "evaluation"
        frames = evaluate_frames(command, planner, config, out) if is_first() else None
        study = Study() if settings is None else evaluate_walks(command, settings, planners, out)
        barrier()
        if not is_first():
            return 0
        page = write_report(out, Report(f"Evaluation of {name}", described(command, name), machine(), study, frames))
    except (InputError, CheckpointError, OSError) as error:
        exit_with(error)
    except KeyboardInterrupt:
        return stopped("the same command goes on with the walks where they are")
    say(f"Pictures and tables are in {out}; the report is {page}.")
    return 0


def study_settings(command: Command, planner: Planner, name: str) -> tuple[StudySettings | None, dict[str, Planner]]:
    """What is walked, None if nothing is; and the networks of every policy."""
    if command.walks.strip() == "none":
        return None, {}
    walks, policies = (
        tuple(word.strip() for word in words.split(",") if word.strip()) for words in (command.walks, command.policies)
    )
    settings = StudySettings(
        name,
        policies,
        walks,
        command.count,
        command.seeds,
        command.depth,
        command.state,
        command.seed,
        command.width,
    )
    planners: dict[str, Planner] = {}
    for policy in policies:
        kind, folder = policy_and_networks(policy)
        if folder:
            other, _, other_name = planner_of(Path(folder))
            planners[f"{kind}{OF}{other_name}"] = other
        else:
            planners[policy] = planner
    return replace(settings, policies=tuple(planners)), planners


def evaluate_frames(command: Command, planner: Planner, config: TrainConfig, out: Path) -> Table | None:
    """The table of single frames, printed and saved; None if no frames are asked for."""
    sequences = standard_sequences(command.scenes, command.unseen_scenes, command.seed, say=say)
    if command.data is not None:
        sequences.append(Sequence("recording", frames_from_recording(command.data, say=say), None))
    if not sequences:
        return None
    table = evaluate_all(planner, config.models, sequences, out, say=say)
    console.print()
    say(table.text())
    say(legend())
    return table


def evaluate_walks(command: Command, settings: StudySettings, planners: dict[str, Planner], out: Path) -> Study:
    """The walks, progress shown, and their table printed."""
    film = FilmSettings() if command.videos else None
    with ExitStack() as stack:
        bars: list[Advance] = []

        def show(progress: Progress) -> None:
            if not bars:
                bars.append(stack.enter_context(progress_bar("walks", progress.total)))
            bars[0](progress.done, f"{progress.policy}: {progress.running} on their way")

        study = run_study(settings, program_maker(command, planners), out, film, show, say)
    console.print()
    if study.groups:
        say(navigation_table(study.groups).text())
        say(legend(COLUMNS))
    return study


def program_maker(command: Command, planners: dict[str, Planner]) -> MakeProgram:
    """How the programs of the policies are made."""
    sensors: Literal["nominal", "none"] = "nominal" if command.state == "estimated" else "none"

    def make(policy: str, width: int, images: bool) -> Program:
        navigator = make_navigator(policy_and_networks(policy)[0], planners[policy], sensors, command.depth == "noisy")
        return EpisodeProgram(navigator, width, command.devices, images)

    return make


def described(command: Command, name: str) -> dict[str, str]:
    """The settings in words, for the report."""
    words = {"planner": name, "seed": str(command.seed)}
    frames = [*command.scenes, *([f"{command.unseen_scenes} unseen scenes"] if command.unseen_scenes else [])]
    if frames:
        words["frames"] = ", ".join(frames)
    if command.walks.strip() != "none":
        words |= {
            "walks": f"{command.walks.replace(',', ', ')}; {command.count} generated, {command.seeds} of each other",
            "policies": command.policies.replace(",", ", "),
            "depth": command.depth,
            "state": command.state,
        }
    return words


if __name__ == "__main__":
    exit_process(main())

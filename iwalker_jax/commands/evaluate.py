"""Evaluate a planner on single frames and in episodes by sight: python -m experiments.evaluate [--run FOLDER]."""

from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import tyro

from iwalker_jax.commands.shared.config_file import parse_options, write_options
from iwalker_jax.commands.shared.console import (
    ShowProgress,
    come_together,
    config_file,
    console,
    ends_in_a_sentence,
    progress_bar,
    require_counts,
    say,
)
from iwalker_jax.commands.shared.planners import fingerprint, planner_of
from iwalker_jax.data import frames_from_recording
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation import Table
from iwalker_jax.evaluation.episodes import (
    NETWORKS_MARK,
    EpisodeRunner,
    FilmSettings,
    MakeRunner,
    Report,
    Study,
    StudyProgress,
    StudySettings,
    episode_table,
    named_sets,
    policy_and_networks,
    run_episode_study,
    write_report,
)
from iwalker_jax.evaluation.frames import FrameSequence, evaluate_all, standard_sequences
from iwalker_jax.navigation import EpisodeProgram, make_navigator
from iwalker_jax.planning import MemoryIPath, Planner
from iwalker_jax.runtime import ProcessGroup, barrier, is_first, machine
from iwalker_jax.runtime.devices import chosen_devices
from iwalker_jax.runtime.files import require_writable
from iwalker_jax.scenes import SEQUENCE_NAMES
from iwalker_jax.training import TrainConfig
from iwalker_jax.training.on_policy import is_memory_run, memory_ipath_for


class Networks(NamedTuple):
    """That a policy walks with.

    Attributes:
        planner: iPath and iStepper.
        memory_ipath: the iPath that reads the remembered map, where the policy has one.
    """

    planner: Planner
    memory_ipath: MemoryIPath | None


@dataclass(frozen=True)
class Command:
    """Evaluate a planner: its plans on single frames of test sequences and unseen scenes, and its episodes by sight.

    Episodes are logged as they end: the same command goes on where it was stopped.

    Attributes:
        config: file of options that the others override: the config.json of an earlier evaluation, or one like it.
        run: folder of a training run; the planner that ships with the package if left out.
        checkpoint: step of the run to load; the newest readable one if left out.
        out: folder for everything; <run>/evaluation, or runs/pretrained/evaluation, if left out.
        scenes: test sequences whose frames to evaluate.
        unseen_scenes: number of held-out generated scenes whose frames to evaluate; 0 leaves them out.
        data: also evaluate on the frames of your own recording (only what needs no ground truth).
        episodes: comma-separated sets of episodes: generated, factory, corridor, office, test_stair, test_office,
            test_corridor, test_corner, rooms (every hard room, or by name: room_gap_45 ...); `none` for no episodes.
        count: of generated episodes.
        seeds: of every other set.
        policies: ways to navigate, comma-separated: default (iPath leads to the next way point of the remembered
            route), networks (iPath and iStepper alone choose the way; the step MPC still corrects footsteps while
            walking), memory (the iPath that reads the remembered map in place of iPath, with nothing besides),
            published (networks without the step MPC's correction) and classical (the route instead of iPath's path);
            networks@FOLDER asks the networks of another training run, in the same table.
        depth: noisy or ideal depth images.
        state: what the robot knows of its own state: estimated from noisy sensors, or true.
        width: episodes run at a time.
        devices: number of devices of each process, all by default; on a CPU that many are made of its cores.
        videos: film the first policy on the first episode of every set.
        seed: of episodes, noise and robot states.
        group: several processes that run their shares of the batches and log them in one folder.
    """

    config: Path | None = None
    run: Path | None = None
    checkpoint: int | None = None
    out: Path | None = None
    scenes: tuple[str, ...] = SEQUENCE_NAMES
    unseen_scenes: int = 60
    data: Path | None = None
    episodes: str = "generated,factory,corridor,office"
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


@ends_in_a_sentence("the same command goes on with the episodes where they are")
def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    command = parse_options(Command, arguments)
    require_counts(command, unseen_scenes=0)
    come_together(command.group)
    chosen_devices(command.devices)
    planner, config, name = planner_of(command.run, command.checkpoint)
    # Wrong names are said before an hour of work.
    settings, planners = study_settings(command, planner, name)
    out = command.out or (command.run or Path("runs/pretrained")) / "evaluation"
    require_writable(out)
    frames = evaluate_frames(command, planner, config, out) if is_first() else None
    study = Study() if settings is None else evaluate_episodes(command, settings, planners, out)
    barrier()
    if not is_first():
        return 0
    write_options(config_file(out), command, ("config", "out", "group"))
    page = write_report(out, Report(f"Evaluation of {name}", described(command, name), machine(), study, frames))
    say(f"Pictures and tables are in {out}; the report is {page}.")
    return 0


def study_settings(command: Command, planner: Planner, name: str) -> tuple[StudySettings | None, dict[str, Networks]]:
    """What episodes are run, None if none are; and the networks of every policy."""
    if command.episodes.strip() == "none":
        return None, {}
    episode_sets, policies = (
        tuple(word.strip() for word in words.split(",") if word.strip())
        for words in (command.episodes, command.policies)
    )
    settings = StudySettings(
        name,
        policies,
        named_sets(episode_sets),
        command.count,
        command.seeds,
        command.depth,
        command.state,
        command.seed,
        command.width,
    )
    planners: dict[str, Networks] = {}
    for policy in policies:
        kind, folder = policy_and_networks(policy)
        if NETWORKS_MARK in policy and not folder:
            raise InputError(f"The policy {policy!r} names no run; give its folder, {policy}FOLDER, or leave it out.")
        memory_ipath = memory_ipath_for(kind, Path(folder) if folder else None)
        if memory_ipath is not None:
            # Episodes are logged under the policy's name: under that of these very parameters.
            source = folder if folder and is_memory_run(Path(folder)) else "shipped"
            networks = Networks(planner, memory_ipath)
            planners[f"{kind}{NETWORKS_MARK}{source} ({fingerprint(memory_ipath)})"] = networks
        elif folder:
            other, _, other_name = planner_of(Path(folder))
            planners[f"{kind}{NETWORKS_MARK}{other_name}"] = Networks(other, None)
        else:
            planners[policy] = Networks(planner, None)
    return replace(settings, policies=tuple(planners)), planners


def evaluate_frames(command: Command, planner: Planner, config: TrainConfig, out: Path) -> Table | None:
    """The table of single frames, printed and saved; None if no frames are asked for."""
    camera = planner.config.ipath.camera
    own = []
    if command.data is not None:
        own = [FrameSequence("recording", frames_from_recording(command.data, say=say, camera=camera), None)]
    sequences = [*standard_sequences(command.scenes, command.unseen_scenes, command.seed, say, camera), *own]
    if not sequences:
        return None
    table = evaluate_all(planner, config.models, sequences, out, say=say)
    console.print()
    say(table.text())
    say(table.legend())
    return table


def evaluate_episodes(command: Command, settings: StudySettings, planners: dict[str, Networks], out: Path) -> Study:
    """The episodes, progress shown, and their table printed."""
    film = None
    if command.videos:
        film = FilmSettings(camera=planners[settings.policies[0]].planner.config.ipath.camera)
    with ExitStack() as stack:
        bars: list[ShowProgress] = []

        def show(progress: StudyProgress) -> None:
            if not bars:
                bars.append(stack.enter_context(progress_bar("episodes", progress.total)))
            bars[0](progress.done, f"{progress.policy}: {progress.running} running")

        study = run_episode_study(settings, runner_maker(command, planners), out, film, show, say)
    console.print()
    if study.groups:
        table = episode_table(study.groups)
        say(table.text())
        say(table.legend())
    return study


def runner_maker(command: Command, planners: dict[str, Networks]) -> MakeRunner:
    """How what runs the policies is made."""
    sensors: Literal["nominal", "none"] = "nominal" if command.state == "estimated" else "none"

    def make(policy: str, width: int, images: bool) -> EpisodeRunner:
        networks = planners[policy]
        navigator = make_navigator(
            policy_and_networks(policy)[0],
            networks.planner,
            sensors,
            command.depth == "noisy",
            memory_ipath=networks.memory_ipath,
        )
        return EpisodeProgram(navigator, width, command.devices, images)

    return make


def described(command: Command, name: str) -> dict[str, str]:
    """The settings in words, for the report."""
    words = {"planner": name, "seed": str(command.seed)}
    frames = [*command.scenes, *([f"{command.unseen_scenes} unseen scenes"] if command.unseen_scenes else [])]
    if frames:
        words["frames"] = ", ".join(frames)
    if command.episodes.strip() != "none":
        words |= {
            "episodes": command.episodes.replace(",", ", "),
            "number": f"{command.count} generated, {command.seeds} of each other set",
            "policies": command.policies.replace(",", ", "),
            "depth": command.depth,
            "state": command.state,
        }
    return words

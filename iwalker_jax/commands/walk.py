"""Let simulated robots walk: python -m experiments.walk [--motion s_curve] [--robots 1] or [--scene factory]."""

import dataclasses
import sys
from dataclasses import dataclass
from typing import Annotated

import mujoco
import numpy as np
import tyro

from iwalker_jax.api import measure_walk, simulate_walk
from iwalker_jax.commands.shared.console import (
    console,
    ends_in_a_sentence,
    progress_bar,
    require_devices,
    say,
)
from iwalker_jax.commands.shared.scene_episode import run_scene_episode
from iwalker_jax.commands.shared.walk_options import (
    EpisodeOptions,
    SharedOptions,
    WalkOptions,
    option_values,
    refuse_others,
)
from iwalker_jax.commands.shared.walk_output import film, print_figures, push_forces, save_figures, save_pictures
from iwalker_jax.control import GaitParameters
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.rerun_files import require_rerun, write_walk
from iwalker_jax.film import has_screen
from iwalker_jax.humanoids import load_robot
from iwalker_jax.runtime.files import require_writable
from iwalker_jax.walking import (
    BatchResult,
    Conditions,
    Walk,
    Walker,
    check_robots,
    default_walker,
    make_walk,
    sample_conditions,
    save_dump,
)

_GRID = 16  # robots shown in the grid of traces


@dataclass(frozen=True)
class Command:
    """Let a robot walk in simulation and measure how well it keeps to the plan.

    With --scene it finds its own way: depth camera, iPath, iStepper and walking in one loop. Options of the other kind
    of walk are refused.

    Attributes:
        episode: by sight, if a scene is given.
        walk: on planned footsteps, if none is.
        shared: what both heed.
    """

    episode: Annotated[EpisodeOptions, tyro.conf.arg(name="")] = EpisodeOptions()
    walk: Annotated[WalkOptions, tyro.conf.arg(name="")] = WalkOptions()
    shared: Annotated[SharedOptions, tyro.conf.arg(name="")] = SharedOptions()


def halfway(walk: Walk, gait: GaitParameters) -> float:
    """[s] when half of the footsteps should have been made; of a robot that stands, half of its time."""
    steps = int(walk.plan.count)
    start = gait.stand_time + gait.shift_time + gait.settle_time
    return start + steps // 2 * float(gait.hlip.step_time) if steps else walk.seconds / 2


def simulate(
    options: WalkOptions, walker: Walker, model: mujoco.MjModel, walk: Walk, conditions: Conditions
) -> BatchResult:
    """The walk on the chosen engine, progress shown."""
    if options.engine == "mujoco":
        say(f"Walking {walk.seconds:.1f} s on C MuJoCo ...")
        return simulate_walk(walker, model, walk, conditions, "mujoco")
    with progress_bar("simulated seconds", round(walk.seconds)) as advance:
        advance(0, "compiling, a minute or two the first time")
        return simulate_walk(
            walker,
            model,
            walk,
            conditions,
            options.engine,
            devices=options.devices,
            on_progress=lambda done, up: advance(round(done), f"{up} robots up"),
        )


def walk_motion(command: Command) -> None:
    """Walk a motion, say how well, and save figures, pictures and video.

    Raises:
        InputError: for a motion that cannot be walked, or files that cannot be used.
    """
    options, shared = command.walk, command.shared
    if options.view and not has_screen():
        raise InputError("There is no screen for MuJoCo's viewer (DISPLAY is not set); leave --view out.")
    motion = options.motion.motion()
    check_robots(options.robots, shared.seed)
    description = load_robot(options.robot, options.mjcf)
    walker, model = default_walker(shared.sensors or "none", solver=options.solver, description=description)
    gait = walker.controller.gait
    walk = make_walk(motion, model, gait)
    disturbances = dataclasses.replace(shared.disturbances, push_after=halfway(walk, gait))
    step_time = float(gait.hlip.step_time)
    conditions = sample_conditions(walker.robot, disturbances, options.robots, shared.seed, step_time)
    result = simulate(options, walker, model, walk, conditions)
    finish(command, walker, model, walk, conditions, result)


def finish(
    command: Command, walker: Walker, model: mujoco.MjModel, walk: Walk, conditions: Conditions, result: BatchResult
) -> None:
    """Figures, files, pictures and video of a finished simulation."""
    options, shared = command.walk, command.shared
    records, metrics = measure_walk(walker, walk, conditions, result)
    console.print()
    figures = print_figures(metrics, result)
    save_figures(shared.out, option_values(command), walk, conditions, metrics, figures, result)
    for broken in result.broken[:1]:
        say(
            f"Robot {broken.row} turned non-finite; its last ticks go to nan_dump.npz; "
            "iwalker_jax.walking.load_dump reads it."
        )
        save_dump(shared.out / "nan_dump.npz", walker, broken)
    save_pictures(shared.out, records[:_GRID], f"{options.motion.motion().kind}, {options.engine}")
    video = shared.out / "walk.mp4" if shared.video else None
    pushes = push_forces(conditions, 0, records[0].time)
    film(video, options.view, model, records[0], np.asarray(result.sample.qpos[0]), pushes, metrics[0].fallen)
    if shared.rerun is not None:
        write_walk(shared.rerun, records[0], model, np.asarray(result.sample.qpos[0]))
    say(f"Figures, pictures and records are in {shared.out}.")


@ends_in_a_sentence("the walk was not finished, so nothing is saved")
def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    command = tyro.cli(Command, args=sys.argv[1:] if arguments is None else arguments)
    refuse_others(command.episode, command.walk)
    require_devices()
    require_writable(command.shared.out)
    if command.shared.rerun is not None:
        require_rerun(command.shared.rerun)
    if command.episode.scene is not None:
        run_scene_episode(command.episode, command.shared)
    else:
        walk_motion(command)
    return 0

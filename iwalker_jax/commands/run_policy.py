"""Run an exported policy in real time: python -m experiments.run_policy runs/policy --simulate office."""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from iwalker_jax.commands.shared.console import ends_in_a_sentence, require_counts, say
from iwalker_jax.deployment.live.process import WatchdogLimits
from iwalker_jax.deployment.live.simulation import SimulationSettings
from iwalker_jax.deployment.live.supervisor import RunReport, run_live
from iwalker_jax.deployment.lockstep import goal_arrays
from iwalker_jax.errors import InputError
from iwalker_jax.tasks import TASK_NAMES, named_task
from iwalker_jax.tasks.task import GOAL_CAPACITY


@dataclass(frozen=True)
class Command:
    """Run controller and planner of an exported policy as processes: depth and state in, footsteps and torques out.

    The robot's driver, or a simulation, is another process; docs/export.md says how it speaks with them.

    Attributes:
        folder: of the exported policy.
        goals: x y of up to six goals [m], one after the other; a simulation has those of its task.
        simulate: a task's name to walk in, simulated in real time by a process of its own; else a driver is awaited.
        lockstep: the simulation waits for every answer, on a machine that is too slow or too busy for real time.
        seconds: to run; without a simulation, none means until Ctrl-C.
        sockets: folder in which controller and planner listen; a new one if left out.
        kill_planner_after: simulated seconds after which the planner's process is killed, to see the robot stand.
        camera_until: simulated seconds after which no image comes any more, to see the robot stand.
        limits: of silence.
        seed: of the simulation.
    """

    folder: tyro.conf.Positional[Path] = Path("runs/policy")
    goals: tuple[float, ...] = ()
    simulate: str | None = None
    lockstep: bool = False
    seconds: float | None = None
    sockets: Path | None = None
    kill_planner_after: float | None = None
    camera_until: float | None = None
    limits: Annotated[WatchdogLimits, tyro.conf.arg(name="")] = WatchdogLimits()
    seed: int = 0


@ends_in_a_sentence()
def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    command = tyro.cli(Command, args=sys.argv[1:] if arguments is None else arguments)
    return run_policy(command)


def run_policy(command: Command) -> int:
    """Run the policy and say what came of it; 1 for a simulated robot that fell or touched something.

    Raises:
        InputError: for options out of range or that contradict each other.
    """
    require_counts(command, seed=0)
    for name in ("seconds", "kill_planner_after", "camera_until"):
        value, option = getattr(command, name), "--" + name.replace("_", "-")
        if value is not None and not 0 < value <= 86_400:
            raise InputError(f"{option} is {value}; give a positive time of at most 86400 s.")
        if value is not None and command.simulate is None and name != "seconds":
            raise InputError(f"{option} belongs to a simulation; give --simulate office, or leave it out.")
    report = run_live(
        command.folder,
        goal_arrays(_goals(command)),
        command.limits,
        None if command.simulate else command.seconds,
        _simulation(command),
        command.kill_planner_after,
        say,
        command.sockets,
    )
    return _say(report)


def _goals(command: Command) -> np.ndarray:
    """(g, 2) [m]."""
    if command.simulate is not None:
        if command.goals:
            raise InputError("A simulation has the goals of its task; leave --goals out.")
        if command.simulate not in TASK_NAMES:
            raise InputError(f"Unknown task {command.simulate!r}; choose one of {', '.join(TASK_NAMES)}.")
        return np.asarray(named_task(command.simulate, command.seed).goals)
    goals = np.asarray(command.goals, np.float64)
    if not 2 <= len(goals) <= 2 * GOAL_CAPACITY or len(goals) % 2 or not np.isfinite(goals).all():
        raise InputError(f"Where to? Give --goals X Y in metres, one to {GOAL_CAPACITY} pairs, or --simulate office.")
    return goals.reshape(-1, 2)


def _simulation(command: Command) -> SimulationSettings | None:
    if command.simulate is None:
        if command.lockstep:
            raise InputError("--lockstep belongs to a simulation; give --simulate office, or leave it out.")
        return None
    return SimulationSettings(
        task=command.simulate,
        seconds=command.seconds or 60.0,
        seed=command.seed,
        lockstep=command.lockstep,
        camera_until=math.inf if command.camera_until is None else command.camera_until,
    )


def _say(report: RunReport) -> int:
    for loop in report.loops:
        say(loop.sentence())
    say(f"The controller had {'real-time' if report.real_time else 'ordinary'} scheduling.")
    if report.halts:
        say(f"It lost the planner {report.halts} times and made the robot stop.")
    if report.refused:
        say(f"{report.refused} datagrams were no messages of this version.")
    run = report.simulated
    if run is None:
        return 0
    say(
        f"The robot {run.outcome} after {run.seconds:.1f} s in {run.wall:.1f} s; walked {run.walked:.1f} m, least "
        f"clearance {100 * run.clearance:.1f} cm{', standing' if run.standing else ''}. "
        f"Torques came late in {run.late} of {run.ticks} ticks ({100 * run.late / run.ticks:.3f} %)."
    )
    return int(run.outcome in ("fell", "collided", "lost its controller"))

"""Starts controller, planner and, if wanted, a simulated robot as processes, watches them, gathers their reports."""

import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, NamedTuple

from iwalker_jax.deployment import loader
from iwalker_jax.deployment.live.controller import run_controller
from iwalker_jax.deployment.live.deadlines import Punctuality
from iwalker_jax.deployment.live.messages import Arrays
from iwalker_jax.deployment.live.planner import run_planner
from iwalker_jax.deployment.live.process import BEGIN, DONE, END, PROGRESS, READY, WatchdogLimits
from iwalker_jax.deployment.live.simulation import SimulatedRun, SimulationSettings, run_simulation
from iwalker_jax.deployment.live.sockets import CONTROLLER
from iwalker_jax.errors import InputError

_START = 900.0  # [s] in which a process must be ready: on a small machine the first compilation takes minutes
_LONGEST = 107  # [bytes] of a Unix socket's name
_END = 20.0  # [s] in which it must have reported


class RunReport(NamedTuple):
    """What came of a run.

    Attributes:
        loops: figures of the loops whose processes were still there in the end.
        real_time: the system gave the controller its real-time scheduling.
        halts: times that the controller lost the planner.
        refused: messages that were none.
        simulated: what became of the simulated robot; None without one.
    """

    loops: tuple[Punctuality, ...]
    real_time: bool
    halts: int
    refused: int
    simulated: SimulatedRun | None


@dataclass
class _Member:
    """A process and what was heard of it."""

    name: str
    process: BaseProcess
    pipe: Connection
    ready: bool = False
    report: Any = None
    mourned: bool = field(default=False)


def run_live(
    folder: Path,
    goals: Arrays,
    limits: WatchdogLimits = WatchdogLimits(),
    seconds: float | None = None,
    simulation: SimulationSettings | None = None,
    kill_planner_after: float | None = None,
    say: Callable[[str], None] = lambda sentence: None,
    place: Path | None = None,
) -> RunReport:
    """Run an exported policy until its time is over, its simulated robot has come to an end, or Ctrl-C.

    Args:
        folder: of the exported policy.
        goals: `goals` and `goal_count` of the camera frame.
        limits: of silence.
        seconds: [s] to run without a simulation; None until Ctrl-C.
        simulation: of the robot; None for one that comes by itself.
        kill_planner_after: [s] of simulated time after which the planner's process is killed, to see what happens.
        say: hears what is going on, in sentences.
        place: folder of the sockets; a new one by itself.

    Raises:
        ArtifactError: if the folder cannot be used.
        InputError: if a process does not start, or for a place that sockets cannot be in.
    """
    loader.load(folder, [])
    with tempfile.TemporaryDirectory(prefix="iwalker-") as own:
        place = Path(own) if place is None else _checked(place)
        members = _started(folder, place, goals, limits, simulation)
        try:
            _until_ready(members)
            say(f"Controller and planner are ready at {place}." if simulation is None else "All processes are ready.")
            if simulation is not None:
                members["robot"].pipe.send(BEGIN)
            _watch(members, seconds, kill_planner_after, say)
        except KeyboardInterrupt:
            say("Stopping.")
        finally:
            _end(members)
    return _report(members)


def _checked(place: Path) -> Path:
    """A folder for sockets, made if need be."""
    if len(os.fsencode(place.absolute() / CONTROLLER)) > _LONGEST:
        raise InputError(f"{place} is too long a name for sockets; give a folder of at most {_LONGEST - 12} bytes.")
    place.mkdir(parents=True, exist_ok=True)
    return place


def _started(
    folder: Path, place: Path, goals: Arrays, limits: WatchdogLimits, simulation: SimulationSettings | None
) -> dict[str, _Member]:
    context = multiprocessing.get_context("spawn")
    jobs: dict[str, tuple[Callable[..., None], tuple[Any, ...]]] = {
        "controller": (run_controller, (folder, place, limits)),
        "planner": (run_planner, (folder, place, limits, goals)),
    }
    if simulation is not None:
        jobs["robot"] = (run_simulation, (folder, place, limits, simulation))
    members = {}
    for name, (target, arguments) in jobs.items():
        ours, theirs = context.Pipe()
        process = context.Process(target=target, args=(*arguments, theirs), name=f"iwalker-{name}", daemon=True)
        process.start()
        theirs.close()
        members[name] = _Member(name, process, ours)
    return members


def _until_ready(members: dict[str, _Member]) -> None:
    until = time.monotonic() + _START
    while not all(member.ready for member in members.values()):
        _listen(members, 0.2)
        gone = next((member for member in members.values() if not member.process.is_alive()), None)
        if gone is not None or time.monotonic() > until:
            name = gone.name if gone is not None else next(m.name for m in members.values() if not m.ready)
            raise InputError(f"The {name}'s process did not start; its own words stand above.")


def _watch(
    members: dict[str, _Member], seconds: float | None, kill_planner_after: float | None, say: Callable[[str], None]
) -> None:
    """Until the time is over or the robot's process has reported or gone."""
    until = None if seconds is None else time.monotonic() + seconds
    robot = members.get("robot")
    while until is None or time.monotonic() < until:
        simulated = _listen(members, 0.05)
        if kill_planner_after is not None and simulated is not None and simulated >= kill_planner_after:
            members["planner"].process.kill()
            kill_planner_after = None
        for member in members.values():
            if not member.process.is_alive() and not member.mourned and member.report is None:
                member.mourned = True
                what = " The controller makes the robot stop and stand." if member.name == "planner" else ""
                say(f"The {member.name}'s process has ended.{what}")
        if robot is not None and (robot.report is not None or robot.mourned):
            return
        if members["controller"].mourned:
            return


def _listen(members: dict[str, _Member], timeout: float) -> float | None:
    """Take in what the processes say; the simulated time [s] if it was among it."""
    time_of_robot = None
    open_pipes = {member.pipe: member for member in members.values() if not member.pipe.closed}
    for pipe in wait_for(list(open_pipes), timeout):
        member = open_pipes[pipe]  # type: ignore[index]
        try:
            word, value = member.pipe.recv()
        except (EOFError, OSError):
            member.pipe.close()
            continue
        member.ready |= word == READY
        member.report = value if word == DONE else member.report
        time_of_robot = value if word == PROGRESS else time_of_robot
    return time_of_robot


def _end(members: dict[str, _Member]) -> None:
    """Tell all processes to end, gather their reports, and make an end of those that do not."""
    for member in members.values():
        try:
            member.pipe.send(END)
        except OSError:
            member.pipe.close()
    until = time.monotonic() + _END
    while time.monotonic() < until and any(m.report is None and m.process.is_alive() for m in members.values()):
        _listen(members, 0.1)
    _listen(members, 0.0)
    for member in members.values():
        member.process.join(5.0)
        if member.process.is_alive():
            member.process.kill()
            member.process.join()


def _report(members: dict[str, _Member]) -> RunReport:
    controller, planner = members["controller"].report or {}, members["planner"].report or {}
    loops = (controller.get("punctuality"), planner.get("frames"), planner.get("punctuality"))
    return RunReport(
        loops=tuple(loop for loop in loops if loop is not None),
        real_time=bool(controller.get("real_time")),
        halts=int(controller.get("halts", 0)),
        refused=int(controller.get("refused", 0)) + int(planner.get("refused", 0)),
        simulated=members["robot"].report if "robot" in members else None,
    )

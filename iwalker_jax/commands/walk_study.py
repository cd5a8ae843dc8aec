"""Measure how well the robot walks: python -m experiments.walk_study [--suites nominal,pushes,robust,limits]."""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import jax
import mujoco
import numpy as np
import tyro

from iwalker_jax.commands.shared.console import (
    ends_in_a_sentence,
    require_counts,
    require_devices,
    say,
)
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation import Table
from iwalker_jax.evaluation.walks import (
    WalkLabels,
    has_case,
    load_walk_table,
    robot_rows,
    summarise,
    walk_metrics,
    with_case,
)
from iwalker_jax.runtime.devices import chosen_devices
from iwalker_jax.runtime.files import require_writable
from iwalker_jax.runtime.locks import exclusive
from iwalker_jax.walking import (
    Conditions,
    Disturbances,
    Motion,
    Sample,
    Sensors,
    Walk,
    Walker,
    WalkProgram,
    default_walker,
    make_walk,
    roll_out_mujoco,
    sample_conditions,
)

_EVERY = 10  # ticks between two records
_ROWS = 320  # of all plans: 3 m at 0.05 m/s take 260 footsteps


@dataclass(frozen=True)
class Case:
    """A row of the study.

    Attributes:
        name: of the row.
        motion: to walk.
        disturbances: from which the conditions are drawn.
        sensors: that the robot walks by.
        many: whether it takes `trials` robots instead of `seeds`.
    """

    name: str
    motion: Motion
    disturbances: Disturbances = Disturbances()
    sensors: Sensors = "none"
    many: bool = False


def nominal_cases() -> list[Case]:
    """The motions a user asks for, on floors and with masses that the controller does not know."""
    cases = [
        Case("stand 60 s", Motion("stand", seconds=60.0)),
        Case("in place 60 s", Motion("in_place", seconds=60.0)),
    ]
    for speed in (0.05, 0.10, 0.15, 0.20, 0.30):
        cases.append(Case(f"straight 3 m, {speed:.2f} m/s", Motion("straight", speed, distance=3.0)))
    cases.append(Case("sideways 1 m, 0.05 m/s", Motion("sideways", 0.05, distance=1.0)))
    for turn in (15.0, 30.0):
        cases.append(Case(f"turn 12 s, {turn:.0f} deg/s", Motion("turn", turn=turn, seconds=12.0)))
    for length in (0.03, 0.04, 0.05, 0.06):
        cases.append(
            Case(f"S-curve 3 m, {100 * length:.0f} cm steps", Motion("s_curve", step_length=length, distance=3.0))
        )
    return cases


def push_cases() -> list[Case]:
    """Pushes of 0.1 s at random times within two steps, walking at 0.10 m/s."""
    walk = Motion("straight", 0.10, seconds=8.0)
    pushes: tuple[tuple[Literal["x", "y"], float], ...] = (("x", 1.0), ("x", 2.0), ("y", 0.5), ("y", 1.0))
    return [
        Case(f"push {axis} {size:g} N s", walk, Disturbances(push_impulse=size, push_axis=axis), many=True)
        for axis, size in pushes
    ]


def robust_cases() -> list[Case]:
    """Wrong masses, slippery floors, late torques and the estimator's state, each alone and all together."""
    walk = Motion("straight", 0.10, seconds=30.0)
    hard = Disturbances(friction=(0.4, 1.0), mass=0.10)
    late = replace(hard, delay=(1, 2))
    return [
        Case("friction 0.4-1.0, mass +-10 %", walk, hard, many=True),
        Case("and delay 2-4 ms", walk, late, many=True),
        Case("and nominal sensors", walk, late, "nominal", many=True),
    ]


def limit_cases() -> list[Case]:
    """Faster and faster."""
    speeds = (0.40, 0.50, 0.60, 0.70, 0.80, 0.90, 1.00)
    return [Case(f"straight 3 m, {speed:.2f} m/s", Motion("straight", speed, distance=3.0)) for speed in speeds]


SUITES = {"nominal": nominal_cases, "pushes": push_cases, "robust": robust_cases, "limits": limit_cases}


@dataclass(frozen=True)
class Command:
    """Measure standing, walking, turning, pushes, robustness and limits of the simulated BRUCE.

    The tables grow case by case: the same command goes on where it was stopped.

    Attributes:
        suites: comma-separated, of nominal, pushes, robust and limits.
        seeds: robots of each nominal case and limit, each with friction, mass and start of its own.
        trials: robots of each case of pushes and robust.
        engine: of the physics.
        seed: of all conditions.
        out: folder for the tables; cases that they hold with as many robots and this seed are not walked again.
        devices: number of devices, all by default; on a CPU that many are made of its cores.
    """

    suites: str = "nominal,pushes,robust,limits"
    seeds: int = 20
    trials: int = 100
    engine: Literal["mjx", "mujoco", "both"] = "mjx"
    seed: int = 0
    out: Path = Path("runs/walk_study")
    devices: int | None = None


class CompiledWalker:
    """The robot with one kind of sensors, and its one compiled program."""

    def __init__(self, sensors: Sensors, width: int, devices: int | None) -> None:
        self.walker, self.model = default_walker(sensors)
        self.program = WalkProgram(self.walker, width, _ROWS, devices, every=_EVERY)

    def walk(self, engine: str, walk: Walk, conditions: Conditions) -> Sample:
        """NumPy record of all robots, batch first."""
        if engine == "mjx":
            return self.program.run(conditions, walk.plan, walk.seconds).sample
        return _on_mujoco(self.walker, self.model, walk, conditions)


def _on_mujoco(walker: Walker, model: mujoco.MjModel, walk: Walk, conditions: Conditions) -> Sample:
    samples = round(walk.seconds / (walker.controller.time_step * _EVERY))
    sample = roll_out_mujoco(walker, model, conditions, walk.plan, samples, _EVERY)
    return jax.tree.map(np.asarray, sample)


def measure(case: Case, compiled: CompiledWalker, engine: str, robots: int, seed: int) -> dict[str, float]:
    """Walk one case and return its figures by column title."""
    controller = compiled.walker.controller
    step_time = float(controller.gait.hlip.step_time)
    walk = make_walk(case.motion, compiled.model, controller.gait, _ROWS)
    conditions = sample_conditions(compiled.walker.robot, case.disturbances, robots, seed, step_time)
    sample = compiled.walk(engine, walk, conditions)
    limits = np.asarray(controller.actuation.limits)
    return summarise([walk_metrics(robot_rows(sample, k), walk.plan, limits, step_time) for k in range(robots)])


def cases_of(suites: str) -> list[tuple[str, Case]]:
    """(suite, case) of comma-separated suites."""
    names = [name.strip() for name in suites.split(",") if name.strip()]
    unknown = [name for name in names if name not in SUITES]
    if unknown or not names:
        raise InputError(f"Unknown suites {', '.join(unknown) or suites!r}; choose of {', '.join(SUITES)}.")
    return [(name, case) for name in names for case in SUITES[name]()]


def run_walk_study(command: Command) -> Table:
    """The cases that the tables do not hold yet, one after the other; the tables are written anew after each."""
    require_counts(command, seeds=1, trials=1, seed=0)
    require_devices()
    engines = ("mjx", "mujoco") if command.engine == "both" else (command.engine,)
    chosen_devices(command.devices)
    require_writable(command.out)
    todo = [(suite, case, engine) for suite, case in cases_of(command.suites) for engine in engines]
    with exclusive(command.out / ".lock", command.out):
        return _walk_cases(command, todo)


def _walk_cases(command: Command, todo: Sequence[tuple[str, Case, str]]) -> Table:
    walkers: dict[Sensors, CompiledWalker] = {}
    table = load_walk_table(command.out / "walk_study.csv")
    for number, (suite, case, engine) in enumerate(todo, start=1):
        robots = command.trials if case.many else command.seeds
        labels = WalkLabels(suite, case.name, engine, str(command.seed))
        if has_case(table, labels, robots):
            say(f"{number}/{len(todo)} {suite}, {case.name}, {engine}: is there already, {robots} robots.")
            continue
        if case.sensors not in walkers:
            walkers[case.sensors] = CompiledWalker(case.sensors, command.seeds, command.devices)
        began = time.perf_counter()
        row = measure(case, walkers[case.sensors], engine, robots, command.seed)
        table = with_case(table, labels, row)
        table.save(command.out, "walk_study", checksums=True)
        steps = row["footstep mean cm"]
        made = row["steps made %"]
        off = f", {made:.1f} % of the steps made, off by {steps:.2f} cm" if np.isfinite(steps) else ""
        took = time.perf_counter() - began
        fell = f"{row['falls']:.0f} of {robots} fell"
        say(f"{number}/{len(todo)} {suite}, {case.name}, {engine}: {fell}{off} ({took:.0f} s)")
    return table


@ends_in_a_sentence("the same command goes on with the cases that the tables do not hold yet")
def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    given = sys.argv[1:] if arguments is None else arguments
    command = tyro.cli(Command, args=given)
    table = run_walk_study(command)
    say(table.text())
    say(table.legend())
    say(f"The tables are {command.out / 'walk_study'}.txt, .md and .csv.")
    return 0

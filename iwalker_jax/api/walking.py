"""One call from a motion to walks of a robot in simulation, with what is recorded and measured of them."""

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import jax
import mujoco
import numpy as np

from iwalker_jax.control import GaitParameters
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.walks import WalkMetrics, robot_rows, walk_metrics, walk_record
from iwalker_jax.humanoids import RobotDescription, load_robot
from iwalker_jax.optimization import QpMethod
from iwalker_jax.walking import (
    BatchResult,
    Conditions,
    Disturbances,
    Motion,
    MotionKind,
    Sensors,
    Walk,
    Walker,
    WalkProgram,
    WalkRecord,
    default_walker,
    make_walk,
    roll_out_mujoco,
    sample_conditions,
)

Engine = Literal["mjx", "mjx.step", "mujoco"]
"""What moves the robots: our own step of the MJX model, which is the fastest and has gradients; MJX's own `mjx.step`,
whose values that equals; or C MuJoCo."""

_EVERY = 10  # ticks between two samples


class WalkResult(NamedTuple):
    """What came of a walk.

    Attributes:
        walk: the commanded footsteps.
        conditions: that the robots met, batch first.
        batch: samples of all robots, batch first, and the times that simulation took.
        records: a robot's walk each, as pictures and videos take it.
        metrics: a robot's figures each.
    """

    walk: Walk
    conditions: Conditions
    batch: BatchResult
    records: tuple[WalkRecord, ...]
    metrics: tuple[WalkMetrics, ...]


def walk(
    motion: Motion | MotionKind = "s_curve",
    robots: int = 1,
    *,
    robot: str | Path | RobotDescription = "bruce",
    sensors: Sensors = "none",
    engine: Engine = "mjx",
    disturbances: Disturbances = Disturbances(),
    gait: GaitParameters | None = None,
    solver: QpMethod = "active_set",
    seed: int = 0,
    devices: int | None = None,
    on_progress: Callable[[float, int], None] | None = None,
) -> WalkResult:
    """Let a robot walk a motion in simulation: `walk(Motion("straight", speed=0.3)).metrics[0].speed`.

    Args:
        motion: what to walk, or its kind alone.
        robots: that walk it, each with conditions of its own.
        robot: which one: its name, the TOML file that describes it, or its description; see `load_robot`.
        sensors: `none` feeds the true state back, the others walk on the estimate from simulated sensors.
        engine: MJX by our step or by its own, compiled for many robots, or C MuJoCo, which steps one after the other.
        disturbances: from which friction, mass, start and pushes are drawn.
        gait: of the controller; the robot's own if left out.
        solver: of its whole-body QPs.
        seed: of conditions and sensors.
        devices: number of devices, all by default.
        on_progress: hears of the simulated time [s] and of the robots still up; MJX only.

    Raises:
        InputError: for options out of range, a bad file, or footsteps out of reach.
    """
    _check_engine(engine)
    description = robot if isinstance(robot, RobotDescription) else load_robot(robot)
    walker, model = default_walker(sensors, gait, solver, description)
    gait = walker.controller.gait
    motion = Motion(motion) if isinstance(motion, str) else motion
    if not isinstance(motion, Motion):
        raise InputError(f"The motion is {motion!r:.40}; give a Motion, or the name of its kind.")
    commanded = make_walk(motion, model, gait)
    conditions = sample_conditions(walker.robot, disturbances, robots, seed, float(gait.hlip.step_time))
    batch = simulate_walk(walker, model, commanded, conditions, engine, devices, on_progress)
    records, metrics = measure_walk(walker, commanded, conditions, batch)
    return WalkResult(commanded, conditions, batch, records, metrics)


def simulate_walk(
    walker: Walker,
    model: mujoco.MjModel,
    commanded: Walk,
    conditions: Conditions,
    engine: Engine = "mjx",
    devices: int | None = None,
    on_progress: Callable[[float, int], None] | None = None,
) -> BatchResult:
    """Robots in their conditions on the footsteps of one walk.

    Args:
        walker: the robot, and model: the same for the C engine, as from `default_walker`.
        commanded: what to walk.
        conditions: batch first.
        engine: MJX by our step or by its own, compiled for many robots, or C MuJoCo, which steps one after the other.
        devices: number of devices, all by default; MJX only.
        on_progress: hears of the simulated time [s] and of the robots still up; MJX only.

    Raises:
        InputError: for another engine.
    """
    _check_engine(engine)
    if engine != "mujoco":
        walker = dataclasses.replace(walker, physics="own" if engine == "mjx" else "mjx.step")
        program = WalkProgram(walker, len(conditions.friction), commanded.plan.yaws.shape[-1], devices, every=_EVERY)
        return program.run(conditions, commanded.plan, commanded.seconds, on_progress)
    began = time.perf_counter()
    samples = round(commanded.seconds / (walker.controller.time_step * _EVERY))
    sample = roll_out_mujoco(walker, model, conditions, commanded.plan, samples, _EVERY)
    return BatchResult(jax.tree.map(np.asarray, sample), time.perf_counter() - began, 0.0, ())


def _check_engine(engine: str) -> None:
    if engine not in get_args(Engine):
        raise InputError(f"Unknown engine {engine!r}; choose one of {', '.join(get_args(Engine))}.")


def measure_walk(
    walker: Walker, commanded: Walk, conditions: Conditions, batch: BatchResult
) -> tuple[tuple[WalkRecord, ...], tuple[WalkMetrics, ...]]:
    """Records and figures of all robots of a simulated walk."""
    limits = np.asarray(walker.controller.actuation.limits)
    step_time = float(walker.controller.gait.hlip.step_time)
    pushed = np.any(np.asarray(conditions.push_force) != 0, axis=-1)
    records, metrics = [], []
    for k in range(len(pushed)):
        row = robot_rows(batch.sample, k)
        pushes = (float(conditions.push_start[k]),) if pushed[k] else ()
        friction = float(conditions.friction[k])
        speed = abs(commanded.speed)
        legs = walker.robot.leg_joints
        records.append(
            walk_record(row, commanded.plan, limits, step_time, speed, commanded.path, pushes, friction, legs)
        )
        metrics.append(walk_metrics(row, commanded.plan, limits, step_time))
    return tuple(records), tuple(metrics)

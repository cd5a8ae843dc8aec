"""One call from a motion to walks of BRUCE in simulation, with what is recorded and measured of them."""

import time
from collections.abc import Callable
from typing import Literal, NamedTuple

import jax
import numpy as np

from iwalker_jax.control import GaitParameters
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.walks import WalkMetrics, robot_rows, walk_metrics, walk_record
from iwalker_jax.walking import (
    BatchResult,
    Conditions,
    Disturbances,
    Motion,
    MotionKind,
    Sensors,
    Walk,
    WalkProgram,
    WalkRecord,
    default_walker,
    make_walk,
    roll_out_mujoco,
    sample_conditions,
)

Engine = Literal["mjx", "mujoco"]

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
    sensors: Sensors = "none",
    engine: Engine = "mjx",
    disturbances: Disturbances = Disturbances(),
    gait: GaitParameters | None = None,
    seed: int = 0,
    devices: int | None = None,
    on_progress: Callable[[float, int], None] | None = None,
) -> WalkResult:
    """Let BRUCE walk a motion in simulation: `walk(Motion("straight", speed=0.3)).metrics[0].speed`.

    Args:
        motion: what to walk, or its kind alone.
        robots: that walk it, each with conditions of its own.
        sensors: `none` feeds the true state back, the others walk on the estimate from simulated sensors.
        engine: MJX for many robots, or C MuJoCo for one.
        disturbances: from which friction, mass, start and pushes are drawn.
        gait: of the controller.
        seed: of conditions and sensors.
        devices: number of devices, all by default.
        on_progress: hears of the simulated time [s] and of the robots still up; MJX only.

    Raises:
        InputError: for options out of range, a bad file, footsteps out of reach, or many robots on C MuJoCo.
    """
    if engine not in ("mjx", "mujoco"):
        raise InputError(f"Unknown engine {engine!r}; choose mjx or mujoco.")
    if engine == "mujoco" and robots != 1:
        raise InputError(f"C MuJoCo walks one robot at a time, not {robots}; use the engine mjx.")
    walker, model = default_walker(sensors, gait)
    gait = walker.controller.gait
    step_time = float(gait.hlip.step_time)
    commanded = make_walk(Motion(motion) if isinstance(motion, str) else motion, model, gait)
    conditions = sample_conditions(walker.robot, disturbances, robots, seed, step_time)
    if engine == "mujoco":
        began = time.perf_counter()
        ticks = round(commanded.seconds / (walker.controller.time_step * _EVERY))
        sample = roll_out_mujoco(walker, model, conditions, commanded.plan, ticks, _EVERY)
        batch = BatchResult(jax.tree.map(np.asarray, sample), time.perf_counter() - began, 0.0, ())
    else:
        program = WalkProgram(walker, robots, commanded.plan.yaws.shape[-1], devices, every=_EVERY)
        batch = program.run(conditions, commanded.plan, commanded.seconds, on_progress)
    limits = np.asarray(walker.controller.actuation.limits)
    rows = [robot_rows(batch.sample, k) for k in range(robots)]
    records = [
        walk_record(
            row,
            commanded.plan,
            limits,
            step_time,
            abs(commanded.speed),
            commanded.path,
            (float(conditions.push_start[k]),) if disturbances.push_impulse else (),
            float(conditions.friction[k]),
        )
        for k, row in enumerate(rows)
    ]
    metrics = [walk_metrics(row, commanded.plan, limits, step_time) for row in rows]
    return WalkResult(commanded, conditions, batch, tuple(records), tuple(metrics))

"""Let simulated robots walk: python -m experiments.walk [--motion s_curve] [--robots 1] or [--scene factory]."""

import sys

from iwalker_jax.film.headless import configure_rendering, has_screen
from iwalker_jax.runtime.settings import configure_runtime, requested_devices

if __name__ == "__main__":
    configure_runtime(requested_devices(sys.argv))
    configure_rendering()

import dataclasses
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import jax
import mujoco
import numpy as np
import tyro

from experiments.shared.console import console, exit_with, progress_bar, say, stopped
from experiments.shared.scene_walk import PRETRAINED, SceneWalk, walk_in_scene
from experiments.shared.walk_output import film, print_figures, push_forces, save_figures, save_pictures
from iwalker_jax.control import GaitParameters
from iwalker_jax.errors import CheckpointError, InputError
from iwalker_jax.evaluation.walks.metrics import robot_rows, walk_metrics, walk_record
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
    default_walker,
    make_walk,
    roll_out_mujoco,
    sample_conditions,
    save_dump,
)

_GRID = 16  # robots shown in the grid of traces


@dataclass(frozen=True)
class Command:
    """Let BRUCE walk in simulation and measure how well it keeps to the plan.

    With --scene it finds its own way: depth camera, iPath, iStepper and walking in one loop. Options of the other kind
    of walk are refused.

    Attributes:
        scene: a demonstration (factory, corridor, office), a test sequence (test_stair, test_office, test_corridor,
            test_corner), or an MJCF or mesh file of your own, to walk in by sight. Depth and collisions of a file are
            those of boxes and cylinders that it is converted to: upright boxes and cylinders as they are, round solids
            as discs 5 cm high, all else merged from voxels of 5 to 15 cm; the least distance to the file's own
            surfaces is measured after the walk.
        policy: whose networks: `pretrained`, or the folder of a training run.
        navigation: default (iPath leads to the next way point of the remembered route), networks (iPath and iStepper
            alone choose the way; the step MPC still corrects footsteps while walking), published (networks without
            that correction) or classical (the route instead of iPath's path).
        start: x, y [m] and heading [deg] in a scene; its own, or 0 0 0 in a file, if left out.
        goals: x, y [m] of each goal, one after the other, in a scene.
        bounds: x_min, y_min, x_max, y_max [m] of a scene file in which to walk, with sides of at most 16 m; all of the
            file if left out.
        motion: what to do without a scene; --footsteps and --path choose their own.
        speed: [m/s] forward, of sideways to the left.
        turn: [deg/s] of the motion turn.
        step_length: [m] in place of the speed.
        distance: [m] to walk.
        seconds: [s] to move for, where no distance is given.
        width: [m] between the tracks of the feet.
        footsteps: CSV file of footsteps to walk, `side, x, y, yaw_degrees` a line.
        path: CSV file of a path to follow, `x, y` a line.
        robots: number of robots, each with friction, mass and start of its own; in scenes many walk with
            experiments.evaluate.
        engine: of the physics: MJX for batches, or C MuJoCo.
        seed: of the conditions and the sensors' noise.
        sensors: `none` feeds the true state back, the others walk on the estimate from simulated sensors; left out,
            `nominal` in a scene, else `none`.
        friction: least and largest coefficient of the floor.
        mass: largest relative change of all masses.
        delay: least and largest delay of the torques, in ticks of 2 ms.
        push_impulse: [N s] of a push of 0.1 s and random sign, halfway; in a scene when half of the way would be walked
            at 0.25 m/s.
        push_axis: its axis, of the world.
        out: folder for pictures, video and figures.
        video: film the first robot.
        view: play the first robot's walk in MuJoCo's viewer.
        devices: number of devices, all by default; on a CPU that many are made of its cores.
    """

    scene: str | None = None
    policy: str = PRETRAINED
    navigation: str = "default"
    start: tuple[float, float, float] | None = None
    goals: tuple[tuple[float, float], ...] = ()
    bounds: tuple[float, float, float, float] | None = None
    motion: MotionKind = "s_curve"
    speed: float = 0.15
    turn: float = 15.0
    step_length: float | None = None
    distance: float | None = None
    seconds: float | None = None
    width: float = 0.10
    footsteps: Path | None = None
    path: Path | None = None
    robots: int = 1
    engine: Literal["mjx", "mujoco"] = "mjx"
    seed: int = 0
    sensors: Sensors | None = None
    friction: tuple[float, float] = (0.5, 1.0)
    mass: float = 0.05
    delay: tuple[int, int] = (0, 0)
    push_impulse: float = 0.0
    push_axis: Literal["x", "y"] = "x"
    out: Path = Path("runs/walk")
    video: bool = True
    view: bool = False
    devices: int | None = None


_OF_SCENES = ("policy", "navigation", "start", "goals", "bounds")
_OF_MOTIONS = ("motion", "speed", "turn", "step_length", "distance", "seconds", "width", "footsteps", "path", "robots",
               "engine", "view", "devices")  # fmt: skip


def refuse_others(command: Command) -> None:
    """Refuse options that the kind of walk would not heed.

    Raises:
        InputError: which names all of them.
    """
    kind, names = ("without --scene", _OF_SCENES) if command.scene is None else ("with --scene", _OF_MOTIONS)
    given = [
        "--" + field.name.replace("_", "-")
        for field in dataclasses.fields(command)
        if field.name in names and getattr(command, field.name) != field.default
    ]
    if given:
        raise InputError(
            f"A walk {kind} takes no {', '.join(given)}; leave out what belongs to the other kind of walk."
        )


def motion_of(command: Command) -> Motion:
    """The motion that the options ask for."""
    if command.footsteps is not None and command.path is not None:
        raise InputError("Both --footsteps and --path are given; choose one.")
    kind, file = command.motion, None
    if command.footsteps is not None:
        kind, file = "footsteps", command.footsteps
    elif command.path is not None:
        kind, file = "path", command.path
    shared = ("speed", "turn", "step_length", "distance", "seconds", "width")
    return Motion(kind, file=file, **{name: getattr(command, name) for name in shared})


def scene_walk(command: Command) -> SceneWalk:
    """The walk through a scene that the options ask for."""
    return SceneWalk(
        scene=command.scene or "",
        policy=command.policy,
        navigation=command.navigation,
        start=command.start,
        goals=command.goals,
        bounds=command.bounds,
        sensors=command.sensors or "nominal",
        disturbances=disturbances(command),
        seed=command.seed,
        video=command.video,
        out=command.out,
    )


def disturbances(command: Command) -> Disturbances:
    """What the options put in the robots' way; the time of the push depends on the walk."""
    return Disturbances(
        friction=command.friction,
        mass=command.mass,
        push_impulse=command.push_impulse,
        push_axis=command.push_axis,
        delay=command.delay,
    )


def halfway(walk: Walk, gait: GaitParameters) -> float:
    """[s] when half of the footsteps should have been made; of a robot that stands, half of its time."""
    steps = int(walk.plan.count)
    start = gait.stand_time + gait.shift_time + gait.settle_time
    return start + steps // 2 * float(gait.hlip.step_time) if steps else walk.seconds / 2


def simulate(
    command: Command, walker: Walker, model: mujoco.MjModel, walk: Walk, conditions: Conditions
) -> BatchResult:
    """The walk on the chosen engine, progress shown."""
    if command.engine == "mujoco":
        interval = walker.controller.time_step * 10
        say(f"Walking {walk.seconds:.1f} s on C MuJoCo ...")
        began = time.perf_counter()
        sample = roll_out_mujoco(walker, model, conditions, walk.plan, round(walk.seconds / interval), 10)
        return BatchResult(jax.tree.map(np.asarray, sample), time.perf_counter() - began, 0.0, ())
    program = WalkProgram(walker, command.robots, walk.plan.yaws.shape[-1], command.devices)
    with progress_bar("simulated seconds", round(walk.seconds)) as advance:
        advance(0, "compiling, a minute or two the first time")
        return program.run(
            conditions, walk.plan, walk.seconds, lambda done, up: advance(round(done), f"{up} robots up")
        )


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    given = sys.argv[1:] if arguments is None else arguments
    command = tyro.cli(Command, args=given)
    try:
        refuse_others(command)
        if command.view and not has_screen():
            raise InputError("There is no screen for MuJoCo's viewer (DISPLAY is not set); leave --view out.")
        if command.scene is not None:
            walk_in_scene(scene_walk(command))
            return 0
        walker, model = default_walker(command.sensors or "none")
        gait = walker.controller.gait
        step_time = float(gait.hlip.step_time)
        walk = make_walk(motion_of(command), model, gait)
        met = dataclasses.replace(disturbances(command), push_after=halfway(walk, gait))
        conditions = sample_conditions(walker.robot, met, command.robots, command.seed, step_time)
        result = simulate(command, walker, model, walk, conditions)
        finish(command, walker, model, walk, conditions, result)
    except (InputError, CheckpointError, OSError) as error:
        exit_with(error)
    except KeyboardInterrupt:
        return stopped("the walk was not finished, so nothing is saved")
    return 0


def finish(
    command: Command, walker: Walker, model: mujoco.MjModel, walk: Walk, conditions: Conditions, result: BatchResult
) -> None:
    """Figures, files, pictures and video of a finished simulation."""
    step_time = float(walker.controller.gait.hlip.step_time)
    limits = np.asarray(walker.controller.actuation.limits)
    rows = [robot_rows(result.sample, k) for k in range(command.robots)]
    metrics = [walk_metrics(row, walk.plan, limits, step_time) for row in rows]
    command.out.mkdir(parents=True, exist_ok=True)
    console.print()
    figures = print_figures(metrics, result)
    save_figures(command.out, dataclasses.asdict(command), walk, conditions, metrics, figures, result)
    for broken in result.broken[:1]:
        say(
            f"Robot {broken.row} turned non-finite; its last ticks go to nan_dump.npz; "
            "iwalker_jax.walking.load_dump reads it."
        )
        save_dump(command.out / "nan_dump.npz", walker, broken)
    records = [
        walk_record(
            row,
            walk.plan,
            limits,
            step_time,
            abs(walk.speed),
            walk.path,
            (float(conditions.push_start[k]),) if command.push_impulse else (),
            float(conditions.friction[k]),
        )
        for k, row in enumerate(rows[:_GRID])
    ]
    save_pictures(command.out, records, f"{motion_of(command).kind}, {command.engine}")
    video = command.out / "walk.mp4" if command.video else None
    pushes = push_forces(conditions, 0, records[0].time)
    film(video, command.view, model, records[0], np.asarray(rows[0].qpos), pushes)
    say(f"Figures, pictures and records are in {command.out}.")


if __name__ == "__main__":
    raise SystemExit(main())

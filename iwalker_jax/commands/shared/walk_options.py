"""Options of `experiments.walk`: of a walk on planned footsteps, of an episode by sight, and of both."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from iwalker_jax.api import Engine
from iwalker_jax.errors import InputError
from iwalker_jax.optimization import QpMethod
from iwalker_jax.scenes.imported.mesh_frame import Up
from iwalker_jax.scenes.imported.voxel_boxes import Bounds
from iwalker_jax.tasks import TASK_NAMES
from iwalker_jax.walking import Disturbances, Motion, MotionKind, Sensors


@dataclass(frozen=True)
class EpisodeOptions:
    """An episode: the robot finds its own way through a scene by sight.

    Attributes:
        scene: a demonstration (factory, corridor, office), a test sequence (test_stair, test_office, test_corridor,
            test_corner), or an MJCF or mesh file of your own, to walk in by sight. Depth and collisions of a file are
            those of boxes and cylinders that it is converted to: upright boxes and cylinders as they are, round solids
            as discs 5 cm high, all else merged from voxels of 5 to 15 cm; the least distance to the file's own
            surfaces is measured afterwards.
        policy: how to navigate in a scene: default (iPath leads to the next way point of the remembered route),
            networks (iPath and iStepper alone choose the way; the step MPC still corrects footsteps while walking),
            published (networks without that correction) or classical (the route instead of iPath's path).
        run: folder of a training run, whose networks are used in a scene; those that ship with the package if left
            out.
        start: x, y [m] and heading [deg] in a scene; its own, or 0 0 0 in a file, if left out.
        goals: x, y [m] of each goal, one after the other, in a scene.
        bounds: x_min, y_min, x_max, y_max [m] of a scene file in which to walk, with sides of at most 51 m; all of the
            file if left out.
        up: which axis of a mesh file is up; found by its floor if left out.
        unreachable: walk even if no way that the robot fits through leads to a goal, and let it find out.
    """

    scene: str | None = None
    policy: str = "default"
    run: Path | None = None
    start: tuple[float, float, float] | None = None
    goals: tuple[tuple[float, float], ...] = ()
    bounds: Bounds | None = None
    up: Up | None = None
    unreachable: bool = False

    @property
    def scene_file(self) -> Path | None:
        """The user's own scene file, if it is one."""
        return None if self.scene is None or self.scene in TASK_NAMES else Path(self.scene)


@dataclass(frozen=True)
class MotionOptions(Motion):
    """A motion as options: its file is named by what it holds.

    Attributes:
        kind: what to do without a scene; --footsteps and --path choose their own.
        footsteps: CSV file of footsteps to walk, `side, x, y, yaw_degrees` a line.
        path: CSV file of a path to follow, `x, y` a line.
    """

    kind: Annotated[MotionKind, tyro.conf.arg(name="motion")] = Motion.kind
    file: tyro.conf.Suppress[Path | None] = None
    footsteps: Path | None = None
    path: Path | None = None

    def __post_init__(self) -> None:
        """Nothing is checked before it is known that there is no scene; `motion` checks."""

    def motion(self) -> Motion:
        """The motion that the options ask for.

        Raises:
            InputError: as `Motion`, or for two files.
        """
        given = {field.name: getattr(self, field.name) for field in dataclasses.fields(Motion)}
        if self.footsteps is not None and self.path is not None:
            raise InputError("Both --footsteps and --path are given; choose one.")
        if self.footsteps is not None:
            given |= {"kind": "footsteps", "file": self.footsteps}
        elif self.path is not None:
            given |= {"kind": "path", "file": self.path}
        return Motion(**given)


@dataclass(frozen=True)
class WalkOptions:
    """A walk: planned footsteps, without a scene.

    Attributes:
        motion: that is walked.
        robot: which one walks: bruce, g1, or a TOML file that describes another; only bruce walks in scenes.
        mjcf: the robot's model, in place of the file that its description names.
        robots: number of robots, each with friction, mass and start of its own; in scenes many walk with
            experiments.evaluate.
        engine: of the physics: MJX for batches, by our own step (mjx) or by MJX's (mjx.step), or C MuJoCo.
        solver: of the controller's whole-body QPs.
        view: play the first robot's walk in MuJoCo's viewer.
        devices: number of devices, all by default; on a CPU that many are made of its cores.
    """

    motion: Annotated[MotionOptions, tyro.conf.arg(name="")] = MotionOptions()
    robot: str = "bruce"
    mjcf: Path | None = None
    robots: int = 1
    engine: Engine = "mjx"
    solver: QpMethod = "active_set"
    view: bool = False
    devices: int | None = None


@dataclass(frozen=True)
class DisturbanceOptions(Disturbances):
    """What the robots meet; a push comes halfway, in a scene when half of the way would be walked at 0.25 m/s."""

    push_after: tyro.conf.Suppress[float] = Disturbances.push_after


@dataclass(frozen=True)
class SharedOptions:
    """What walks and episodes have in common.

    Attributes:
        disturbances: that the robots meet.
        seed: of the conditions and the sensors' noise.
        sensors: `none` feeds the true state back, the others walk on the estimate from simulated sensors; left out,
            `nominal` in a scene, else `none`.
        out: folder for pictures, video and figures.
        video: film the first robot.
        rerun: file (.rrd) to write for the viewer rerun: robot, footsteps, path, forces and torques of a walk; in a
            scene also depth and map.
    """

    disturbances: Annotated[DisturbanceOptions, tyro.conf.arg(name="")] = DisturbanceOptions()
    seed: int = 0
    sensors: Sensors | None = None
    out: Path = Path("runs/walk")
    video: bool = True
    rerun: Path | None = None


def option_values(options: Any) -> dict[str, Any]:
    """Values of a dataclass of options and of those in it, by name."""
    values: dict[str, Any] = {}
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if dataclasses.is_dataclass(value):
            values |= option_values(value)
        else:
            values["motion" if field.name == "kind" else field.name] = value
    return values


def refuse_others(episode: EpisodeOptions, walk: WalkOptions) -> None:
    """Refuse options that the kind of walk would not heed.

    Raises:
        InputError: which names all of them.
    """
    kind, others = ("without --scene", episode) if episode.scene is None else ("with --scene", walk)
    default = option_values(type(others)())
    changed = [name for name, value in option_values(others).items() if value != default[name]]
    given = [f"--{name.replace('_', '-')}" for name in changed]
    if given:
        raise InputError(
            f"A walk {kind} takes no {', '.join(given)}; leave out what belongs to the other kind of walk."
        )

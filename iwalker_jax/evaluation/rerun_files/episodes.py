"""An episode as a file of rerun: scene, robot, depth, map, path, footsteps and figures over time."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Int8

from iwalker_jax.evaluation.rerun_files.stream import (
    TIME,
    Skeleton,
    log_camera,
    log_depth,
    log_footsteps,
    log_line,
    on_floor,
    rerun_stream,
)
from iwalker_jax.geometry import Side
from iwalker_jax.navigation import EpisodeRecord, Outcome, recorded_window
from iwalker_jax.perception import CameraMount, Intrinsics
from iwalker_jax.planning import MapCell
from iwalker_jax.scenes import Scene
from iwalker_jax.tasks import Task

_COLOURS = {MapCell.UNSEEN: (186, 190, 197), MapCell.FREE: (250, 249, 245), MapCell.OCCUPIED: (93, 97, 107)}


def write_episode(
    file: Path,
    task: Task,
    episode: EpisodeRecord,
    camera: Intrinsics = Intrinsics(),
    model: mujoco.MjModel | None = None,
) -> None:
    """Write one episode; depth and map are there if its images were kept.

    Args:
        file: to write, with the ending .rrd.
        task: that was walked.
        episode: without batch axis, as `row_of` gives it.
        camera: of the depth images.
        model: of the robot; without one its body is not drawn.

    Raises:
        InputError: without rerun, or for a file that cannot be written.
    """
    import rerun as rr

    skeleton = None if model is None else Skeleton(model)
    images = np.size(episode.depth) > 0
    mount = np.asarray(CameraMount().as_array())
    ended = np.flatnonzero(np.asarray(episode.outcome) != Outcome.RUNNING)
    last = int(ended[0]) if ended.size else len(episode.time) - 1
    with rerun_stream(file) as stream:
        log_camera(stream, camera)
        _log_scene(stream, task.scene)
        stream.log(
            "world/goals", rr.Points3D(on_floor(np.asarray(task.goals)), radii=0.06, colors=(214, 0, 190)), static=True
        )
        stream.log("map", rr.AnnotationContext([(int(c), c.name.lower(), _COLOURS[c]) for c in MapCell]), static=True)
        for i in range(last + 1):
            stream.set_time(TIME, duration=float(episode.time[i]))
            if skeleton is not None:
                skeleton.log(stream, np.asarray(episode.qpos[i], float))
            log_line(stream, "world/path", np.asarray(episode.path[i]))
            steps = np.asarray(episode.footsteps[i])
            sides = (int(episode.first_side[i]) + np.arange(len(steps))) % len(Side)
            log_footsteps(stream, "world/footsteps", steps, sides)
            if images:
                believed = np.asarray(episode.believed[i])
                log_depth(stream, np.asarray(episode.depth[i], np.float32), believed, mount)
                _log_map(stream, np.asarray(episode.cells[i]), believed[:2])
            for name in ("torque_share", "clearance", "qp_failures", "stopped", "detour"):
                stream.log(f"figures/{name}", rr.Scalars(float(getattr(episode, name)[i])))
        outcome = Outcome(int(episode.outcome[last]))
        stream.log("outcome", rr.TextLog(f"{task.name}: {outcome.sentence}"))
        log_line(stream, "world/walked", np.asarray(episode.base[: last + 1, :2]), static=True)


def _log_scene(stream: Any, scene: Scene) -> None:
    import rerun as rr

    boxes, cylinders = np.asarray(scene.boxes), np.asarray(scene.cylinders)
    half = boxes[:, 6] / 2
    turns = np.column_stack([0 * half, 0 * half, np.sin(half), np.cos(half)])
    stream.log(
        "world/scene/boxes", rr.Boxes3D(centers=boxes[:, :3], half_sizes=boxes[:, 3:6], quaternions=turns), static=True
    )
    stream.log(
        "world/scene/cylinders",
        rr.Cylinders3D(centers=cylinders[:, :3], radii=cylinders[:, 3], lengths=2 * cylinders[:, 4]),
        static=True,
    )


def _log_map(stream: Any, cells: Int8[np.ndarray, "rows columns"], middle: Float[np.ndarray, " 2"]) -> None:
    """The map's window as an image with x up and y to the left, and its occupied cells where they are."""
    import rerun as rr

    corner, resolution = recorded_window(middle, len(cells))
    places = corner + (np.argwhere(cells == MapCell.OCCUPIED) + 0.5) * resolution
    stream.log("map", rr.SegmentationImage(np.ascontiguousarray(cells[::-1, ::-1]).astype(np.uint8)))
    stream.log("world/map/occupied", rr.Points3D(on_floor(places), radii=resolution / 2, colors=(93, 97, 107)))

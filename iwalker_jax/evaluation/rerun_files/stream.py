"""A file of the viewer rerun as it is written, and what several kinds of motions log alike."""

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import Side
from iwalker_jax.perception import Intrinsics
from iwalker_jax.runtime.files import atomic_write, require_writable
from iwalker_jax.scenes.ray_casting import world_camera_pose

SUFFIX = ".rrd"
TIME = "time"
"""The time line of motions, in seconds of the simulation."""

CAMERA = "world/camera"
ON_FLOOR = 0.01  # [m] above it, so that lines on the floor are seen
_FEET = {Side.RIGHT: (240, 120, 20), Side.LEFT: (31, 119, 180)}


def require_rerun(file: Path) -> None:
    """Refuse, before any work is done, a file that cannot be written.

    Raises:
        InputError: without rerun, for a file of another ending, and for a place that cannot be written to.
    """
    if importlib.util.find_spec("rerun") is None:
        raise InputError("Files of rerun need the package rerun-sdk; run: pip install 'iwalker-jax[rerun]'.")
    if file.suffix != SUFFIX:
        raise InputError(f"A file of rerun ends in {SUFFIX}; {str(file)!r} does not.")
    require_writable(file, is_file=True)


@contextmanager
def rerun_stream(file: Path) -> Iterator[Any]:
    """A stream to log to, which becomes the file when the block ends.

    Raises:
        InputError: as `require_rerun`.
    """
    require_rerun(file)
    import rerun as rr

    with atomic_write(file) as part:
        stream = rr.RecordingStream("iwalker-jax")
        stream.save(str(part))
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        yield stream
        stream.flush()
        stream.disconnect()


def on_floor(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    """Places [m] a little above the floor."""
    return np.column_stack([points, np.full(len(points), ON_FLOOR)])


def log_line(stream: Any, entity: str, points: Float[np.ndarray, "n 2"], static: bool = False) -> None:
    """A line [m] on the floor; nothing where it is not known."""
    import rerun as rr

    known = points[np.isfinite(points).all(axis=1)]
    stream.log(entity, rr.LineStrips3D([on_floor(known)], radii=0.008), static=static)


def log_footsteps(
    stream: Any, entity: str, places: Float[np.ndarray, "n 2"], sides: Int[np.ndarray, " n"], static: bool = False
) -> None:
    """Footsteps [m], right ones orange and left ones blue."""
    import rerun as rr

    colours = np.array([_FEET[Side(side)] for side in sides], np.uint8).reshape(-1, 3)
    stream.log(entity, rr.Points3D(on_floor(places), colors=colours, radii=0.02), static=static)


def log_camera(stream: Any, camera: Intrinsics) -> None:
    """The depth camera's intrinsics, for all times."""
    import rerun as rr

    lens = rr.Pinhole(
        focal_length=(camera.fx, camera.fy),
        principal_point=(camera.cx + 0.5, camera.cy + 0.5),
        resolution=(camera.width, camera.height),
        camera_xyz=rr.ViewCoordinates.RDF,
    )
    stream.log(CAMERA, lens, static=True)


def log_depth(
    stream: Any, depth: Float[np.ndarray, "h w"], base: Float[np.ndarray, " 3"], mount: Float[np.ndarray, " 5"]
) -> None:
    """A depth image [m] where a camera on a robot at (x, y, yaw) took it; its pixels are points of the world."""
    import rerun as rr

    R, p = world_camera_pose(jnp.asarray(base, jnp.float32), jnp.asarray(mount, jnp.float32))
    stream.log(CAMERA, rr.Transform3D(translation=np.asarray(p), mat3x3=np.asarray(R)))
    stream.log(f"{CAMERA}/depth", rr.DepthImage(np.asarray(depth, np.float32), meter=1.0, depth_range=(0.0, 6.0)))


class Skeleton:
    """Draws a robot as lines from each body to those that it carries."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self._bodies = np.flatnonzero(model.body_parentid > 0)

    def lines(self, qpos: Float[np.ndarray, " nq"]) -> Float[np.ndarray, "n 2 3"]:
        """(bodies, 2, 3) [m] ends of the lines, world frame."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        ends = np.stack([self._model.body_parentid[self._bodies], self._bodies], axis=1)
        return self._data.xpos[ends]

    def log(self, stream: Any, qpos: Float[np.ndarray, " nq"]) -> None:
        """The robot in a state; nothing if that is not finite."""
        import rerun as rr

        if np.isfinite(qpos).all():
            stream.log("world/robot", rr.LineStrips3D(self.lines(qpos), radii=0.012, colors=(45, 45, 50)))

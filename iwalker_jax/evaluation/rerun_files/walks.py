"""A walk on given footsteps as a file of rerun: robot, footsteps, forces, torques and the centre of mass over time."""

from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from iwalker_jax.evaluation.rerun_files.stream import TIME, Skeleton, log_footsteps, log_line, rerun_stream
from iwalker_jax.walking import WalkRecord

METRES_PER_NEWTON = 0.004
"""Length of a force's arrow: BRUCE's weight, 47 N, is 19 cm."""


def write_walk(
    file: Path,
    record: WalkRecord,
    model: mujoco.MjModel | None = None,
    qpos: Float[np.ndarray, "n nq"] | None = None,
) -> None:
    """Write one walk.

    Args:
        file: to write, with the ending .rrd.
        record: of the walk.
        model, qpos: robot and its state at each instant of the record; without them its body is not drawn.

    Raises:
        InputError: without rerun, or for a file that cannot be written.
    """
    import rerun as rr

    skeleton = None if model is None else Skeleton(model)
    with rerun_stream(file) as stream:
        if len(record.planned.times):
            log_footsteps(stream, "world/footsteps", record.planned.positions, record.planned.sides, static=True)
        if record.path is not None:
            log_line(stream, "world/path", record.path, static=True)
        if model is not None:
            names = [model.actuator(k).name for k in range(model.nu)]
            stream.log("figures/torques", rr.SeriesLines(names=names), static=True)
        for i, seconds in enumerate(record.time):
            if not np.isfinite(record.com[i]).all():
                continue
            stream.set_time(TIME, duration=float(seconds))
            if skeleton is not None and qpos is not None:
                skeleton.log(stream, np.asarray(qpos[i], float))
            # The points of a foot together, from its middle.
            feet = record.forces[i].reshape(2, -1, 3).sum(axis=1)
            arrows = rr.Arrows3D(origins=record.foot_positions[i], vectors=METRES_PER_NEWTON * feet, radii=0.005)
            stream.log("world/forces", arrows)
            stream.log("world/com", rr.Points3D([record.com[i]], radii=0.015, colors=(217, 38, 38)))
            stream.log("figures/torques", rr.Scalars(record.torques[i]))
            stream.log("figures/upward_force", rr.Scalars(feet[:, 2]))
            stream.log("figures/speed", rr.Scalars(float(np.linalg.norm(record.com_velocity[i, :2]))))

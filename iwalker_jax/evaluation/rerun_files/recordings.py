"""A depth recording as a file of rerun: its usable frames as images and as points of the world."""

from pathlib import Path

import numpy as np

from iwalker_jax.data import Recording
from iwalker_jax.evaluation.rerun_files.stream import log_camera, log_depth, log_line, rerun_stream

FRAME = "frame"
"""The time line of recordings, which know no seconds."""


def write_recording(file: Path, recording: Recording) -> None:
    """Write the usable frames of a recording; without poses all are where the first robot would stand.

    Args:
        file: to write, with the ending .rrd.
        recording: of `load_recording`.

    Raises:
        InputError: without rerun, for a file that cannot be written, and for frames that have gone bad.
    """
    poses = np.zeros((len(recording), 3)) if recording.poses is None else recording.poses
    with rerun_stream(file) as stream:
        log_camera(stream, recording.camera)
        log_line(stream, "world/walked", np.asarray(poses[:, :2], float), static=True)
        for i, depth in enumerate(recording.depth_frames()):
            stream.set_time(FRAME, sequence=i)
            log_depth(stream, depth, np.asarray(poses[i], float), np.asarray(recording.mounts[i], float))
            if recording.goals is not None:
                cos, sin = np.cos(poses[i, 2]), np.sin(poses[i, 2])
                goal = poses[i, :2] + np.array([[cos, -sin], [sin, cos]]) @ recording.goals[i]
                log_line(stream, "world/to_goal", np.stack([poses[i, :2], goal]).astype(float))

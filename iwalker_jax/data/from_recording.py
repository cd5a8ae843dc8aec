"""A user's own recording as training frames: goals are sampled where each frame itself shows free, reachable ground."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

from iwalker_jax.data.frame_set import FrameSet, depth_to_millimetres
from iwalker_jax.data.recordings import NO_FREE_GROUND, goal_places, load_recording
from iwalker_jax.geometry import host
from iwalker_jax.perception import Intrinsics
from iwalker_jax.runtime import printable


def frames_from_recording(
    folder: Path,
    goals_per_frame: int = 6,
    seed: int = 0,
    intrinsics: Intrinsics | None = None,
    depth_scale: float | None = None,
    say: Callable[[str], None] = print,
    camera: Intrinsics = Intrinsics(),
    topic: str | None = None,
) -> FrameSet:
    """Frames of a recording's folder or bag with goals; what was assumed or left out is said.

    With poses the first goal is where the recording ends, as in the paper; the others, and all of them without poses,
    are cells that the frame itself shows to be free and reachable, evenly spread over distances.

    Args:
        folder: in any layout that `load_recording` knows.
        goals_per_frame: goals for each frame.
        seed: of the goals.
        intrinsics, depth_scale: override the folder's own.
        say: hears the sentences.
        camera: that the frames are re-projected to.
        topic: of a bag's depth images; None chooses.

    Raises:
        InputError: if the recording is unusable.
    """
    recording = load_recording(folder, intrinsics, depth_scale, camera, topic)
    blocked = [problem for problem in recording.report.problems if problem.problem == NO_FREE_GROUND]
    for problem in recording.report.problems:
        if problem not in blocked:
            say(f"{problem.file} {problem.problem}")
    if blocked:
        total = len(recording) + len(blocked)
        say(f"{len(blocked)} of {total} frames show no free ground ahead and were left out.")
    for recorded in recording.report.topics:
        say(f"Topic {printable(recorded.name)} ({recorded.type}, {recorded.messages} messages): {recorded.use}.")
    for assumption in recording.report.assumptions:
        say(f"Assumed: {assumption}")
    depth = recording.depth_frames()
    n = len(depth)
    rng = np.random.default_rng(seed)
    goals = np.stack([_sample_goals(goal_places(cells), goals_per_frame, rng) for cells in recording.reachable])
    poses = np.full((n, 3), np.nan, np.float32) if recording.poses is None else recording.poses
    if recording.goals is not None:
        goals[:, 0] = recording.goals
    elif recording.poses is not None:
        goals[:, 0] = host.to_base(poses, poses[-1, :2])
    mounts, scene_index, names = recording.mounts, np.zeros(n, np.int32), (folder.resolve().name,)
    return FrameSet(depth_to_millimetres(depth), mounts, goals, poses, scene_index, names, camera)


def _sample_goals(
    places: Float[np.ndarray, "n 2"], count: int, rng: np.random.Generator
) -> Float32[np.ndarray, "count 2"]:
    """Some of the places [m], evenly spread over distances: area grows with distance, so each weighs its inverse."""
    weight = 1.0 / np.linalg.norm(places, axis=1)
    return places[rng.choice(len(places), size=count, p=weight / weight.sum())].astype(np.float32)

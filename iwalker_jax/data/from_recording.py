"""A user's own recording as training frames: goals are sampled where each frame itself shows free, reachable ground."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from iwalker_jax.data.frame_set import FrameSet, depth_to_millimetres
from iwalker_jax.data.recordings import load_recording
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY, host
from iwalker_jax.perception import (
    DEFAULT_GRID,
    UNREACHABLE,
    Intrinsics,
    build_local_map,
    cost_to_go,
    halved,
    pool_2x2,
    trusted_cost,
)

_GRID = halved(DEFAULT_GRID)
_NEAREST_GOAL, _FARTHEST_GOAL = 0.6, 6.0


def frames_from_recording(
    folder: Path,
    goals_per_frame: int = 6,
    seed: int = 0,
    intrinsics: Intrinsics | None = None,
    depth_scale: float | None = None,
    say: Callable[[str], None] = print,
    camera: Intrinsics = Intrinsics(),
) -> FrameSet:
    """Frames of a recording folder with goals; what was assumed or left out is said.

    With poses the first goal is where the recording ends, as in the paper; the others, and all of them without poses,
    are cells that the frame itself shows to be free and reachable, evenly spread over distances.

    Args:
        folder: in any layout that `load_recording` knows.
        goals_per_frame: goals for each frame.
        seed: of the goals.
        intrinsics, depth_scale: override the folder's own.
        say: hears the sentences.
        camera: that the frames are re-projected to.

    Raises:
        InputError: if the recording is unusable, or no frame shows any free ground.
    """
    recording = load_recording(folder, intrinsics, depth_scale, camera)
    for problem in recording.report.problems:
        say(f"{problem.file} {problem.problem}")
    for assumption in recording.report.assumptions:
        say(f"Assumed: {assumption}")
    depth = recording.depth_frames()
    mounts = np.asarray(recording.mounts, np.float32)
    n = len(depth)
    rng = np.random.default_rng(seed)
    goals = np.zeros((n, goals_per_frame, 2), np.float32)
    usable = np.ones(n, bool)
    for i in range(n):
        sampled = _sample_goals(np.asarray(_reachable(depth[i], mounts[i], camera)), goals_per_frame, rng)
        if sampled is None:
            usable[i] = False
        else:
            goals[i] = sampled
    if not usable.any():
        raise InputError(
            f"No frame of {folder} shows free ground ahead; check the camera's mount and intrinsics with "
            "`python -m experiments.validate_recording`."
        )
    if not usable.all():
        say(f"{(~usable).sum()} of {n} frames show no free ground ahead and were left out.")
    poses = np.full((n, 3), np.nan, np.float32) if recording.poses is None else recording.poses
    if recording.goals is not None:
        goals[:, 0] = recording.goals
    elif recording.poses is not None:
        goals[:, 0] = host.to_base(poses, poses[-1, :2])
    frames = FrameSet(
        depth_to_millimetres(depth), mounts, goals, poses, np.zeros(n, np.int32), (folder.resolve().name,), camera
    )
    return frames.select(np.flatnonzero(usable))


@partial(jax.jit, static_argnames="camera")
def _reachable(
    depth: Float[Array, "height width"], mount: Float[Array, " 5"], camera: Intrinsics
) -> Bool[Array, "rows columns"]:
    """Cells of the coarse grid that the robot can reach without leaving seen free space."""
    local = build_local_map(depth, mount, camera)
    free = (pool_2x2(local.known_free.astype(jnp.float32)) > 0.99) & (pool_2x2(local.esdf) > BODY.route_radius)
    to_go = cost_to_go(jnp.where(free, 1.0, jnp.inf), jnp.zeros(2), _GRID)
    return free & (trusted_cost(to_go) < UNREACHABLE)


def _sample_goals(
    reachable: Bool[np.ndarray, "rows columns"], count: int, rng: np.random.Generator
) -> Float[np.ndarray, "count 2"] | None:
    centres = np.argwhere(reachable) * _GRID.resolution + 0.5 * _GRID.resolution + (_GRID.x_min, _GRID.y_min)
    distance = np.linalg.norm(centres, axis=1)
    index = np.flatnonzero((distance > _NEAREST_GOAL) & (distance < _FARTHEST_GOAL))
    if len(index) == 0:
        return None
    weight = 1.0 / distance[index]
    return centres[rng.choice(index, size=count, p=weight / weight.sum())]

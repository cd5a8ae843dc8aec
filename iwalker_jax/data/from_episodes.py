"""Training frames from the robot's own episodes: what the camera sees while it walks, with goals, and no labels.

Generated camera paths keep to good routes. A robot that walks by its own plans also sees what its mistakes lead to:
obstacles close ahead, headings off the route, the gait's sway. The losses need nothing but the images, so such frames
teach as any others do.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.data.frame_set import FrameSet, concatenate, depth_to_millimetres
from iwalker_jax.data.goals import cells_that_reach, reachable_goals
from iwalker_jax.data.path_sampling import CameraPathSampling
from iwalker_jax.errors import InputError
from iwalker_jax.navigation import EpisodeRecord, Outcome, RobotCamera, camera_in_world, measured_mount
from iwalker_jax.perception import Intrinsics
from iwalker_jax.tasks import Task


def frames_from_episodes(
    camera: RobotCamera,
    intrinsics: Intrinsics,
    tasks: Sequence[Task],
    record: EpisodeRecord,
    stride: int = 12,
    seed: int = 0,
    sampling: CameraPathSampling = CameraPathSampling(),
) -> FrameSet:
    """Every `stride`-th frame of every episode, from a random one on, with the present goal and random reachable ones.

    Args:
        camera: that recorded.
        intrinsics: of its images.
        tasks: of the episodes.
        record: NumPy, batch first, with images kept.
        stride: frames from one taken to the next.
        seed: of phases and goals.
        sampling: goals per frame and how far.

    Raises:
        InputError: for a record without images, or one in which no robot ever walked.
    """
    if record.depth.shape[-1] == 0:
        raise InputError("The episodes were recorded without images; record them with images=True.")
    parts = []
    for k, task in enumerate(tasks):
        rng = np.random.default_rng([seed, k])
        running = np.flatnonzero(record.outcome[k] == Outcome.RUNNING)
        chosen = running[1 + rng.integers(stride) :: stride]
        if len(chosen) == 0:
            continue
        # The image was taken at the frame's start, where the frame before ended.
        poses = np.asarray(record.base[k, chosen - 1], np.float32)
        aims = np.asarray(record.goal[k, chosen])
        reach = {aim: cells_that_reach(task.scene, task.goals[aim]) for aim in np.unique(aims)}
        origin = np.asarray(task.scene.bounds[:2], float)
        aimed = [
            reachable_goals(pose[None], task.goals[aim], reach[aim], origin, rng, sampling)
            for pose, aim in zip(poses, aims, strict=True)
        ]
        goals = np.concatenate(aimed)
        depth = depth_to_millimetres(np.asarray(record.depth[k, chosen], np.float32))
        mounts = np.asarray(_mounts(camera, jnp.asarray(record.qpos[k, chosen - 1]), jnp.asarray(poses)))
        parts.append(FrameSet(depth, mounts, goals, poses, np.zeros(len(chosen), np.int32), (task.name,), intrinsics))
    if not parts:
        raise InputError("No robot walked in these episodes; collect from other tasks.")
    return concatenate(parts)


@jax.jit
def _mounts(camera: RobotCamera, qpos: Float[Array, "n nq"], poses: Float[Array, "n 3"]) -> Float[Array, "n 5"]:
    return jax.vmap(lambda q, pose: measured_mount(*camera_in_world(camera, q), pose))(qpos, poses)

"""Frames of episodes: where the camera was, which goals are asked for, and that they go with other frames.

Oracles: the robot's own kinematics one frame earlier, rotations in NumPy, the distance to the scene's obstacles.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from bruce_model import load_mujoco
from iwalker_jax.data.frame_set import concatenate
from iwalker_jax.data.from_episodes import frames_from_episodes
from iwalker_jax.data.path_sampling import CameraPathSampling
from iwalker_jax.errors import InputError
from iwalker_jax.navigation.camera import camera_in_world, load_camera
from iwalker_jax.perception import Intrinsics
from iwalker_jax.scenes.ray_casting import world_camera_pose
from iwalker_jax.scenes.scene import obstacle_distance
from tests.evaluation.episode_records import make_record, make_task

CAMERA = Intrinsics(160, 90)
SAMPLING = CameraPathSampling(goals_per_frame=4)


@pytest.fixture(scope="module")
def camera():
    return load_camera(load_mujoco())


@pytest.fixture(scope="module")
def frames(camera):
    return frames_from_episodes(camera, CAMERA, [make_task()], make_record(images=True), 10, 0, SAMPLING)


def test_mount_and_pose_say_where_the_camera_was_when_the_image_was_taken(camera, frames):
    """Oracle: the camera of the true state one frame earlier, where the image's frame began."""
    record = make_record(images=True)
    at = [int(np.argmin(np.linalg.norm(record.base[0, :, :2] - pose[:2], axis=1))) for pose in frames.poses]
    assert len(at) > 20 and np.ptp(np.diff(at)) == 0
    for k, frame in enumerate(at):
        rotation, position = camera_in_world(camera, jnp.asarray(record.qpos[0, frame], jnp.float32))
        again, place = world_camera_pose(jnp.asarray(frames.poses[k]), jnp.asarray(frames.mounts[k]))
        np.testing.assert_allclose(place, position, atol=1e-5)
        np.testing.assert_allclose(again, rotation, atol=1e-5)


def test_goals_lead_to_the_tasks_goal_and_to_free_places(frames):
    """Oracle: the pose's rotation in NumPy, and the distance to the scene's obstacles."""
    task = make_task()
    scene = task.scene.arrays()
    for pose, goals in zip(frames.poses, frames.goals, strict=True):
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        world = goals @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
        np.testing.assert_allclose(world[0], task.goals[0], atol=1e-4)
        assert float(obstacle_distance(scene, jnp.asarray(world)).min()) > 0.1


def test_frames_of_episodes_join_others_of_the_same_kind(camera, frames):
    both = concatenate([frames, frames])
    assert len(both) == 2 * len(frames)
    assert both.scene_index.max() == 1
    other = frames_from_episodes(
        camera, CAMERA, [make_task()], make_record(images=True), 10, 0, CameraPathSampling(goals_per_frame=2)
    )
    with pytest.raises(InputError, match="cannot be trained on together"):
        concatenate([frames, other])


def test_records_without_images_are_refused(camera):
    with pytest.raises(InputError, match="without images"):
        frames_from_episodes(camera, CAMERA, [make_task()], make_record())

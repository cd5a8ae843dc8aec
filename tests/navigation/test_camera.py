"""The robot's camera in the world and in its base frame. Oracles: C MuJoCo, and the definition of a mount."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from bruce_model import load_mujoco
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import to_base, to_world
from iwalker_jax.navigation.camera import base_pose, camera_in_world, load_camera, measured_mount
from iwalker_jax.perception.camera import camera_pose
from iwalker_jax.scenes.ray_casting import world_camera_pose


@pytest.fixture(scope="module")
def model():
    return load_mujoco()


def random_qpos(model: mujoco.MjModel, seed: int) -> np.ndarray:
    """The crouch, moved and turned at random within a walking robot's tilt."""
    rng = np.random.default_rng(seed)
    qpos = np.array(model.key_qpos[0])
    qpos[:3] += rng.uniform(-2, 2, 3) * [1, 1, 0.01]
    tilt = rng.normal(0, 0.05, 2)
    yaw = rng.uniform(-np.pi, np.pi)
    turned, tilted = np.zeros(4), np.zeros(4)
    mujoco.mju_euler2Quat(tilted, np.array([*tilt, 0.0]), "xyz")
    mujoco.mju_mulQuat(turned, np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]), tilted)
    qpos[3:7] = turned
    return qpos


@pytest.mark.parametrize("seed", range(4))
def test_the_camera_is_where_mujoco_has_it(model, seed):
    """Oracle: C MuJoCo's cam_xpos and cam_xmat."""
    qpos = random_qpos(model, seed)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    index = model.camera("depth").id
    rotation, position = camera_in_world(load_camera(model), jnp.asarray(qpos, jnp.float32))
    np.testing.assert_allclose(position, data.cam_xpos[index], atol=2e-6)
    optical = data.cam_xmat[index].reshape(3, 3) @ np.diag([1, -1, -1])
    np.testing.assert_allclose(rotation, optical, atol=2e-6)


@pytest.mark.parametrize("seed", range(4))
def test_mount_and_base_give_the_camera_back(model, seed):
    """Oracle: the mount's own definition, `world_camera_pose`."""
    qpos = jnp.asarray(random_qpos(model, seed), jnp.float32)
    rotation, position = camera_in_world(load_camera(model), qpos)
    base = base_pose(rotation, position + jnp.asarray([0.03, -0.02, -0.2]))
    mount = measured_mount(rotation, position, base)
    again, place = world_camera_pose(base, mount)
    np.testing.assert_allclose(again, rotation, atol=3e-6)
    np.testing.assert_allclose(place, position, atol=3e-6)
    assert camera_pose(mount)[1][2] == pytest.approx(float(position[2]))


def test_frames_are_inverse_to_each_other_and_differentiable():
    base = jnp.asarray([1.0, -2.0, 0.7])
    points = jax.random.normal(jax.random.key(0), (5, 2))
    np.testing.assert_allclose(to_base(base, to_world(base, points)), points, atol=1e-6)
    forward = to_world(base, jnp.asarray([1.0, 0.0])) - base[:2]
    np.testing.assert_allclose(forward, [np.cos(0.7), np.sin(0.7)], atol=1e-6)


def test_a_robot_without_the_camera_is_refused(model):
    with pytest.raises(InputError, match="no camera 'lidar'"):
        load_camera(model, "lidar")

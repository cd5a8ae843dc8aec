"""Export to MuJoCo: every geom arrives with its pose and size, and rays measure what they should."""

import mujoco
import numpy as np

from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.scenes.built.training_scenes import generate_scene
from iwalker_jax.scenes.mjcf import load_mujoco_scene, mujoco_ray_depth, scene_to_mjcf
from iwalker_jax.scenes.scene import Scene

LEVEL_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def test_geoms_arrive_with_pose_and_size():
    """Oracle: the scene's own rows against MuJoCo's compiled model."""
    scene = generate_scene("meeting_room", 1)
    model, data = load_mujoco_scene(scene)
    assert model.ngeom == 2 + len(scene.boxes) + len(scene.cylinders)
    for i, row in enumerate(scene.boxes):
        geom = model.geom(f"box{i}").id
        np.testing.assert_allclose(data.geom_xpos[geom], row[:3], atol=1e-12)
        np.testing.assert_allclose(model.geom_size[geom], row[3:6], atol=1e-12)
        axes = data.geom_xmat[geom].reshape(3, 3)
        np.testing.assert_allclose(axes[:, 0], (np.cos(row[6]), np.sin(row[6]), 0), atol=1e-12)
        np.testing.assert_allclose(axes[:, 2], (0, 0, 1), atol=1e-12)
    for i, row in enumerate(scene.cylinders):
        geom = model.geom(f"cylinder{i}").id
        np.testing.assert_allclose(data.geom_xpos[geom], row[:3], atol=1e-12)
        np.testing.assert_allclose(model.geom_size[geom][:2], row[3:], atol=1e-12)
    assert (model.geom_matid >= 0).all()


def test_a_body_lands_on_the_exported_floor():
    """Oracle: statics; a ball dropped into the scene comes to rest on the floor, so geoms collide."""
    scene = Scene("t", "t", np.empty((0, 7)), np.empty((0, 5)), (-1.0, -1.0, 1.0, 1.0), None)
    ball = '<body pos="0 0 0.3"><freejoint/><geom type="sphere" size="0.1" mass="1"/></body></worldbody>'
    model = mujoco.MjModel.from_xml_string(scene_to_mjcf(scene).replace("</worldbody>", ball))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 1000)
    assert abs(data.qpos[2] - 0.1) < 5e-3


def test_depth_is_measured_along_the_optical_axis():
    """Oracle: by hand; a wall square to the axis has one z-depth all over, the open side none."""
    wall = np.array([[3.0, 0.0, 1.0, 0.5, 9.0, 3.0, 0.0]])
    scene = Scene("t", "t", wall, np.empty((0, 5)), (-5.0, -5.0, 5.0, 5.0), None)
    K = Intrinsics(9, 7, 30.0, 30.0, 4.0, 3.0)
    position, loaded = np.array([0.5, 0.0, 1.0]), load_mujoco_scene(scene)
    np.testing.assert_allclose(mujoco_ray_depth(*loaded, K, LEVEL_CAMERA, position), 2.0, atol=1e-9)
    assert (mujoco_ray_depth(*loaded, K, LEVEL_CAMERA, position, max_depth=1.9) == 0).all()
    backwards = LEVEL_CAMERA @ np.diag([-1.0, 1.0, -1.0])
    depth = mujoco_ray_depth(*loaded, K, backwards, position, max_depth=50.0)
    assert (depth[:4] == 0).all() and (depth[4:] > 5).all()

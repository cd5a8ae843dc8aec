"""Geometry: C MuJoCo's forward kinematics against closed-form chains; crouch, height and shapes."""

import mujoco
import numpy as np
import pytest

from bruce_model import crouch_base_height, crouch_qpos
from bruce_model.parameters import DEPTH_CAMERA
from bruce_model.symmetry import all_links
from tests.bruce_model.numpy_robot import link_states, mirrored_qpos, quaternion_rotation, random_qpos


def state_at(model, qpos) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return data


def rx(a):
    return np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])


def ry(a):
    return np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])


def rz(a):
    return np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])


def foot_point(side: int, joints, x: float) -> np.ndarray:
    """A point of the sole in the base frame, x ahead of the ankle; side is -1 right, +1 left."""
    yaw, pitch, roll, knee, ankle = joints
    hip = np.array([0.029216, side * 0.0758557, -0.039765])
    below_knee = np.array([0, 0, -0.1998806]) + ry(-ankle) @ [x, 0, -0.024]
    below_hip = np.array([0, 0, -0.2049494]) + ry(-knee) @ below_knee
    return hip + rz(yaw) @ ry(-pitch) @ rx(roll) @ below_hip


def hand_point(side: int, joints) -> np.ndarray:
    """The hand in the base frame."""
    pitch, roll, elbow = joints
    forearm = np.array([0.005, side * 0.1146, 0.005]) + rz(elbow) @ [0, side * 0.13, 0]
    return np.array([0.029216, side * 0.12375, 0.152985]) + ry(side * pitch) @ rx(roll) @ forearm


def test_feet_and_hands_follow_the_closed_form_chain(model):
    rng = np.random.default_rng(1)
    for _ in range(20):
        qpos = random_qpos(rng)
        data = state_at(model, qpos)
        rotation = quaternion_rotation(qpos[3:7])
        for side, name, leg, arm in ((-1, "r", qpos[7:12], qpos[17:20]), (1, "l", qpos[12:17], qpos[20:23])):
            points = {"sole": 0.0, "toe": 0.05, "heel": -0.035, "midfoot": 0.0075}
            expected = {f"{point}_{name}": foot_point(side, leg, x) for point, x in points.items()}
            expected[f"hand_{name}"] = hand_point(side, arm)
            for site, point in expected.items():
                np.testing.assert_allclose(data.site(site).xpos, qpos[:3] + rotation @ point, atol=1e-12)


def test_centres_of_mass_follow_the_table(model):
    rng = np.random.default_rng(2)
    qpos = random_qpos(rng)
    data, states = state_at(model, qpos), link_states(qpos)
    for link in all_links():
        np.testing.assert_allclose(data.body(link.name).xipos, states[link.name].com, atol=1e-12)


def test_mirrored_configuration_is_the_mirror_image(model):
    rng = np.random.default_rng(3)
    for _ in range(5):
        qpos = random_qpos(rng)
        data, mirrored = state_at(model, qpos), state_at(model, mirrored_qpos(qpos))
        for point in ("sole", "toe", "heel", "hand"):
            right = data.site(f"{point}_r").xpos
            np.testing.assert_allclose(mirrored.site(f"{point}_l").xpos, right * [1, -1, 1], atol=1e-12)


def test_crouch_stands_flat_with_the_com_at_walking_height(model):
    key = model.key("crouch")
    np.testing.assert_allclose(key.qpos, crouch_qpos(), atol=1e-11)
    assert crouch_base_height() == pytest.approx(0.417, abs=5e-4)
    data = state_at(model, key.qpos)
    for side, y in (("r", -0.0758557), ("l", 0.0758557)):
        toe, heel, sole = (data.site(f"{name}_{side}").xpos for name in ("toe", "heel", "sole"))
        np.testing.assert_allclose([toe[2], heel[2]], 0.0, atol=1e-9)
        np.testing.assert_allclose([toe[1], heel[1], sole[1]], y, atol=1e-12)
        sphere = data.geom(f"toe_{side}")
        assert sphere.xpos[2] - model.geom(f"toe_{side}").size[0] == pytest.approx(0.0, abs=1e-9)
    com = data.subtree_com[model.body("base").id]
    assert com[2] == pytest.approx(0.365, abs=5e-4)
    assert com[1] == pytest.approx(0.0, abs=1e-12)
    assert data.site("heel_r").xpos[0] < com[0] < data.site("toe_r").xpos[0]


def shape_corners(model, data, geoms) -> np.ndarray:
    """World corners of the geoms' own bounding boxes: (n, 3)."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    boxes = [model.geom_aabb[g][:3] + signs * model.geom_aabb[g][3:] for g in geoms]
    return np.concatenate([data.geom_xpos[g] + box @ data.geom_xmat[g].reshape(3, 3).T for g, box in zip(geoms, boxes)])


def shapes_of(model, *bodies) -> list[int]:
    ids = [model.body(name).id for name in bodies]
    return [g for g in range(model.ngeom) if model.geom_group[g] == 2 and model.geom_bodyid[g] in ids]


def test_straight_robot_is_as_tall_and_as_wide_as_published(model):
    qpos = crouch_qpos()
    qpos[7:17] = 0.0
    data = state_at(model, qpos)
    every = [g for g in range(model.ngeom) if model.geom_group[g] == 2]
    corners = shape_corners(model, data, every)
    assert np.ptp(corners[:, 2]) == pytest.approx(0.663, abs=1e-3)
    torso = shape_corners(model, data, shapes_of(model, "base", "shoulder_pitch_r", "shoulder_pitch_l"))
    assert np.ptp(torso[:, 1]) == pytest.approx(0.25, abs=0.01)


def test_shapes_surround_their_link_s_centre_of_mass(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)  # every body frame is parallel to the world
    for link in all_links():
        corners = shape_corners(model, data, shapes_of(model, link.name)) - data.body(link.name).xpos
        assert np.all(corners.min(axis=0) <= link.com), link.name
        assert np.all(corners.max(axis=0) >= link.com), link.name


def test_only_foot_spheres_can_touch_and_only_the_floor(model):
    active = [model.geom(g).name for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
    assert sorted(active) == ["floor", "heel_l", "heel_r", "toe_l", "toe_r"]
    spheres = [model.geom(f"{name}_{side}") for side in "rl" for name in ("toe", "heel")]
    assert all(sphere.contype[0] == 1 and sphere.conaffinity[0] == 0 for sphere in spheres)
    assert model.geom("floor").contype[0] == 0


def test_depth_camera_sees_the_floor_and_none_of_the_robot(model):
    """C MuJoCo's rays through a pinhole written here, against the plane z = 0."""
    data = state_at(model, crouch_qpos())
    camera = data.camera("depth")
    pose = camera.xmat.reshape(3, 3)
    assert np.arcsin(pose[2, 2]) == pytest.approx(DEPTH_CAMERA.pitch_down)
    assert tuple(model.cam_resolution[model.camera("depth").id]) == (160, 90)
    floor, hit = model.geom("floor").id, np.zeros(1, np.int32)
    seen = 0
    for v in np.arange(0.5, 90, 8):
        for u in np.arange(0.5, 160, 8):
            # The pinhole's focal length from the model's own vertical view angle.
            focal = 45 / np.tan(np.radians(model.camera("depth").fovy[0]) / 2)
            ray = pose @ np.array([(u - 80) / focal, (45 - v) / focal, -1.0])
            distance = mujoco.mj_ray(model, data, camera.xpos, ray, None, 1, -1, hit, None)
            if ray[2] >= 0:
                assert hit[0] == -1
                continue
            assert hit[0] == floor
            assert distance == pytest.approx(-camera.xpos[2] / ray[2])
            seen += distance < 3.0
    assert seen > 100
    assert focal == pytest.approx(80.0)

"""The table itself: masses, inertias and limits, against published totals and a NumPy re-derivation."""

import mujoco
import numpy as np
import pytest

from bruce_model.symmetry import all_links, all_motors, joint_names
from tests.bruce_model.numpy_robot import inertia_matrix

LINKS = {link.name: link for link in all_links()}


def test_masses_add_up_to_the_published_ones(model):
    leg = ["hip_yaw_r", "hip_pitch_r", "thigh_r", "shank_r", "foot_r"]
    arm = ["shoulder_pitch_r", "upper_arm_r", "forearm_r"]
    assert sum(LINKS[name].mass for name in leg) == pytest.approx(1.437, abs=5e-4)
    assert sum(LINKS[name].mass for name in arm) == pytest.approx(0.129, abs=5e-4)
    assert np.sum(model.body_mass) == pytest.approx(4.4497, abs=5e-5)


def test_inertias_are_those_of_real_bodies():
    assert len(LINKS) == 17
    for link in LINKS.values():
        principal = np.linalg.eigvalsh(inertia_matrix(link.inertia))
        assert principal[0] > 0, link.name
        assert principal[0] + principal[1] > principal[2], link.name


def test_mujoco_keeps_masses_centres_and_inertias(model):
    for link in LINKS.values():
        body = model.body(link.name)
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, body.iquat)
        rotation = rotation.reshape(3, 3)
        tensor = rotation @ np.diag(body.inertia) @ rotation.T
        assert body.mass[0] == link.mass
        np.testing.assert_allclose(body.ipos, link.com, atol=1e-12)
        np.testing.assert_allclose(tensor, inertia_matrix(link.inertia), atol=1e-9 * np.max(body.inertia))


def test_thigh_inertia_is_the_published_one_moved_to_the_com():
    """NumPy re-derivation from the vendor's row: moments about the link origin, products with the opposite sign."""
    mass, com = 0.66351862, np.array([0.139, 0.00037269, -0.00649])
    published = inertia_matrix([0.000442, 0.016, 0.0157, 7.29e-05, -0.000291, 1.11e-06])
    about_origin = 2 * np.diag(np.diag(published)) - published
    about_com = about_origin - mass * (com @ com * np.eye(3) - np.outer(com, com))
    from_vendor = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # the vendor's x axis points down
    thigh = LINKS["thigh_r"]
    np.testing.assert_allclose(thigh.com, from_vendor @ com, atol=1e-6)
    np.testing.assert_allclose(inertia_matrix(thigh.inertia), from_vendor @ about_com @ from_vendor.T, rtol=1e-5)


def test_left_is_the_mirror_image_of_right():
    """Derived again with reflection matrices; the axis of a rotation is a pseudo-vector."""
    reflection = np.diag([1.0, -1.0, 1.0])
    for right in (link for link in LINKS.values() if link.name.endswith("_r")):
        left = LINKS[right.name[:-1] + "l"]
        np.testing.assert_array_equal(left.com, reflection @ right.com)
        np.testing.assert_array_equal(left.position, reflection @ right.position)
        expected = reflection @ inertia_matrix(right.inertia) @ reflection
        np.testing.assert_array_equal(inertia_matrix(left.inertia), expected)
        sign = right.hinge.mirror_sign
        np.testing.assert_array_equal(left.hinge.axis, -sign * reflection @ right.hinge.axis)
        assert sorted([sign * left.hinge.low, sign * left.hinge.high]) == [right.hinge.low, right.hinge.high]


def test_joints_and_their_limits(model):
    leg = ["hip_yaw", "hip_pitch", "hip_roll", "knee_pitch", "ankle_pitch"]
    arm = ["shoulder_pitch", "shoulder_roll", "elbow_pitch"]
    expected = [f"{name}_{side}" for part in (leg, arm) for side in "rl" for name in part]
    assert joint_names() == tuple(expected)
    assert [model.joint(i + 1).name for i in range(16)] == expected
    assert np.all(model.jnt_limited[1:])
    limits = {name: tuple(model.joint(name).range) for name in expected}
    assert limits["hip_yaw_r"] == pytest.approx((-np.pi / 2, np.pi / 2), abs=1e-6)
    assert limits["hip_pitch_l"] == (-0.4, 2.5)
    assert limits["hip_roll_l"] == pytest.approx((-np.pi / 4, np.pi / 4), abs=1e-6)
    assert limits["knee_pitch_r"] == (-2.5, 0.0)
    assert limits["ankle_pitch_l"] == (-1.5, 1.5)
    assert limits["shoulder_roll_r"] == pytest.approx((-np.pi / 2, 1.9), abs=1e-6)
    assert limits["shoulder_roll_l"] == pytest.approx((-1.9, np.pi / 2), abs=1e-6)
    assert limits["elbow_pitch_l"] == (-2.3, 2.3)


def test_motors_and_their_limits(model):
    leg, arm = ["hip_yaw", "hip_a", "hip_b", "knee", "ankle"], ["shoulder_pitch", "shoulder_roll", "elbow_pitch"]
    expected = [f"{name}_{side}" for part in (leg, arm) for side in "rl" for name in part]
    assert [motor.name for motor in all_motors()] == expected
    assert [model.actuator(i).name for i in range(model.nu)] == expected
    np.testing.assert_array_equal(model.actuator_forcerange[:10], np.tile([-10.5, 10.5], (10, 1)))
    np.testing.assert_array_equal(model.actuator_forcerange[10:], np.tile([-1.0, 1.0], (6, 1)))

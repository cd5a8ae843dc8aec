"""Loading: what a robot must have is asked for in one sentence, and indices follow from names."""

import re

import mujoco
import numpy as np
import pytest

import bruce_model
from iwalker_jax.errors import InputError
from iwalker_jax.robot.model import load_robot_model

XML = re.sub("<keyframe>.*</keyframe>", "", bruce_model.mjcf_text(), flags=re.DOTALL)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('<site class="point" name="midfoot_l"', '<site class="point" name="middle_l"', "no site 'midfoot_l'"),
        ('name="heel_r" pos="-0.035 0 -0.018"', 'name="back_r" pos="-0.035 0 -0.018"', "have 1 and 2 contact points"),
        ('<joint name="hip_yaw_l"', '<joint name="hip_twist_l"', "mujoco cannot load"),
        ('<freejoint name="base" />', "", "free joint"),
        ('integrator="implicitfast"', 'integrator="RK4"', "integrator"),
        ('cone="pyramidal"', 'cone="elliptic"', "cone"),
        ('<motor name="knee_r" joint="knee_pitch_r"', '<motor name="knee_r" joint="hip_yaw_r"', "one to one"),
        ('<motor name="elbow_pitch_l"', '<position name="elbow_pitch_l"', "actuator"),
        ('range="-2.5 0"', 'range="-2.5 0" frictionloss="0.1"', "dry friction"),
        ('range="-2.5 0"', 'range="-2.5 0" stiffness="1"', "springs"),
        ('condim="3" priority', 'condim="4" priority', "condim 3"),
        ('contype="1" conaffinity="0"', 'contype="1" conaffinity="1"', "can touch"),
        ('<fixed name="ankle_r"', '<fixed name="ankle_r" range="-1 1"', "limits on tendons"),
    ],
)
def test_what_is_missing_or_unsupported_is_said(old, new, sentence):
    assert old in XML
    with pytest.raises(InputError, match=f"(?i){sentence}"):
        load_robot_model(XML.replace(old, new))


def test_joints_may_have_any_names():
    robot = load_robot_model(XML.replace("knee_pitch_", "bend_"))
    assert robot.joint_names[3] == "bend_r" and robot.leg_joints == 5


def test_legs_of_four_joints_are_refused():
    stiff = re.sub('<joint name="hip_yaw_[rl]"[^>]*/>', "", XML)
    stiff = re.sub('<motor name="hip_yaw_[rl]"[^>]*/>', "", stiff)
    with pytest.raises(InputError, match="have 4 and 4 joints; give both five, or six"):
        load_robot_model(stiff)


def test_left_leg_first_is_refused():
    swapped = re.sub('_([rl])"', lambda match: '_l"' if match[1] == "r" else '_r"', XML)
    with pytest.raises(InputError, match="order them hip_yaw_r"):
        load_robot_model(swapped)


def test_a_missing_file_is_said(tmp_path):
    with pytest.raises(InputError, match="cannot load"):
        load_robot_model(tmp_path / "none.xml")


def test_indices_follow_names(robot, bruce):
    legs = ("hip_yaw", "hip_pitch", "hip_roll", "knee_pitch", "ankle_pitch")
    assert robot.joint_names[:10] == tuple(f"{name}_{side}" for side in "rl" for name in legs)
    assert robot.leg_positions == slice(7, 17) and robot.leg_velocities == slice(6, 16)
    assert [bruce.geom(geom).name for geom in robot.contact_geoms] == ["toe_r", "heel_r", "toe_l", "heel_l"]
    assert robot.skeleton.parents == (0, 1, 2, 3, 4, 0, 6, 7, 8, 9, 0, 11, 12, 0, 14, 15)
    assert [bruce.body(body).name for body, _ in robot.contact_bodies] == ["foot_r", "foot_r", "foot_l", "foot_l"]
    assert robot.limbs.starts == (6, 11, 16, 19)
    assert robot.limbs.contacts == (0, 0, 1, 1)
    np.testing.assert_allclose(robot.home, bruce.key_qpos[0], atol=1e-6)


def test_motor_moments_are_mujocos(robot, bruce, rng):
    data = mujoco.MjData(bruce)
    data.qpos[:] = bruce.key_qpos[0]
    torques = rng.uniform(-20, 20, bruce.nu)
    data.ctrl[:] = torques
    mujoco.mj_forward(bruce, data)
    applied = np.clip(torques, *np.asarray(robot.motor_limits).T)
    np.testing.assert_allclose(applied @ np.asarray(robot.motor_moments), data.qfrc_actuator, atol=1e-5)


def test_more_to_stand_on_means_more_contacts():
    xml = bruce_model.mjcf_text(
        worldbody_xml='<geom name="step" type="box" size="0.2 0.2 0.02" pos="1 0 0.02" contype="0" conaffinity="1"/>'
    )
    robot = load_robot_model(xml)
    assert len(robot.contact_bodies) > 4
    assert set(robot.limbs.contacts) == {0, 1}

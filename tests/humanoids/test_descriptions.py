"""What describes a robot: small robots written here, some of them wrong."""

import re

import mujoco
import numpy as np
import pytest

from bruce_model import load_mujoco
from iwalker_jax.control import GaitParameters, WholeBodyParameters
from iwalker_jax.errors import InputError
from iwalker_jax.humanoids import Sole, build_model, load_robot, similar_gait, similar_tasks
from iwalker_jax.robot import contact_point_names, load_robot_model
from tests.docs.pages import ROOT, fenced_blocks

HINGES = {"yaw": "0 0 1", "pitch": "0 1 0", "roll": "1 0 0", "knee": "0 1 0", "ankle": "0 1 0", "tilt": "1 0 0"}


def leg(side: str, y: float) -> str:
    """A leg of six joints, all at the hip but the knee and the two of the ankle."""
    text, places = "", {"yaw": f"0 {y} 0", "knee": "0 0 -0.3", "ankle": "0 0 -0.3"}
    for name, axis in HINGES.items():
        text += f'<body name="{side}_{name}" pos="{places.get(name, "0 0 0")}">'
        text += f'<joint name="{side}_{name}" axis="{axis}" range="-2 2" frictionloss="0.1"/>'
        text += '<inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.005"/>'
    return text + "</body>" * len(HINGES)


SERVOS = "".join(
    f'<position name="{side}{name}" joint="{side}_{name}" kp="10" forcerange="-40 40"/>'
    for side in "LR"
    for name in HINGES
)
MJCF = f"""<mujoco><option integrator="Euler"/><worldbody><geom type="plane" size="1 1 1"/>
<body name="pelvis" pos="0 0 1"><freejoint/><inertial pos="0 0 0" mass="5" diaginertia="0.1 0.1 0.1"/>
<body name="chest" pos="0 0 0.1"><joint name="waist" axis="0 0 1" pos="0.05 0 0" range="-1 1"/>
<inertial pos="0.1 0 0.2" mass="9" diaginertia="0.2 0.2 0.1"/><geom type="box" size=".1 .1 .1"/></body>
{leg("L", 0.1)}{leg("R", -0.1)}</body></worldbody>
<actuator>{SERVOS}</actuator></mujoco>"""

TOML = f"""
name = "two legs"
mjcf = "robot.xml"
[anatomy]
right_leg = {[f"R_{name}" for name in HINGES]}
left_leg = {[f"L_{name}" for name in HINGES]}
right_foot = "R_tilt"
left_foot = "L_tilt"
sole = {{ front = 0.1, back = -0.06, inner = 0.03, outer = 0.05, height = -0.05 }}
[anatomy.standing]
R_pitch = -0.4
R_knee = 0.8
R_ankle = -0.4
L_pitch = -0.4
L_knee = 0.8
L_ankle = -0.4
waist = 0.5
[gait]
width = 0.2
speed = 0.2
"""


@pytest.fixture
def written(tmp_path):
    """Writes a robot, with texts exchanged, and reads it."""

    def write(old: str = "", new: str = "", mjcf: str = MJCF):
        assert old in TOML
        (tmp_path / "robot.xml").write_text(mjcf)
        (tmp_path / "robot.toml").write_text(TOML.replace(old, new) if old else TOML)
        return load_robot(tmp_path / "robot.toml")

    return write


def test_a_model_is_made_that_can_be_loaded(written):
    """The left leg comes first in the file, and position servos drive it."""
    model = build_model(written())
    robot = load_robot_model(model)
    assert robot.joint_names == tuple(f"{side}_{name}" for side in "RL" for name in HINGES)
    assert robot.leg_joints == 6 and robot.foot_points == 4
    np.testing.assert_array_equal(robot.motor_limits, np.tile([-40.0, 40.0], (12, 1)))
    assert not model.dof_frictionloss.any()


def test_a_joint_that_is_fixed_stands_where_it_is_told(written):
    """Oracle: MuJoCo with the joint in place."""
    original, model = mujoco.MjModel.from_xml_string(MJCF), build_model(written())
    data, mine = mujoco.MjData(original), mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, mine, 0)
    data.qpos[:7] = mine.qpos[:7]
    data.qpos[original.joint("waist").qposadr[0]] = 0.5
    mujoco.mj_kinematics(model, mine)
    mujoco.mj_kinematics(original, data)
    np.testing.assert_allclose(mine.body("chest").xpos, data.body("chest").xpos, atol=1e-6)
    np.testing.assert_allclose(mine.body("chest").xmat, data.body("chest").xmat, atol=1e-6)


def test_a_sole_without_width_is_a_line_of_two_points(written):
    model = build_model(written("inner = 0.03, outer = 0.05", "inner = 0, outer = 0"))
    assert contact_point_names(model) == ("toe_r", "heel_r", "toe_l", "heel_l")


def test_the_sole_is_mirrored(written):
    """Outer edges lie outwards: left of the left foot, right of the right."""
    model = build_model(written())
    y = {name: float(model.site(name).pos[1]) for name in ("front_outer_l", "front_outer_r", "midfoot_l", "midfoot_r")}
    assert y == pytest.approx({"front_outer_l": 0.05, "front_outer_r": -0.05, "midfoot_l": 0.01, "midfoot_r": -0.01})


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('mjcf = "robot.xml"', "", "names no MJCF file"),
        ('"robot.xml"', '"none.xml"', "cannot read the model"),
        ("[anatomy]", "[anatomie]", "has no 'anatomie'"),
        ('right_foot = "R_tilt"\n', "", "right_foot"),
        ('right_foot = "R_tilt"', 'right_foot = "R_toes"', "no body 'R_toes'"),
        ("'R_knee'", "'R_bend'", "no hinge 'R_bend'"),
        ("'R_knee'", "'L_knee'", "named twice"),
        ("'R_yaw', ", "", "5 and 6 joints"),
        ("front = 0.1,", "front = -0.1,", "2 cm or more"),
        ("inner = 0.03", "inner = 0.0", "both above 0"),
        ("R_ankle = -0.4", "R_ankle = 0.4", "tilted by up to 45"),
        ("width = 0.2", "width = 0.02", "width in between"),
        ("speed = 0.2", "speed = 9.0", "within reach"),
        ("speed = 0.2", "speeds = 0.2", "no field speeds"),
        ("speed = 0.2", "speed = [", "not TOML"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(written, old, new, sentence):
    with pytest.raises(InputError, match=f"(?i){re.escape(sentence)}"):
        written(old, new)


def test_the_pages_description_describes_a_robot(tmp_path):
    """docs/robots.md as printed, about a robot with the joints that it names."""
    (block,) = (block for block in fenced_blocks(ROOT / "docs/robots.md") if block.language == "toml")
    model = MJCF.replace("<freejoint/>", '<freejoint/><site name="imu"/>')
    for side in "RL":
        model = model.replace(f'<body name="{side}_tilt"', f'<body name="{side.lower()}_foot"')
        for name, printed in zip(HINGES, ("hip_yaw", "hip_pitch", "hip_roll", "knee", "ankle_pitch", "ankle_roll")):
            model = model.replace(f'"{side}_{name}"', f'"{side.lower()}_{printed}"')
    (tmp_path / "my_robot.xml").write_text(model)
    (tmp_path / "robot.toml").write_text(block.text)
    robot = load_robot(tmp_path / "robot.toml")
    assert (robot.gait.width, robot.gait.speed, robot.gait.reach.lateral_min) == (0.2, 0.3, 0.12)
    assert load_robot_model(build_model(robot)).leg_joints == 6


@pytest.mark.parametrize("name", ["", "r2d2", "none.toml"])
def test_unknown_robots_are_refused(name):
    with pytest.raises(InputError):
        load_robot(name)


def test_a_floating_base_is_needed(written):
    with pytest.raises(InputError, match="no floating base"):
        written(mjcf=MJCF.replace("<freejoint/>", ""))


def test_lengths_are_checked():
    with pytest.raises(InputError, match="radius"):
        Sole(0.1, -0.1, 0.0, 0.0, 0.0, radius=1.0)


def test_bruce_is_similar_to_itself():
    """Oracle: the defaults, and the mass of BRUCE's model."""
    assert similar_gait(0.365) == GaitParameters()
    tasks = similar_tasks(0.365, float(load_mujoco().body_subtreemass[1]))
    assert vars(tasks) == pytest.approx(vars(WholeBodyParameters()))


def test_a_taller_robot_steps_in_the_same_proportion():
    """Oracle: the Froude numbers v^2 / g h and the step's length by the height, whatever the height."""
    gaits = [similar_gait(height) for height in (0.365, 0.9)]
    froude = [gait.speed**2 / (9.81 * gait.hlip.com_height) for gait in gaits]
    assert froude[0] == pytest.approx(froude[1])
    steps = [gait.speed * gait.hlip.step_time / gait.hlip.com_height for gait in gaits]
    assert steps[0] == pytest.approx(steps[1])
    growths = [np.exp(float(gait.hlip.rate) * gait.hlip.single_support_time) for gait in gaits]
    assert growths[0] == pytest.approx(growths[1], rel=1e-5)

"""BRUCE's parameter table: masses, inertias, joints, motors, feet, sites and sensors; the one place for its numbers.

Units are SI and radians; x points forward, y left, z up. At zero joint angles every body frame is parallel to the
base. Only the base and the right-hand side are written down: the left-hand side is their mirror image in the plane
y = 0 (`bruce_model.symmetry`). PROVENANCE.md tells where each group of numbers comes from and how it was corrected.

Masses, geometry and inertias: Westwood-Robotics/BRUCE_simulation_models, Gazebo/urdf/bruce.csv, Apache-2.0.
"""

from dataclasses import dataclass
from typing import NamedTuple

Vector3 = tuple[float, float, float]


class Inertia(NamedTuple):
    """Rotational inertia about the COM in axes parallel to the body frame [kg m^2]; a tensor, so ixy = -sum m x y."""

    ixx: float
    iyy: float
    izz: float
    ixy: float
    ixz: float
    iyz: float


@dataclass(frozen=True)
class Hinge:
    """A hinge joint between a link and its parent.

    Attributes:
        name: joint name without its side.
        axis: rotation axis in the link's frame.
        low: lower limit [rad].
        high: upper limit [rad].
        armature: reflected inertia added to this joint's diagonal of the mass matrix [kg m^2].
        mirror_sign: +1 or -1; the left joint at `mirror_sign * q` is the mirror image of the right joint at q.
    """

    name: str
    axis: Vector3
    low: float
    high: float
    armature: float
    mirror_sign: int


@dataclass(frozen=True)
class Link:
    """A rigid body and the joint that carries it.

    Attributes:
        name: body name, with its side.
        parent: the parent body's name, or None for the floating base.
        position: joint origin in the parent's frame [m].
        mass: [kg].
        com: centre of mass in the link's frame [m].
        inertia: about the COM.
        hinge: the joint to the parent, or None for the floating base.
    """

    name: str
    parent: str | None
    position: Vector3
    mass: float
    com: Vector3
    inertia: Inertia
    hinge: Hinge | None


@dataclass(frozen=True)
class Motor:
    """A torque motor on a joint, or on a linear combination of joint angles (a fixed tendon).

    Attributes:
        name: without its side.
        angle: the motor's angle as (joint, coefficient) pairs; one pair with coefficient 1 is a direct drive.
        torque_limit: largest torque [N m].
        tendon_armature: reflected inertia along a combined angle [kg m^2].
    """

    name: str
    angle: tuple[tuple[str, float], ...]
    torque_limit: float
    tendon_armature: float = 0.0


@dataclass(frozen=True)
class Site:
    """A named point of a link: its position in the link's frame [m]."""

    name: str
    link: str
    position: Vector3


@dataclass(frozen=True)
class Foot:
    """The line foot: two contact spheres below the ankle, in the foot's frame.

    Attributes:
        toe: toe contact ahead of the ankle [m].
        heel: heel contact ahead of the ankle, negative [m].
        sole_drop: ankle to sole [m].
        sphere_radius: radius of the contact spheres, whose lowest points lie on the sole [m].
    """

    toe: float = 0.050
    heel: float = -0.035
    sole_drop: float = 0.024
    sphere_radius: float = 0.006


@dataclass(frozen=True)
class DepthCamera:
    """The depth camera on the torso's front (ASSUMED: the robot's public models carry none).

    Attributes:
        position: in the base frame [m].
        pitch_down: angle of the optical axis below the horizon when the torso is upright [rad].
        width: [px].
        height: [px].
        focal: focal length [px]; 80 px at 160 px width is a 90 degree horizontal view.
    """

    position: Vector3 = (0.075, 0.0, 0.165)
    pitch_down: float = 0.3
    width: int = 160
    height: int = 90
    focal: float = 80.0


# One leg actuator (BEAR): peak torque [N m] and the rotor's inertia seen at the output [kg m^2].
BEAR_TORQUE = 10.5
BEAR_ARMATURE = 0.00182
# One arm actuator (Dynamixel X class; ASSUMED).
ARM_TORQUE = 1.0
ARM_ARMATURE = 0.002

BASE = Link(
    "base", None, (0.0, 0.0, 0.0), 1.3168892, (0.022596, 0.0, 0.0614005),
    Inertia(0.008389576, 0.004599224, 0.004798604, 0.0, -1.851594e-07, 0.0), None,
)  # fmt: skip

# The hip turns in the order yaw, pitch, roll. Both hip-differential motors drive pitch and roll, so each of these
# joints carries two rotors; the ankle motor's rotor sits on the combined angle knee + ankle (see LEG_MOTORS).
RIGHT_LEG = (
    Link(
        "hip_yaw_r", "base", (0.029216, -0.0758557, -0.039765), 0.6374744, (-0.0002284, -1.4e-06, 0.0052523),
        Inertia(0.001599909, 0.0004676853, 0.001521137, 5.602145e-07, 6.495734e-06, 9.454868e-07),
        Hinge("hip_yaw", (0, 0, 1), -1.570796, 1.570796, BEAR_ARMATURE, -1),
    ),
    Link(
        "hip_pitch_r", "hip_yaw_r", (0.0, 0.0, 0.0), 0.0129553, (6.9e-06, 0.0, 0.0),
        Inertia(9.1e-07, 4.699994e-07, 9.099994e-07, 0.0, 0.0, 0.0),
        Hinge("hip_pitch", (0, -1, 0), -0.4, 2.5, 2 * BEAR_ARMATURE, 1),
    ),
    Link(
        "thigh_r", "hip_pitch_r", (0.0, 0.0, 0.0), 0.6635186, (-0.00649, 0.0003727, -0.139),
        Inertia(0.002880065, 0.003152209, 0.0004139604, -2.714891e-06, 0.0003075668, 3.852714e-05),
        Hinge("hip_roll", (1, 0, 0), -0.785398, 0.785398, 2 * BEAR_ARMATURE, -1),
    ),
    Link(
        "shank_r", "thigh_r", (0.0, 0.0, -0.2049494), 0.0954654, (0.0176374, -0.002181, -0.0730152),
        Inertia(0.0005088308, 0.0005425412, 7.865222e-05, -1.004741e-05, -7.023845e-05, -1.347682e-06),
        Hinge("knee_pitch", (0, -1, 0), -2.5, 0.0, BEAR_ARMATURE, 1),
    ),
    Link(
        "foot_r", "shank_r", (0.0, 0.0, -0.1998806), 0.0275547, (0.0022523, -0.0002998, -0.0122087),
        Inertia(2.125215e-06, 2.170087e-05, 2.02557e-05, -2.586326e-07, 2.131567e-06, 1.308509e-07),
        Hinge("ankle_pitch", (0, -1, 0), -1.5, 1.5, 0.0, 1),
    ),
)  # fmt: skip

# At zero angles the arms point straight out to the sides.
RIGHT_ARM = (
    Link(
        "shoulder_pitch_r", "base", (0.029216, -0.12375, 0.152985), 0.0493169, (0.0, 0.0141368, 0.0),
        Inertia(1.414404e-05, 8.312757e-06, 1.52368e-05, 0.0, 0.0, 0.0),
        Hinge("shoulder_pitch", (0, -1, 0), -3.141593, 3.141593, ARM_ARMATURE, -1),
    ),
    Link(
        "upper_arm_r", "shoulder_pitch_r", (0.0, 0.0, 0.0), 0.0276826, (0.0009395, -0.0570939, 0.0041946),
        Inertia(5.482561e-05, 8.413479e-06, 5.456324e-05, 1.53473e-06, -2.087865e-08, 1.330353e-06),
        Hinge("shoulder_roll", (1, 0, 0), -1.570796, 1.9, ARM_ARMATURE, -1),
    ),
    Link(
        "forearm_r", "upper_arm_r", (0.005, -0.1146, 0.005), 0.0524404, (0.0, -0.0217884, 0.0003604),
        Inertia(4.769787e-05, 7.523189e-06, 4.610469e-05, 0.0, 0.0, -2.317906e-07),
        Hinge("elbow_pitch", (0, 0, 1), -2.3, 2.3, ARM_ARMATURE, -1),
    ),
)  # fmt: skip

# The same combinations on both legs, so that a motor torque means the same thing left and right: the real motors'
# signs differ from side to side, which only relabels the motors and changes no reachable torque.
LEG_MOTORS = (
    Motor("hip_yaw", (("hip_yaw", 1.0),), BEAR_TORQUE),
    Motor("hip_a", (("hip_pitch", 1.0), ("hip_roll", -1.0)), BEAR_TORQUE),
    Motor("hip_b", (("hip_pitch", -1.0), ("hip_roll", -1.0)), BEAR_TORQUE),
    Motor("knee", (("knee_pitch", 1.0),), BEAR_TORQUE),
    Motor("ankle", (("knee_pitch", 1.0), ("ankle_pitch", 1.0)), BEAR_TORQUE, BEAR_ARMATURE),
)
ARM_MOTORS = tuple(
    Motor(name, ((name, 1.0),), ARM_TORQUE) for name in ("shoulder_pitch", "shoulder_roll", "elbow_pitch")
)

FOOT = Foot()
DEPTH_CAMERA = DepthCamera()

BASE_SITES = (
    Site("imu", "base", (0.0, 0.0, 0.0)),
    Site("camera", "base", DEPTH_CAMERA.position),
)
RIGHT_SITES = (
    Site("hand_r", "forearm_r", (0.0, -0.13, 0.0)),
    Site("sole_r", "foot_r", (0.0, 0.0, -FOOT.sole_drop)),
    Site("toe_r", "foot_r", (FOOT.toe, 0.0, -FOOT.sole_drop)),
    Site("heel_r", "foot_r", (FOOT.heel, 0.0, -FOOT.sole_drop)),
    Site("midfoot_r", "foot_r", ((FOOT.toe + FOOT.heel) / 2, 0.0, -FOOT.sole_drop)),
)

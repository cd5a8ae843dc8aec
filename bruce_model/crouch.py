"""The nominal crouch: knees bent, soles flat on the floor, hands in front of the chest."""

from math import cos

import numpy as np

from bruce_model.parameters import FOOT, RIGHT_ARM, RIGHT_LEG
from bruce_model.symmetry import joint_names

HIP_PITCH = 0.503
KNEE_PITCH = -1.017
ANKLE_PITCH = -(HIP_PITCH + KNEE_PITCH)  # keeps the sole parallel to the floor
ARM = (-0.7, 1.3, 2.0)  # right arm: shoulder pitch, shoulder roll, elbow pitch [rad]

_RIGHT_ANGLES = {
    "hip_pitch": HIP_PITCH,
    "knee_pitch": KNEE_PITCH,
    "ankle_pitch": ANKLE_PITCH,
    **{link.hinge.name: angle for link, angle in zip(RIGHT_ARM, ARM) if link.hinge is not None},
}
_MIRROR_SIGNS = {link.hinge.name: link.hinge.mirror_sign for link in (*RIGHT_LEG, *RIGHT_ARM) if link.hinge is not None}


def crouch_joints() -> np.ndarray:
    """Joint angles of the nominal crouch: (16,) [rad] in joint order."""
    angles = []
    for name in joint_names():
        joint, _, side = name.rpartition("_")
        angles.append((_MIRROR_SIGNS[joint] if side == "l" else 1) * _RIGHT_ANGLES.get(joint, 0.0))
    return np.array(angles)


def crouch_base_height() -> float:
    """Height of the base origin above the floor when the crouching feet just touch it [m]."""
    hip, _, _, knee, ankle = (link.position[2] for link in RIGHT_LEG)
    return FOOT.sole_drop - hip - knee * cos(HIP_PITCH) - ankle * cos(HIP_PITCH + KNEE_PITCH)


def crouch_qpos() -> np.ndarray:
    """The crouch as MuJoCo's configuration: (23,) base xyz [m], quaternion wxyz, joint angles [rad]; x = y = 0."""
    return np.concatenate([[0.0, 0.0, crouch_base_height(), 1.0, 0.0, 0.0, 0.0], crouch_joints()])

"""Rigid-body kinematics and dynamics of the parameter table in plain NumPy: the oracle for C MuJoCo."""

from typing import NamedTuple

import numpy as np

from bruce_model.symmetry import all_links, joint_names

GRAVITY = 9.81
LEGS = {"r": slice(6, 11), "l": slice(11, 16)}  # degrees of freedom
# State entries that the mirror image negates: base y; quaternion x and z.
_MIRRORED_BASE_QPOS = np.array([1, -1, 1, 1, -1, 1, -1])
_MIRRORED_BASE_QVEL = np.array([1, -1, 1, -1, 1, -1])


class LinkState(NamedTuple):
    """A link's rotation (3, 3), origin (3,), COM (3,) in the world; Jacobians (3, 22) of its COM and rotation."""

    rotation: np.ndarray
    origin: np.ndarray
    com: np.ndarray
    com_jacobian: np.ndarray
    rotation_jacobian: np.ndarray


def axis_rotation(axis, angle: float) -> np.ndarray:
    """Rodrigues' formula: (3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def quaternion_rotation(q: np.ndarray) -> np.ndarray:
    """Rotation of a unit quaternion wxyz: (3, 3)."""
    w, v = q[0], q[1:]
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def inertia_matrix(inertia) -> np.ndarray:
    """The symmetric tensor (3, 3) of [ixx, iyy, izz, ixy, ixz, iyz]."""
    ixx, iyy, izz, ixy, ixz, iyz = inertia
    return np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])


def link_states(qpos: np.ndarray) -> dict[str, LinkState]:
    """Every link's pose and Jacobians for MuJoCo's velocity convention (base linear: world; base angular: body)."""
    states: dict[str, LinkState] = {}
    motions: dict[str, list[tuple[int, np.ndarray, np.ndarray]]] = {}  # (dof, axis, point) of the joints above a link
    for i, link in enumerate(all_links()):
        if link.hinge is None:
            rotation, origin = quaternion_rotation(qpos[3:7]), qpos[:3]
            motions[link.name] = [(3 + k, rotation[:, k], origin) for k in range(3)]
        else:
            parent = states[link.parent]
            origin = parent.origin + parent.rotation @ np.array(link.position)
            rotation = parent.rotation @ axis_rotation(link.hinge.axis, qpos[6 + i])
            axis = rotation @ np.array(link.hinge.axis, dtype=float)
            motions[link.name] = [*motions[link.parent], (5 + i, axis, origin)]
        com = origin + rotation @ np.array(link.com)
        com_jacobian, rotation_jacobian = np.zeros((3, 22)), np.zeros((3, 22))
        com_jacobian[:, :3] = np.eye(3)
        for dof, axis, point in motions[link.name]:
            com_jacobian[:, dof] = np.cross(axis, com - point)
            rotation_jacobian[:, dof] = axis
        states[link.name] = LinkState(rotation, origin, com, com_jacobian, rotation_jacobian)
    return states


def link_mass_matrix(qpos: np.ndarray) -> np.ndarray:
    """Mass matrix of the links alone, without rotors: (22, 22)."""
    states = link_states(qpos)
    total = np.zeros((22, 22))
    for link in all_links():
        state = states[link.name]
        inertia = state.rotation @ inertia_matrix(link.inertia) @ state.rotation.T
        total += link.mass * state.com_jacobian.T @ state.com_jacobian
        total += state.rotation_jacobian.T @ inertia @ state.rotation_jacobian
    return total


def rotor_matrix() -> np.ndarray:
    """Sum of I a a' over all motors, a being the motor angle's gradient: (22, 22)."""
    leg = np.array(
        [
            [1.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, -1.0, 0.0, 0.0],
            [0.0, -1.0, -1.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0, 1.0],
        ]
    )
    total = np.zeros((22, 22))
    for dofs in LEGS.values():
        total[dofs, dofs] = 0.00182 * leg.T @ leg
    total[16:, 16:] = 0.002 * np.eye(6)
    return total


def potential_energy(qpos: np.ndarray) -> float:
    """Gravity's potential energy [J]."""
    states = link_states(qpos)
    return sum(GRAVITY * link.mass * states[link.name].com[2] for link in all_links())


def mirror_signs() -> np.ndarray:
    """For each left or right joint, the sign of its mirror image's angle: (16,)."""
    signs = {link.hinge.name: link.hinge.mirror_sign for link in all_links() if link.hinge is not None}
    return np.array([signs[name.rpartition("_")[0]] for name in joint_names()])


def _swap_sides(joints: np.ndarray) -> np.ndarray:
    """Exchange right and left legs and arms along the first axis of (16, ...)."""
    return np.concatenate([joints[5:10], joints[:5], joints[13:16], joints[10:13]])


def mirrored_qpos(qpos: np.ndarray) -> np.ndarray:
    """The mirror image in the world's plane y = 0 of a configuration: (23,)."""
    return np.concatenate([qpos[:7] * _MIRRORED_BASE_QPOS, _swap_sides(qpos[7:] * mirror_signs())])


def velocity_mirror() -> np.ndarray:
    """Matrix (22, 22) that turns a velocity or generalised force into its mirror image."""
    matrix = np.zeros((22, 22))
    matrix[:6, :6] = np.diag(_MIRRORED_BASE_QVEL)
    matrix[6:, 6:] = _swap_sides(np.diag(mirror_signs()))
    return matrix


def random_qpos(rng: np.random.Generator) -> np.ndarray:
    """A configuration with a random base pose and joints within their limits: (23,)."""
    quaternion = rng.normal(size=4)
    joints = [rng.uniform(link.hinge.low, link.hinge.high) for link in all_links() if link.hinge is not None]
    return np.concatenate([rng.normal(size=3), quaternion / np.linalg.norm(quaternion), joints])

"""The geometry of this room in NumPy, in the precision of its arguments: for what is prepared and judged on the host.

Poses are (x [m], y [m], yaw [rad]); functions of the same name in `planar`, `rotations` and `splines` are their JAX
versions.
"""

from typing import TypeVar

import numpy as np
from jaxtyping import Float

Angle = TypeVar("Angle", float, Float[np.ndarray, "..."])


def turn(angle: Float[np.ndarray, "*#n"] | float, vectors: Float[np.ndarray, "*#n 2"]) -> Float[np.ndarray, "*n 2"]:
    """Rotate planar vectors by an angle [rad], or each by its own."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def to_base(pose: Float[np.ndarray, "*#n 3"], points: Float[np.ndarray, "*#n 2"]) -> Float[np.ndarray, "*n 2"]:
    """World points [m] in the frame of a pose, or each in that of its own."""
    return turn(-pose[..., 2], points - pose[..., :2])


def to_world(pose: Float[np.ndarray, "*#n 3"], points: Float[np.ndarray, "*#n 2"]) -> Float[np.ndarray, "*n 2"]:
    """Points [m] of a pose's frame in the world."""
    return turn(pose[..., 2], points) + pose[..., :2]


def planar_rotation(yaw: float) -> Float[np.ndarray, "2 2"]:
    """R_world_base of a heading [rad] in the plane."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, -sin], [sin, cos]])


def rotation_about_vertical(yaw: float) -> Float[np.ndarray, "3 3"]:
    """R_world_base of a heading [rad] in space."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def leftward(yaw: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2"]:
    """Unit vectors to the left of headings [rad]."""
    return np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)


def wrap_angle(angle: Angle) -> Angle:
    """The same angle in (-pi, pi] [rad]."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def rotation_matrix(quaternion: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    """R_world_body of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def arc_length(path: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """Cumulative length [m] along a polyline, starting at zero."""
    return np.concatenate([[0.0], np.cumsum(_edge_lengths(path))])


def polyline_length(path: Float[np.ndarray, "n d"]) -> float:
    """Length [m] of a polyline."""
    return float(_edge_lengths(path).sum())


def points_along(
    path: Float[np.ndarray, "n d"], distances: Float[np.ndarray, "*m"] | float
) -> Float[np.ndarray, "*m d"]:
    """Points at distances [m] along a polyline, linear between its points; its ends beyond them."""
    lengths = arc_length(path)
    return np.stack([np.interp(distances, lengths, path[:, axis]) for axis in range(path.shape[1])], axis=-1)


def _edge_lengths(path: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n-1"]:
    return np.linalg.norm(np.diff(path, axis=0), axis=1)

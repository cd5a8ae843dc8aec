"""Layout `iplanner`: depth/<n>.png, odom_ground_truth.txt, depth_intrinsic.txt and camera_extrinsic.txt."""

import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from iwalker_jax.data.recordings.folder_files import depth_images, read_numbers
from iwalker_jax.data.recordings.metadata import (
    RecordingMetadata,
    facing_camera,
    paired_rows,
    rotation_from_quaternion,
    turn_if_upside_down,
)
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics
from iwalker_jax.perception.depth_png import png_size

ODOMETRY = "odom_ground_truth.txt"
INTRINSICS = "depth_intrinsic.txt"
EXTRINSICS = "camera_extrinsic.txt"
_MAX_OFFSET = 5.0  # [m] of a camera from its body


def read_iplanner_layout(folder: Path, intrinsics: Intrinsics | None, depth_scale: float | None) -> RecordingMetadata:
    """Metadata of a folder in iPlanner's layout.

    odom_ground_truth.txt has a line [x, y, z, qx, qy, qz, qw] an image: the robot's body in a world with z up.
    depth_intrinsic.txt is a row-major 3 x 4 or 4 x 4 projection matrix. camera_extrinsic.txt is the optical frame in
    the body, as [x, y, z, qx, qy, qz, qw] (collected data) or [qx, qy, qz, qw, x, y, z] (converted data); the unit
    quaternion tells which. Images are in millimetres; those of a camera mounted upside down are turned.

    Args:
        folder: of the recording.
        intrinsics, depth_scale: given by the caller; they win over the files.

    Raises:
        InputError: if a file is missing or malformed.
    """
    images, assumptions = depth_images(folder / "depth")
    if not images:
        raise InputError("The subfolder depth holds no PNG images.")
    rows = read_numbers(folder, ODOMETRY, (7,), "poses x, y, z, qx, qy, qz, qw")
    if not rows:
        raise InputError(f"{ODOMETRY} has no poses; write x, y, z, qx, qy, qz, qw of each image.")
    if depth_scale is None:
        depth_scale = 0.001
        assumptions.append("iPlanner's layout names no depth scale: one unit is taken as 1 mm.")
    if intrinsics is None:
        intrinsics = _intrinsics(folder, images)
    metadata = RecordingMetadata("iplanner", folder, images, intrinsics, depth_scale, assumptions=assumptions)
    odometry = paired_rows(metadata, {"poses": (ODOMETRY, np.array(rows))})["poses"]
    p_body_camera, R_body_camera = _extrinsics(folder)
    poses, mounts = np.full((len(odometry), 3), np.nan), np.full((len(odometry), 5), np.nan)
    for row, values in enumerate(odometry):
        R_world_body = rotation_from_quaternion(values[3:])
        poses[row], mounts[row] = facing_camera(R_world_body, values[:3], R_body_camera, p_body_camera)
    mounts = turn_if_upside_down(metadata, mounts, "By its extrinsics")
    pitches = mounts[np.isfinite(mounts[:, 1]), 1]
    if pitches.size and abs(np.median(pitches)) > math.radians(70.0):
        raise InputError(
            f"{EXTRINSICS} makes the camera look {math.degrees(np.median(pitches)):.0f} degrees down; it must be the "
            "pose of the optical frame (z forward), not of the camera's housing."
        )
    metadata.assumptions.append("The base is taken to face along the camera's optical axis.")
    metadata.poses, metadata.mounts = poses, mounts
    return metadata


def _intrinsics(folder: Path, images: list[Path]) -> Intrinsics:
    matrix = np.array(_single_row(folder, INTRINSICS, (12, 16), "3 x 4 projection matrix")).reshape(-1, 4)
    if not np.array_equal(matrix[2:], np.eye(4)[2 : len(matrix)]) or not np.isfinite(matrix).all():
        raise InputError(
            f"{INTRINSICS} is not a row-major projection matrix: fx 0 cx 0, 0 fy cy 0, 0 0 1 0 in one line."
        )
    for path in images:
        try:
            width, height = png_size(path)
        except InputError:
            continue
        return Intrinsics(width, height, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    raise InputError("No file in the subfolder depth is a PNG image.")


def _single_row(folder: Path, name: str, columns: tuple[int, ...], what: str) -> list[float]:
    rows = read_numbers(folder, name, columns, what)
    if len(rows) != 1:
        raise InputError(f"{name} has {len(rows)} rows of numbers; write one, the {what}.")
    return rows[0]


def _extrinsics(folder: Path) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]]:
    """(position [m], rotation) of the optical frame in the body."""
    values = np.array(_single_row(folder, EXTRINSICS, (7,), "camera pose in the body"))
    orders = ((values[3:], values[:3]), (values[:4], values[4:]))
    found = [(quaternion, p) for quaternion, p in orders if abs(np.linalg.norm(quaternion) - 1.0) < 0.01]
    if not found:
        raise InputError(f"{EXTRINSICS} holds no unit quaternion; it must be [x, y, z, qx, qy, qz, qw].")
    if len(found) > 1:
        raise InputError(f"{EXTRINSICS} can be read in two orders; move the position a little and write it first.")
    (quaternion, p_body_camera) = found[0]
    if not np.abs(p_body_camera).max() < _MAX_OFFSET:
        raise InputError(f"{EXTRINSICS} puts the camera {np.abs(p_body_camera).max():g} m from the body; give metres.")
    return p_body_camera, rotation_from_quaternion(quaternion)

"""Layout `iplanner`: depth/<n>.png, odom_ground_truth.txt, depth_intrinsic.txt and camera_extrinsic.txt."""

import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from iwalker_jax.data.recordings.metadata import (
    RecordingMetadata,
    camera_heading,
    camera_tilt,
    read_numbers,
    rotation_from_quaternion,
    sorted_images,
)
from iwalker_jax.data.recordings.report import FileProblem
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics
from iwalker_jax.perception.depth_png import png_size

ODOMETRY = "odom_ground_truth.txt"
INTRINSICS = "depth_intrinsic.txt"
EXTRINSICS = "camera_extrinsic.txt"


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
    present = sorted_images(folder / "depth")
    if not present:
        raise InputError("The subfolder depth holds no PNG images.")
    rows = read_numbers(folder / ODOMETRY, (7,), "x, y, z, qx, qy, qz, qw")
    images, odometry = _paired(folder, present, np.array(rows).reshape(-1, 7))
    assumptions = []
    if depth_scale is None:
        depth_scale = 0.001
        assumptions.append("iPlanner's layout names no depth scale: one unit is taken as 1 mm.")
    if intrinsics is None:
        intrinsics = _intrinsics(folder, present)
    metadata = RecordingMetadata("iplanner", folder, images, intrinsics, depth_scale, assumptions=assumptions)
    if len(present) != len(rows):
        metadata.problems.append(
            FileProblem(ODOMETRY, f"has {len(rows)} poses for {len(present)} images; they are paired by number.")
        )
    p_body_camera, R_body_camera = _extrinsics(folder)
    poses, mounts = np.full((len(images), 3), np.nan), np.full((len(images), 5), np.nan)
    for row, values in enumerate(odometry):
        R_world_body = rotation_from_quaternion(values[3:])
        R_world_camera = R_world_body @ R_body_camera
        yaw = camera_heading(R_world_camera)
        pitch, roll = camera_tilt(R_world_camera)
        offset = R_world_body @ p_body_camera
        forward = math.cos(yaw) * offset[0] + math.sin(yaw) * offset[1]
        left = math.cos(yaw) * offset[1] - math.sin(yaw) * offset[0]
        poses[row] = [values[0], values[1], yaw]
        mounts[row] = [math.nan, pitch, roll, forward, left]
    rolls = mounts[np.isfinite(mounts[:, 2]), 2]
    if rolls.size and np.median(np.abs(rolls)) > math.pi / 2:
        metadata.upside_down = True
        mounts[:, 2] -= math.pi * np.sign(mounts[:, 2])
        assumptions.append("By its extrinsics the camera was mounted upside down: images are turned by 180 degrees.")
    pitches = mounts[np.isfinite(mounts[:, 1]), 1]
    if pitches.size and abs(np.median(pitches)) > math.radians(70.0):
        raise InputError(
            f"{EXTRINSICS} makes the camera look {math.degrees(np.median(pitches)):.0f} degrees down; it must be the "
            "pose of the optical frame (z forward), not of the camera's housing."
        )
    assumptions.append("The base is taken to face along the camera's optical axis.")
    metadata.poses, metadata.mounts = poses, mounts
    return metadata


def _intrinsics(folder: Path, images: list[Path]) -> Intrinsics:
    rows = read_numbers(folder / INTRINSICS, (12, 16), "3 x 4 projection matrix")
    if not rows:
        raise InputError(f"{INTRINSICS} is empty.")
    matrix = np.array(rows[0]).reshape(-1, 4)
    for path in images:
        try:
            width, height = png_size(path)
        except InputError:
            continue
        return Intrinsics(width, height, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    raise InputError("No file in the subfolder depth is a PNG image.")


def _paired(
    folder: Path, present: list[Path], rows: Float[np.ndarray, "m 7"]
) -> tuple[list[Path], Float[np.ndarray, "n 7"]]:
    """(images, odometry rows), one to one.

    Equal counts are paired in order. Otherwise image n belongs to row n: a row without an image names the missing file,
    and an image without a row gets NaN.
    """
    if len(present) == len(rows):
        return present, rows
    try:
        by_number = {int(path.stem): path for path in present}
    except ValueError:
        raise InputError(
            f"{ODOMETRY} has {len(rows)} poses for {len(present)} images whose names are not numbers, so they cannot "
            "be paired; name the images 0.png, 1.png, ..."
        ) from None
    numbers = sorted(set(range(len(rows))) | set(by_number))
    poses = [rows[n] if n < len(rows) else np.full(7, np.nan) for n in numbers]
    return [by_number.get(n, folder / "depth" / f"{n}.png") for n in numbers], np.array(poses)


def _extrinsics(folder: Path) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]]:
    """(position [m], rotation) of the optical frame in the body."""
    rows = read_numbers(folder / EXTRINSICS, (7,), "camera pose in the body")
    if not rows:
        raise InputError(f"{EXTRINSICS} is empty.")
    values = np.array(rows[0])
    for quaternion, position in ((values[3:], values[:3]), (values[:4], values[4:])):
        if abs(np.linalg.norm(quaternion) - 1.0) < 0.01:
            return position, rotation_from_quaternion(quaternion)
    raise InputError(f"{EXTRINSICS} holds no unit quaternion; it must be [x, y, z, qx, qy, qz, qw].")

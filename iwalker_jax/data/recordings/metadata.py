"""The common form of a recording's metadata, whatever its layout, and the geometry that brings poses into it."""

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from iwalker_jax.data.recordings.report import FileProblem
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import host
from iwalker_jax.perception import Intrinsics


@dataclass
class RecordingMetadata:
    """What a layout says about a recording, before any image is decoded. Arrays have one row an image.

    Attributes:
        layout: name of the layout.
        folder: of the recording.
        images: depth images in order.
        intrinsics: of the images as stored.
        depth_scale: [m] per unit.
        poses: [x m, y m, yaw rad] of the base in the world, NaN where unknown; None without poses.
        mounts: camera mounts as in `CameraMount`; a NaN height is fitted to the floor; None fits everything.
        goals: [x, y] [m] in each frame's base frame; None without goals.
        upside_down: whether the camera was mounted upside down, so that images must be turned by 180 degrees.
        problems, assumptions: found while reading the metadata.
    """

    layout: str
    folder: Path
    images: list[Path]
    intrinsics: Intrinsics
    depth_scale: float
    poses: Float[np.ndarray, "n 3"] | None = None
    mounts: Float[np.ndarray, "n 5"] | None = None
    goals: Float[np.ndarray, "n 2"] | None = None
    upside_down: bool = False
    problems: list[FileProblem] = field(default_factory=list)
    assumptions: list[str] = field(default_factory=list)


def sorted_images(folder: Path) -> list[Path]:
    """PNG files in recording order: by number where the names are numbers (or time stamps), else by name."""
    paths = list(folder.glob("*.png"))
    try:
        return sorted(paths, key=lambda path: float(path.stem))
    except ValueError:
        return sorted(paths)


def check_intrinsics(intrinsics: Intrinsics) -> None:
    """Refuse intrinsics that no depth camera has.

    Raises:
        InputError: for a field of view outside 10-170 degrees, very unequal focal lengths, or a principal point that
            lies outside the image.
    """
    K = intrinsics
    views = [math.degrees(2.0 * math.atan(0.5 * size / f)) for size, f in ((K.width, K.fx), (K.height, K.fy))]
    if not all(10.0 < view < 170.0 for view in views):
        raise InputError(
            f"The intrinsics give a field of view of {views[0]:.0f} x {views[1]:.0f} degrees; check that fx and fy are "
            "in pixels of this resolution."
        )
    if not 0.5 < K.fx / K.fy < 2.0:
        raise InputError(f"The focal lengths fx={K.fx} and fy={K.fy} differ too much; check their order.")
    if not (0.0 <= K.cx < K.width and 0.0 <= K.cy < K.height):
        raise InputError(
            f"The principal point ({K.cx}, {K.cy}) lies outside the {K.width} x {K.height} image; check that the "
            "intrinsics belong to this resolution."
        )


def rotation_from_quaternion(quaternion: Float[np.ndarray, " 4"]) -> Float[np.ndarray, "3 3"]:
    """Rotation matrix of (x, y, z, w), normalised; NaN for a quaternion that is zero or not finite."""
    norm = np.linalg.norm(quaternion)
    if not norm > 1e-6:
        return np.full((3, 3), np.nan)
    return host.rotation_matrix(np.roll(quaternion, 1) / norm)


def camera_heading(R_world_camera: Float[np.ndarray, "3 3"]) -> float:
    """[rad] yaw of the optical axis in a world with z up."""
    return math.atan2(R_world_camera[1, 2], R_world_camera[0, 2])


def camera_tilt(R_world_camera: Float[np.ndarray, "3 3"]) -> tuple[float, float]:
    """(pitch, roll) [rad] of an optical frame (x right, y down, z forward) in a world with z up (`camera_pose`)."""
    up = R_world_camera[2]
    return math.asin(float(np.clip(-up[2], -1.0, 1.0))), math.atan2(-up[0], -up[1])


def read_numbers(path: Path, columns: tuple[int, ...], what: str) -> list[list[float]]:
    """Rows of numbers of a text file; commas, brackets and comment lines (#) are ignored.

    Args:
        path: of the text file.
        columns: allowed numbers a row.
        what: the content, for the error's sentence.

    Raises:
        InputError: if the file is missing, or a row is not made of that many numbers.
    """
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError):
        raise InputError(f"{path.name} with the {what} is missing or not a text file.") from None
    rows = []
    for number, line in enumerate(lines, start=1):
        text = line.split("#")[0].translate(str.maketrans("[](),;", "      ")).split()
        if not text:
            continue
        try:
            row = [float(word) for word in text]
        except ValueError:
            raise InputError(f"{path.name}, line {number}: {line[:60]!r} is not made of numbers.") from None
        if len(row) not in columns:
            allowed = " or ".join(str(c) for c in columns)
            raise InputError(f"{path.name}, line {number}: {len(row)} numbers instead of {allowed} ({what}).")
        rows.append(row)
    return rows

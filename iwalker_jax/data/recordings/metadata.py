"""The common form of a recording's metadata, whatever its layout, and the geometry that brings poses into it."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from jaxtyping import Float, Int

from iwalker_jax.data.recordings.report import FileProblem, RecordedTopic
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import host
from iwalker_jax.perception import Intrinsics
from iwalker_jax.perception.depth_png import MAX_PIXELS
from iwalker_jax.runtime import printable

MAX_TIME_GAP = 0.05
"""[s] between a depth image and the nearest recorded pose."""

_QUATERNION_TOLERANCE = 0.03  # of the norm: numbers written with two digits
_MAX_CENTRE_OFFSET = 0.15  # of the image size; real cameras have 0.03, intrinsics of half the resolution 0.25


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
        tilts: [pitch, roll] [rad] of the camera in the world by the recorded poses, NaN where unknown, only to compare
            with; None where poses do not say it.
        upside_down: whether the camera was mounted upside down, so that images must be turned by 180 degrees.
        problems, assumptions: found while reading the metadata.
        topics: of a bag, with their uses.
        scratch: folder of images that were unpacked, kept as long as this is.
    """

    layout: str
    folder: Path
    images: list[Path]
    intrinsics: Intrinsics
    depth_scale: float
    poses: Float[np.ndarray, "n 3"] | None = None
    mounts: Float[np.ndarray, "n 5"] | None = None
    goals: Float[np.ndarray, "n 2"] | None = None
    tilts: Float[np.ndarray, "n 2"] | None = None
    upside_down: bool = False
    problems: list[FileProblem] = field(default_factory=list)
    assumptions: list[str] = field(default_factory=list)
    topics: list[RecordedTopic] = field(default_factory=list)
    scratch: TemporaryDirectory[str] | None = None


def paired_rows(
    metadata: RecordingMetadata, tables: dict[str, tuple[str, Float[np.ndarray, "_ _"]]]
) -> dict[str, Float[np.ndarray, "_ _"]]:
    """Tables with one row an image.

    Equal counts are paired in order. Otherwise image n belongs to row n: a row without an image adds the missing file
    to the images, so that it is named, and an image without a row gets NaN.

    Args:
        metadata: whose images they belong to; what does not match is added to its problems.
        tables: name -> (file, rows).

    Raises:
        InputError: if counts differ and the images' names do not say which rows are theirs.
    """
    images = metadata.images
    uneven = {key: (file, rows) for key, (file, rows) in tables.items() if len(rows) != len(images)}
    if not images or not uneven:
        return {key: rows for key, (_, rows) in tables.items()}
    longest = max(len(rows) for _, rows in tables.values())
    mismatches = {file: f"has {len(rows)} {key} for {len(images)} images" for key, (file, rows) in uneven.items()}
    numbered = _numbered(images)
    if numbered is None or longest > 2 * len(images) + 10:
        file, mismatch = next(iter(mismatches.items()))
        raise InputError(
            f"{printable(file)} {mismatch}, so they cannot be paired; write one row an image, or name the images "
            "0.png, 1.png, ..."
        )
    metadata.problems += [
        FileProblem(f, f"{mismatch}; they are paired by number.") for f, mismatch in mismatches.items()
    ]
    numbers, name_of = numbered
    first = 1 if 0 not in numbers and max(numbers) == longest else 0
    if not any(0 <= number - first < longest for number in numbers):
        raise InputError(f"No image's number is that of one of the {longest} rows; name the images 0.png, 1.png, ...")
    if first:
        metadata.assumptions.append("The images are numbered from 1, so image 1 belongs to the first row.")
    by_number = dict(zip(numbers, images))
    wanted = sorted(set(numbers) | set(range(first, first + longest)))
    metadata.images = [by_number[n] if n in by_number else images[0].parent / name_of(n) for n in wanted]
    index = np.array(wanted) - first
    return {
        key: np.where((index < len(rows))[:, None], rows[np.minimum(index, len(rows) - 1)], np.nan)
        for key, (_, rows) in tables.items()
    }


def _numbered(images: list[Path]) -> tuple[list[int], Callable[[int], str]] | None:
    """(number of each image, name of any number) if the names differ in one whole number only."""
    parts = [re.fullmatch(r"(\D*)(\d{1,9})(\D*)", path.name) for path in images]
    found = [match.groups() for match in parts if match is not None]
    if len(found) < len(images) or len({(before, after.lower()) for before, _, after in found}) > 1:
        return None
    before, digits, after = found[0]
    width = len(digits) if len({len(d) for _, d, _ in found}) == 1 else 0
    return [int(d) for _, d, _ in found], lambda number: f"{before}{number:0{width}d}{after}"


def check_intrinsics(intrinsics: Intrinsics) -> None:
    """Refuse intrinsics that no depth camera has.

    Raises:
        InputError: for more pixels than any depth camera has, a field of view outside 10-170 degrees, very unequal
            focal lengths, or a principal point that lies outside the image or far from its middle.
    """
    K = intrinsics
    if K.width * K.height > MAX_PIXELS:
        raise InputError(
            f"The intrinsics are for {printable(K.width, 20)} x {printable(K.height, 20)} px; more than "
            f"{MAX_PIXELS / 1e6:g} million are not read."
        )
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
    offset = max(abs((K.cx + 0.5) / K.width - 0.5), abs((K.cy + 0.5) / K.height - 0.5))
    if offset > _MAX_CENTRE_OFFSET:
        raise InputError(
            f"The principal point ({K.cx}, {K.cy}) lies {100 * offset:.0f} % of the {K.width} x {K.height} image away "
            "from its middle; check that the intrinsics belong to this resolution, and crop images evenly."
        )


def rotation_from_quaternion(quaternion: Float[np.ndarray, " 4"]) -> Float[np.ndarray, "3 3"]:
    """Rotation matrix of (x, y, z, w), normalised; NaN where these four are not nearly a unit quaternion."""
    norm = np.linalg.norm(quaternion)
    if not abs(norm - 1.0) < _QUATERNION_TOLERANCE:
        return np.full((3, 3), np.nan)
    return host.rotation_matrix(np.roll(quaternion, 1) / norm)


def camera_heading(R_world_camera: Float[np.ndarray, "3 3"]) -> float:
    """[rad] yaw of the optical axis in a world with z up."""
    return math.atan2(R_world_camera[1, 2], R_world_camera[0, 2])


def camera_tilt(R_world_camera: Float[np.ndarray, "3 3"]) -> tuple[float, float]:
    """(pitch, roll) [rad] of an optical frame (x right, y down, z forward) in a world with z up (`camera_pose`)."""
    up = R_world_camera[2]
    return math.asin(float(np.clip(-up[2], -1.0, 1.0))), math.atan2(-up[0], -up[1])


def facing_camera(
    R_world_body: Float[np.ndarray, "3 3"],
    p_world_body: Float[np.ndarray, " 3"],
    R_body_camera: Float[np.ndarray, "3 3"],
    p_body_camera: Float[np.ndarray, " 3"],
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 5"]]:
    """(pose, mount) of a base at the body's place that faces along the optical axis; the mount's height is unknown.

    Args:
        R_world_body, p_world_body: [m] of the body in a world with z up.
        R_body_camera, p_body_camera: [m] of the optical frame (x right, y down, z forward) in the body.
    """
    R_world_camera = R_world_body @ R_body_camera
    yaw = camera_heading(R_world_camera)
    pitch, roll = camera_tilt(R_world_camera)
    offset = R_world_body @ p_body_camera
    forward = math.cos(yaw) * offset[0] + math.sin(yaw) * offset[1]
    left = math.cos(yaw) * offset[1] - math.sin(yaw) * offset[0]
    return np.array([p_world_body[0], p_world_body[1], yaw]), np.array([math.nan, pitch, roll, forward, left])


def turn_if_upside_down(
    metadata: RecordingMetadata, mounts: Float[np.ndarray, "n 5"], by: str
) -> Float[np.ndarray, "n 5"]:
    """The mounts of images that are turned upright, if most were taken upside down, which the metadata then says."""
    rolls = mounts[np.isfinite(mounts[:, 2]), 2]
    if not rolls.size or np.median(np.abs(rolls)) <= math.pi / 2:
        return mounts
    metadata.upside_down = True
    metadata.assumptions.append(f"{by} the camera was mounted upside down: images are turned by 180 degrees.")
    upright = mounts.copy()
    upright[:, 2] -= math.pi * np.sign(mounts[:, 2])
    return upright


def nearest_in_time(
    recorded: Float[np.ndarray, " m"], stamps: Float[np.ndarray, " n"], gap: float = MAX_TIME_GAP
) -> Int[np.ndarray, " n"]:
    """Row of the recorded stamp nearest to each stamp; -1 where none is within the gap [s].

    Args:
        recorded: [s] in order.
        stamps: [s].
        gap: [s].
    """
    if len(recorded) == 0:
        return np.full(len(stamps), -1)
    after = np.clip(np.searchsorted(recorded, stamps), 0, len(recorded) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(recorded[before] - stamps) <= np.abs(recorded[after] - stamps), before, after)
    return np.where(np.abs(recorded[nearest] - stamps) <= gap, nearest, -1)

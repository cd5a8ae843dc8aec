"""Layout `tum`: the TUM RGB-D benchmark's folder with depth.txt and groundtruth.txt, 5000 units a metre."""

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from iwalker_jax.data.recordings.folder_files import (
    MAX_IMAGES,
    depth_images,
    inside,
    is_there,
    read_folder_text,
    read_numbers,
)
from iwalker_jax.data.recordings.metadata import (
    RecordingMetadata,
    camera_heading,
    camera_tilt,
    nearest_in_time,
    rotation_from_quaternion,
)
from iwalker_jax.data.recordings.report import FileProblem
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics
from iwalker_jax.runtime import printable

LISTING = "depth.txt"
GROUND_TRUTH = "groundtruth.txt"

DEPTH_SCALE = 1.0 / 5000.0
"""[m] per unit of the benchmark's depth images."""

DEFAULT_INTRINSICS = (640, 480, 525.0, 525.0, 319.5, 239.5)
"""The values that the benchmark recommends when a sequence has no calibration of its own."""


def read_tum_layout(folder: Path, intrinsics: Intrinsics | None, depth_scale: float | None) -> RecordingMetadata:
    """Metadata of a TUM RGB-D folder.

    depth.txt has lines `stamp file`; without it the images' names are their stamps. groundtruth.txt has lines
    `stamp tx ty tz qx qy qz qw`, the optical frame in a world with z up; each image takes the nearest in time. The
    base is taken to stand below the camera and to face along the optical axis; the mount is fitted to the floor.

    Args:
        folder: of the recording.
        intrinsics, depth_scale: given by the caller; None takes the benchmark's defaults.

    Raises:
        InputError: if a text file is malformed.
    """
    assumptions = []
    if intrinsics is None:
        intrinsics = Intrinsics(*DEFAULT_INTRINSICS)
        assumptions.append("The TUM layout names no intrinsics: the benchmark's defaults (640 x 480, f 525) are taken.")
    if depth_scale is None:
        depth_scale = DEPTH_SCALE
        assumptions.append("The TUM layout names no depth scale: 5000 units are taken as 1 m.")
    present, about_names = depth_images(folder / "depth")
    if is_there(folder / LISTING):
        stamps, images = _listed_images(folder)
    else:
        stamps, images = _stamps_of_names(present), present
        assumptions += about_names
    metadata = RecordingMetadata("tum", folder, images, intrinsics, depth_scale, assumptions=assumptions)
    if len(present) != len(images):
        metadata.problems.append(
            FileProblem(LISTING, f"lists {len(images)} images but the folder holds {len(present)}.")
        )
    if is_there(folder / GROUND_TRUTH):
        metadata.poses, metadata.tilts = _poses(folder, stamps)
        assumptions.append("The base is taken to stand below the camera and to face along its optical axis.")
    return metadata


def _listed_images(folder: Path) -> tuple[Float[np.ndarray, " n"], list[Path]]:
    """(stamps [s], image paths) of depth.txt."""
    stamps: list[float] = []
    images: list[Path] = []
    for number, line in enumerate(read_folder_text(folder, LISTING).splitlines(), start=1):
        words = line.split("#")[0].split()
        if not words:
            continue
        try:
            stamp, file = words
            stamps.append(float(stamp))
        except ValueError:
            raise InputError(f"{LISTING}, line {number}: {printable(repr(line[:60]))} is not `stamp file`.") from None
        images.append(inside(folder, file, f"{LISTING}, line {number}: the file"))
        if len(images) > MAX_IMAGES:
            raise InputError(f"{LISTING} lists more than {MAX_IMAGES} images; split the recording.")
    if not np.isfinite(stamps).all():
        raise InputError(f"{LISTING} has a time stamp that is not finite; write seconds.")
    if len(set(images)) < len(images) or len(set(stamps)) < len(stamps):
        raise InputError(f"{LISTING} lists an image or a time stamp twice; list each once.")
    return np.array(stamps), images


def _stamps_of_names(images: list[Path]) -> Float[np.ndarray, " n"]:
    if not all(re.fullmatch(r"\d{1,20}(\.\d+)?", path.stem) for path in images):
        raise InputError(f"{LISTING} is missing and the images' names are not time stamps; add {LISTING}.")
    return np.array([float(path.stem) for path in images])


def _poses(folder: Path, stamps: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 2"]]:
    """Planar poses and the camera's tilts; NaN for images without a pose close in time."""
    table = np.array(read_numbers(folder, GROUND_TRUTH, (8,), "time stamps and poses")).reshape(-1, 8)
    table = table[np.isfinite(table[:, 0])]
    table = table[np.argsort(table[:, 0], kind="stable")]
    poses, tilts = np.full((len(stamps), 3), np.nan), np.full((len(stamps), 2), np.nan)
    for row, index in enumerate(nearest_in_time(table[:, 0], stamps)):
        if index >= 0:
            R_world_camera = rotation_from_quaternion(table[index, 4:])
            poses[row] = [table[index, 1], table[index, 2], camera_heading(R_world_camera)]
            tilts[row] = camera_tilt(R_world_camera)
    return poses, tilts

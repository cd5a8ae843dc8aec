"""Layout `tum`: the TUM RGB-D benchmark's folder with depth.txt and groundtruth.txt, 5000 units a metre."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from iwalker_jax.data.recordings.metadata import (
    RecordingMetadata,
    camera_heading,
    read_numbers,
    rotation_from_quaternion,
    sorted_images,
)
from iwalker_jax.data.recordings.report import FileProblem
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics

DEPTH_SCALE = 1.0 / 5000.0
"""[m] per unit of the benchmark's depth images."""

DEFAULT_INTRINSICS = (640, 480, 525.0, 525.0, 319.5, 239.5)
"""The values that the benchmark recommends when a sequence has no calibration of its own."""

MAX_TIME_GAP = 0.05
"""[s] between a depth image and the nearest recorded pose."""


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
    stamps, images = _listed_images(folder)
    metadata = RecordingMetadata("tum", folder, images, intrinsics, depth_scale, assumptions=assumptions)
    present = len(list((folder / "depth").glob("*.png")))
    if present != len(images):
        metadata.problems.append(
            FileProblem("depth.txt", f"lists {len(images)} images but the folder holds {present}.")
        )
    if (folder / "groundtruth.txt").is_file():
        metadata.poses = _poses(metadata, stamps)
        assumptions.append("The base is taken to stand below the camera and to face along its optical axis.")
    return metadata


def _listed_images(folder: Path) -> tuple[Float[np.ndarray, " n"], list[Path]]:
    """(stamps [s], image paths) of depth.txt, or of the images' own names."""
    listing = folder / "depth.txt"
    stamps, images = [], []
    if listing.is_file():
        for number, line in enumerate(listing.read_text(errors="replace").splitlines(), start=1):
            words = line.split("#")[0].split()
            if not words:
                continue
            try:
                stamp, file = words
                stamps.append(float(stamp))
            except ValueError:
                raise InputError(f"depth.txt, line {number}: {line[:60]!r} is not `stamp file`.") from None
            images.append(folder / file)
        return np.array(stamps), images
    images = sorted_images(folder / "depth")
    try:
        return np.array([float(path.stem) for path in images]), images
    except ValueError:
        raise InputError("depth.txt is missing and the images' names are not time stamps; add depth.txt.") from None


def _poses(metadata: RecordingMetadata, stamps: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Planar poses; NaN for images without a pose close in time."""
    table = np.array(read_numbers(metadata.folder / "groundtruth.txt", (8,), "time stamps and poses")).reshape(-1, 8)
    poses = np.full((len(stamps), 3), np.nan)
    if len(table) == 0:
        return poses
    nearest = np.array([int(np.argmin(np.abs(table[:, 0] - stamp))) for stamp in stamps], int)
    for row, index in enumerate(nearest):
        if abs(table[index, 0] - stamps[row]) <= MAX_TIME_GAP:
            R_world_camera = rotation_from_quaternion(table[index, 4:])
            poses[row] = [table[index, 1], table[index, 2], camera_heading(R_world_camera)]
    return poses

"""Layout `bag`: a bag of ROS 1 or ROS 2, whose depth messages become the PNG images of a recording's folder."""

import math
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from jaxtyping import Float

from iwalker_jax.data.recordings.bag.calibration import Calibration, calibration_of
from iwalker_jax.data.recordings.bag.depth_messages import write_png, write_units
from iwalker_jax.data.recordings.bag.stream import Bag, open_bag
from iwalker_jax.data.recordings.bag.topics import ChosenTopics, DepthTopic, choose_topics, expected_calibration
from iwalker_jax.data.recordings.bag.transforms import (
    PosesOverTime,
    read_odometry,
    read_transforms,
    stamp_of,
)
from iwalker_jax.data.recordings.folder_files import MAX_IMAGES, is_there
from iwalker_jax.data.recordings.metadata import (
    RecordingMetadata,
    facing_camera,
    turn_if_upside_down,
)
from iwalker_jax.data.recordings.report import FileProblem
from iwalker_jax.data.recordings.stored_depth import MILLIMETRE
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics
from iwalker_jax.perception.depth_png import read_png_units
from iwalker_jax.runtime import printable

_SUFFIXES = (".bag", ".mcap", ".db3")
_DESCRIPTION = "metadata.yaml"


def is_bag(place: Path) -> bool:
    """Whether something is to be read as a bag: a file with a bag's ending, or a folder with metadata.yaml."""
    if place.is_dir():
        return is_there(place / _DESCRIPTION)
    return place.is_file() and place.suffix in _SUFFIXES


def read_bag_layout(
    place: Path, intrinsics: Intrinsics | None, depth_scale: float | None, topic: str | None
) -> RecordingMetadata:
    """Metadata of a bag; its images are unpacked into a folder that lasts as long as the metadata.

    Images lose the distortion that their CameraInfo states. Each takes the pose nearest in time: from odometry, or
    else of the robot's body in the root of tf. With the camera's frame in tf the base faces along the optical axis and
    the mount's angles and offsets are tf's; without it the camera is taken to look where the body faces.

    Args:
        place: of the bag.
        intrinsics: given by the caller, of images without distortion; they win over CameraInfo.
        depth_scale: [m] per unit, given by the caller; millimetres in 16UC1 and metres in 32FC1 if left out.
        topic: of the depth images; None chooses.

    Raises:
        InputError: if the bag cannot be read, or lacks depth images or their calibration.
    """
    scratch = TemporaryDirectory(prefix="iwalker-bag-")
    folder = Path(scratch.name)
    with open_bag(place) as bag:
        chosen = choose_topics(bag, topic, folder / "first.png")
        calibration = _calibration(bag, chosen.depth, intrinsics)
        stored_scale = MILLIMETRE if depth_scale is None or chosen.depth.encoding == "32FC1" else depth_scale
        metadata = RecordingMetadata(
            "bag", folder, [], calibration.intrinsics, stored_scale, topics=chosen.listed, scratch=scratch
        )
        metadata.assumptions.append(calibration.sentence)
        if depth_scale is None:
            units = "16UC1 is in millimetres" if chosen.depth.encoding == "16UC1" else "32FC1 is in metres"
            metadata.assumptions.append(f"{printable(chosen.depth.name)}: {units}, as ROS defines it.")
        stamps = _unpack(bag, chosen.depth, calibration, depth_scale, metadata)
        _add_poses(bag, chosen, stamps, metadata)
    return metadata


def _calibration(bag: Bag, depth: DepthTopic, intrinsics: Intrinsics | None) -> Calibration:
    if intrinsics is not None:
        return Calibration(intrinsics, None, "The intrinsics given by the caller are used; no distortion is removed.")
    if depth.info is None:
        raise InputError(
            f"{printable(depth.name)} has no calibration (expected on {printable(expected_calibration(depth.name))}); "
            "record its CameraInfo too, or give the intrinsics as arguments."
        )
    calibration = calibration_of(bag.first(depth.info), depth.info, depth.rectified)
    K = calibration.intrinsics
    if (K.width, K.height) != depth.size:
        raise InputError(
            f"{printable(depth.info)} is for {K.width} x {K.height} px, but the images of {printable(depth.name)} are "
            f"{depth.size[0]} x {depth.size[1]} px; record the calibration of these images."
        )
    return calibration


def _unpack(
    bag: Bag, depth: DepthTopic, calibration: Calibration, depth_scale: float | None, metadata: RecordingMetadata
) -> Float[np.ndarray, " n"]:
    """Writes the images, adds them to the metadata, and returns their stamps [s]."""
    if depth.messages > MAX_IMAGES:
        raise InputError(f"{printable(depth.name)} has {depth.messages} images; split recordings of over {MAX_IMAGES}.")
    metres = 1.0 if depth_scale is None else depth_scale
    size = (calibration.intrinsics.width, calibration.intrinsics.height)
    stamps: list[float] = []
    for number, (recorded, message) in enumerate(bag.messages(depth.name)):
        file = metadata.folder / f"{number:06d}.png"
        try:
            if isinstance(message, InputError):
                raise message
            stamps.append(stamp_of(message.header, recorded))
            metadata.images.append(file)
            write_units(message, depth.encoding, metres, size, file)
            if calibration.source is not None:
                write_png(file, calibration.undistorted(read_png_units(file, size)))
        except InputError as error:
            # A file that was written is named by whoever reads it.
            if not file.exists():
                metadata.problems.append(FileProblem(file.name, str(error)))
                if metadata.images and metadata.images[-1] == file:
                    metadata.images.pop()
                    stamps.pop()
        except OSError as error:
            raise InputError(
                f"Its images cannot be unpacked ({error.strerror}); set TMPDIR to a roomier place."
            ) from None
    if not metadata.images:
        first = metadata.problems[0] if metadata.problems else None
        raise InputError(f"No image of {printable(depth.name)} can be read. The first {first.problem if first else ''}")
    metadata.assumptions.append(f"Image n is message n of {printable(depth.name)}, counted from 0.")
    return np.array(stamps)


def _add_poses(bag: Bag, chosen: ChosenTopics, stamps: Float[np.ndarray, " n"], metadata: RecordingMetadata) -> None:
    tree, camera = read_transforms(bag), chosen.depth.frame
    if chosen.odometry is not None:
        odometry, body = read_odometry(bag, chosen.odometry)
        poses: PosesOverTime | None = odometry.at(stamps)
        where = f"odometry on {printable(chosen.odometry)}"
    else:
        body, root = tree.body_of(camera), tree.ancestors(camera)[-1]
        poses = tree.pose(root, body, stamps) if tree.moves(root, body) else None
        where = f"{printable(body)} in {printable(root)} by tf"
    if poses is None:
        metadata.assumptions.append("The bag has neither odometry nor a moving body in tf: no poses are known.")
        return
    metadata.assumptions.append(f"Poses are {where}, the nearest in time.")
    in_body = tree.pose(body, camera, stamps)
    if in_body is None:
        yaw = np.arctan2(poses.R[:, 1, 0], poses.R[:, 0, 0])
        metadata.poses = np.column_stack([poses.p[:, :2], yaw])
        metadata.assumptions.append(
            f"The camera's frame {printable(repr(camera))} is not below {printable(repr(body))} in tf: the camera is "
            "taken to look where the body faces."
        )
        return
    pairs = [facing_camera(*row) for row in zip(poses.R, poses.p, in_body.R, in_body.p)]
    metadata.poses, mounts = np.array([pose for pose, _ in pairs]), np.array([mount for _, mount in pairs])
    metadata.mounts = turn_if_upside_down(metadata, mounts, "By tf")
    pitches = mounts[np.isfinite(mounts[:, 1]), 1]
    if pitches.size and abs(np.median(pitches)) > math.radians(70.0):
        raise InputError(
            f"By tf the frame {printable(repr(camera))} looks {math.degrees(np.median(pitches)):.0f} degrees down; the "
            "images' frame must be the optical one (z forward)."
        )
    metadata.assumptions.append("The base is taken to face along the camera's optical axis.")

"""Recordings of real depth, validated and re-projected to the camera that networks see through."""

import functools
import os
from dataclasses import dataclass, replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32

from iwalker_jax.data.recordings import iplanner_layout, tum_layout, yaml_layout
from iwalker_jax.data.recordings.bag import is_bag, read_bag_layout
from iwalker_jax.data.recordings.folder_files import is_there
from iwalker_jax.data.recordings.free_ground import goal_places, reachable_ground
from iwalker_jax.data.recordings.metadata import RecordingMetadata, check_intrinsics
from iwalker_jax.data.recordings.mount_checks import Reading, check_mount, fit_mount, mounts_of, turned
from iwalker_jax.data.recordings.pose_checks import MAX_STEP, check_end, check_goals, check_poses, doubts_about_walking
from iwalker_jax.data.recordings.report import FileProblem, RecordingReport
from iwalker_jax.data.recordings.stored_depth import read_stored_depth, read_units
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics, depth_from_uint16, resize_depth
from iwalker_jax.runtime import printable

NO_FREE_GROUND = "shows no free ground ahead."
"""Problem of a frame that no goal can be given to."""

_SEEN_MOVE = 0.1  # [m] of the base, which every image shows

_READERS = {
    "yaml": yaml_layout.read_yaml_layout,
    "tum": tum_layout.read_tum_layout,
    "iplanner": iplanner_layout.read_iplanner_layout,
}


@dataclass(frozen=True)
class Recording:
    """Usable frames of one recording, in order.

    Attributes:
        report: what the validator found.
        metadata: of the usable frames.
        mounts: (N, 5) camera mounts as in `CameraMount`.
        poses: (N, 3) [x m, y m, yaw rad] of the base in the world; None if the recording has none.
        goals: (N, 2) [m] in each frame's base frame; None if the recording has none.
        reachable: (N, rows, columns) where each frame shows ground that the robot can reach (`reachable_ground`).
        camera: that `depth_frames` re-projects to.
    """

    report: RecordingReport
    metadata: RecordingMetadata
    mounts: Float32[np.ndarray, "n 5"]
    poses: Float32[np.ndarray, "n 3"] | None
    goals: Float32[np.ndarray, "n 2"] | None
    reachable: Bool[np.ndarray, "n rows columns"]
    camera: Intrinsics

    def __len__(self) -> int:
        return len(self.metadata.images)

    def depth_frames(self) -> Float32[np.ndarray, "n height width"]:
        """All frames through `camera` [m], 0 = no return; not yet cleaned (`clean_depth`).

        Raises:
            InputError: if a file has gone bad since the recording was validated.
        """
        frames = np.empty((len(self), self.camera.height, self.camera.width), np.float32)
        for row, path in enumerate(self.metadata.images):
            try:
                frames[row] = _reprojected_frame(self.metadata, path, self.camera)
            except InputError as error:
                raise InputError(f"{path} {error}") from None
        return frames


def load_recording(
    folder: str | Path,
    intrinsics: Intrinsics | None = None,
    depth_scale: float | None = None,
    camera: Intrinsics = Intrinsics(),
    topic: str | None = None,
) -> Recording:
    """Validate a recording's folder or bag and return its usable frames.

    The layout is recognised: `recording.yaml` (or bare images with `intrinsics` given), iPlanner's, TUM RGB-D's, or a
    bag of ROS 1 or 2.
    Where no mount is recorded the floor is fitted in each frame; frames without a visible floor take the median.

    Args:
        folder: of the recording, or a bag.
        intrinsics: of the stored images; wins over the folder's own.
        depth_scale: [m] per unit of the images; wins over the folder's own.
        camera: that the frames are re-projected to.
        topic: of a bag's depth images; None chooses.

    Raises:
        InputError: if no frame is usable; the sentence says why.
    """
    report, recording = _examine(Path(folder), intrinsics, depth_scale, camera, topic)
    if recording is None:
        raise InputError(
            f"The recording {folder} cannot be used: {report.fatal} More is said by `python -m "
            "experiments.validate_recording`."
        )
    return recording


def validate_recording(
    folder: str | Path,
    intrinsics: Intrinsics | None = None,
    depth_scale: float | None = None,
    topic: str | None = None,
) -> RecordingReport:
    """What `load_recording` would find, as a report; never raises for bad recordings."""
    return _examine(Path(folder), intrinsics, depth_scale, Intrinsics(), topic)[0]


def _examine(
    folder: Path, intrinsics: Intrinsics | None, depth_scale: float | None, camera: Intrinsics, topic: str | None
) -> tuple[RecordingReport, Recording | None]:
    report = RecordingReport(folder, "unknown")
    metadata = None
    try:
        report = replace(report, layout=_recognise(folder))
        metadata = _read_layout(report.layout, folder, intrinsics, depth_scale, topic)
        report = replace(report, found=len(metadata.images))
        metadata.assumptions += _unread(folder, report.layout)
        metadata = _checked(metadata)
        metadata, fits = _readable(metadata, camera)
        metadata.problems += _doubts(metadata, fits, camera)
        mounts, assumed = mounts_of(metadata.mounts, fits)
        metadata.assumptions += assumed
        metadata, mounts, reachable = _with_free_ground(metadata, mounts.astype(np.float32), camera)
        if metadata.poses is not None and metadata.goals is None:
            check_end(metadata.poses)
    except InputError as error:
        known = report if metadata is None else _report(report, metadata)
        return replace(known, fatal=str(error)), None
    median = tuple(float(value) for value in np.median(mounts, axis=0))
    usable = tuple(_name(metadata, path) for path in metadata.images)
    report = replace(_report(report, metadata), usable=usable, mount=median)
    poses, goals = (None if table is None else table.astype(np.float32) for table in (metadata.poses, metadata.goals))
    return report, Recording(report, metadata, mounts, poses, goals, reachable, camera)


def _read_layout(
    layout: str, folder: Path, intrinsics: Intrinsics | None, depth_scale: float | None, topic: str | None
) -> RecordingMetadata:
    if layout == "bag":
        return read_bag_layout(folder, intrinsics, depth_scale, topic)
    if topic is not None:
        raise InputError("It is no bag, so that it has no topics; leave the topic out.")
    return _READERS[layout](folder, intrinsics, depth_scale)


def _report(report: RecordingReport, metadata: RecordingMetadata) -> RecordingReport:
    """The report with what is known by now; every copy of the metadata adds to the same problems and assumptions."""
    return replace(
        report,
        problems=tuple(metadata.problems),
        assumptions=tuple(metadata.assumptions),
        intrinsics=metadata.intrinsics,
        depth_scale=metadata.depth_scale,
        topics=tuple(metadata.topics),
    )


def _recognise(folder: Path) -> str:
    try:
        present = folder.is_dir() and any(True for _ in os.scandir(folder))
    except (OSError, ValueError) as error:
        raise InputError(f"The folder cannot be listed ({getattr(error, 'strerror', None) or error}).") from None
    if is_bag(folder):
        return "bag"
    if not present and not folder.is_dir():
        raise InputError("There is no such folder, and no bag (.bag, .mcap or .db3) of this name.")
    if is_there(folder / yaml_layout.FILE_NAME):
        return "yaml"
    if is_there(folder / iplanner_layout.ODOMETRY):
        return "iplanner"
    if is_there(folder / tum_layout.LISTING) or is_there(folder / tum_layout.GROUND_TRUTH):
        return "tum"
    if any(yaml_layout.images_of(place)[0] for place in (folder, folder / "depth")):
        return "yaml"
    raise InputError(
        "It is in none of the known layouts: recording.yaml with PNG or .npy images, TUM RGB-D (depth.txt), iPlanner "
        "(odom_ground_truth.txt), or a bag (metadata.yaml)."
    )


def _unread(folder: Path, layout: str) -> list[str]:
    """Says which files of other layouts lie there as well."""
    files = {"yaml": yaml_layout.FILE_NAME, "iplanner": iplanner_layout.ODOMETRY, "tum": tum_layout.GROUND_TRUTH}
    others = [name for other, name in files.items() if other != layout and is_there(folder / name)]
    return [f"The folder is read in the layout {layout}; {', '.join(others)} in it is not read."] if others else []


def _checked(metadata: RecordingMetadata) -> RecordingMetadata:
    """The metadata without poses that nothing is known of; InputError for what cannot be."""
    check_intrinsics(metadata.intrinsics)
    depth_from_uint16(np.zeros((1, 1), np.uint16), metadata.depth_scale)
    if not metadata.images:
        raise InputError("It holds no depth images (.png, or .npy in metres).")
    if metadata.poses is not None and not np.isfinite(metadata.poses).all(axis=1).any():
        metadata.problems.append(
            FileProblem("poses", "are not finite or not close in time for any image; they are left out.")
        )
        mounts = None if metadata.layout in ("iplanner", "bag") else metadata.mounts
        metadata = replace(metadata, poses=None, mounts=mounts, tilts=None)
    if metadata.goals is not None:
        check_goals(metadata.goals, metadata.poses)
    return metadata


def _readable(metadata: RecordingMetadata, camera: Intrinsics) -> tuple[RecordingMetadata, Float[np.ndarray, "n 4"]]:
    """The metadata of frames that can be read, with a pose where there are poses, and their floor fits."""
    kept: list[int] = []
    fits = []
    last = np.zeros(0)
    strays = None if metadata.poses is None else check_poses(metadata.poses)
    if metadata.poses is not None:
        metadata.problems += [FileProblem("poses", doubt) for doubt in doubts_about_walking(metadata.poses)]
    first = ""
    for row, path in enumerate(metadata.images):
        try:
            frame = _reprojected_frame(metadata, path, camera)
            _check_row(metadata, row)
            if strays is not None and strays[row]:
                raise InputError(f"has a pose more than {MAX_STEP:g} m from those before and after it.")
        except InputError as error:
            metadata.problems.append(FileProblem(_name(metadata, path), str(error)))
            first = first or f"{_name(metadata, path)} {error}"
            continue
        image = np.asarray(frame)
        if kept and np.array_equal(image, last) and _moves(metadata, kept[-1], row):
            problem = (
                f"shows exactly what {_name(metadata, metadata.images[kept[-1]])} shows, though the base has moved."
            )
            metadata.problems.append(FileProblem(_name(metadata, path), problem))
            continue
        last = image
        kept.append(row)
        fits.append(fit_mount(frame, camera))
    if not kept:
        raise InputError(f"None of its {len(metadata.images)} images is usable. The first: {first}")
    return _selected(metadata, kept), np.array(fits)


def _moves(metadata: RecordingMetadata, row: int, other: int) -> bool:
    """Whether the base moves between two images so far that they must differ."""
    if metadata.poses is None:
        return False
    return float(np.linalg.norm(metadata.poses[other, :2] - metadata.poses[row, :2])) > _SEEN_MOVE


def _selected(metadata: RecordingMetadata, rows: list[int]) -> RecordingMetadata:
    """The metadata of some of its frames."""
    return replace(
        metadata,
        images=[metadata.images[row] for row in rows],
        poses=None if metadata.poses is None else metadata.poses[rows],
        mounts=None if metadata.mounts is None else metadata.mounts[rows],
        goals=None if metadata.goals is None else metadata.goals[rows],
        tilts=None if metadata.tilts is None else metadata.tilts[rows],
    )


def _doubts(metadata: RecordingMetadata, fits: Float[np.ndarray, "n 4"], camera: Intrinsics) -> list[FileProblem]:
    """What the floor says about units, intrinsics and the written mount; InputError if it contradicts them."""
    K = metadata.intrinsics
    written, where = None, ""
    if metadata.mounts is not None:
        where = {"iplanner": iplanner_layout.EXTRINSICS, "bag": "tf"}.get(metadata.layout, yaml_layout.FILE_NAME)
        written = metadata.mounts[:, :3]
    elif metadata.tilts is not None:
        written, where = np.insert(metadata.tilts, 0, np.nan, axis=1), tum_layout.GROUND_TRUTH
    return check_mount(
        written,
        where,
        fits,
        lambda row: read_units(metadata.images[row], (K.width, K.height)),
        Reading(K, metadata.depth_scale, 2 if metadata.upside_down else 0),
        camera,
    )


def _with_free_ground(
    metadata: RecordingMetadata, mounts: Float32[np.ndarray, "n 5"], camera: Intrinsics
) -> tuple[RecordingMetadata, Float32[np.ndarray, "k 5"], Bool[np.ndarray, "k rows columns"]]:
    """Only the frames that show a place for a goal, with their mounts and reachable cells."""
    kept, reachable = [], []
    for row, path in enumerate(metadata.images):
        frame = _reprojected_frame(metadata, path, camera)
        cells = np.asarray(reachable_ground(frame, mounts[row], camera))
        if len(goal_places(cells)):
            kept.append(row)
            reachable.append(cells)
        else:
            metadata.problems.append(FileProblem(_name(metadata, path), NO_FREE_GROUND))
    if not kept:
        raise InputError(
            f"No frame of its {len(metadata.images)} shows free ground ahead; check the camera's mount and intrinsics, "
            "and that the camera sees the floor."
        )
    return _selected(metadata, kept), mounts[kept], np.stack(reachable)


def _check_row(metadata: RecordingMetadata, row: int) -> None:
    """Refuse a frame whose pose or goal is unknown; a recorded mount may lack its height, which is fitted."""
    for table, what in ((metadata.poses, "pose"), (metadata.goals, "goal")):
        if table is not None and not np.isfinite(table[row]).all():
            raise InputError(f"has no finite {what} (none recorded for it, none close in time, or not a number).")


def _reprojected_frame(metadata: RecordingMetadata, path: Path, camera: Intrinsics) -> Float[Array, "height width"]:
    K = metadata.intrinsics
    depth, K = turned(
        read_stored_depth(path, metadata.depth_scale, (K.width, K.height)), K, 2 if metadata.upside_down else 0
    )
    return _resize(jnp.asarray(depth), K, camera)


@functools.partial(jax.jit, static_argnums=(1, 2))
def _resize(
    depth: Float[Array, "stored_height stored_width"], intrinsics: Intrinsics, camera: Intrinsics
) -> Float[Array, "height width"]:
    return resize_depth(depth, intrinsics, camera)


def _name(metadata: RecordingMetadata, path: Path) -> str:
    return printable(path.relative_to(metadata.folder) if path.is_relative_to(metadata.folder) else path, 200)

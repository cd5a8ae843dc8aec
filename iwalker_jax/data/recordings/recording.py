"""Recordings of real depth, validated and re-projected to the camera that networks see through."""

import functools
import math
from dataclasses import dataclass, replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32

from iwalker_jax.data.recordings import iplanner_layout, yaml_layout
from iwalker_jax.data.recordings.iplanner_layout import read_iplanner_layout
from iwalker_jax.data.recordings.metadata import RecordingMetadata, check_intrinsics
from iwalker_jax.data.recordings.report import FileProblem, RecordingReport
from iwalker_jax.data.recordings.tum_layout import read_tum_layout
from iwalker_jax.data.recordings.yaml_layout import read_yaml_layout
from iwalker_jax.errors import InputError
from iwalker_jax.perception import (
    CameraMount,
    FloorFit,
    Intrinsics,
    clean_depth,
    depth_from_uint16,
    fit_floor,
    resize_depth,
)
from iwalker_jax.perception.depth_png import read_depth_png

_MAX_MOUNT_DEVIATION = (0.15, math.radians(10.0), math.radians(10.0))  # of one frame's fit from the median


@dataclass(frozen=True)
class Recording:
    """Usable frames of one recording, in order.

    Attributes:
        report: what the validator found.
        metadata: of the usable frames.
        mounts: (N, 5) camera mounts as in `CameraMount`.
        poses: (N, 3) [x m, y m, yaw rad] of the base in the world; None if the recording has none.
        goals: (N, 2) [m] in each frame's base frame; None if the recording has none.
        camera: that `depth_frames` re-projects to.
    """

    report: RecordingReport
    metadata: RecordingMetadata
    mounts: Float32[np.ndarray, "n 5"]
    poses: Float32[np.ndarray, "n 3"] | None
    goals: Float32[np.ndarray, "n 2"] | None
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
) -> Recording:
    """Validate a recording's folder and return its usable frames.

    The layout is recognised: `recording.yaml` (or bare images with `intrinsics` given), iPlanner's, or TUM RGB-D's.
    Where no mount is recorded the floor is fitted in each frame; frames without a visible floor take the median.

    Args:
        folder: of the recording.
        intrinsics: of the stored images; wins over the folder's own.
        depth_scale: [m] per unit of the images; wins over the folder's own.
        camera: that the frames are re-projected to.

    Raises:
        InputError: if no frame is usable; the sentence says why.
    """
    report, recording = _examine(Path(folder), intrinsics, depth_scale, camera)
    if recording is None:
        raise InputError(f"The recording {folder} cannot be used: {report.fatal}")
    return recording


def validate_recording(
    folder: str | Path, intrinsics: Intrinsics | None = None, depth_scale: float | None = None
) -> RecordingReport:
    """What `load_recording` would find, as a report; never raises for bad recordings."""
    return _examine(Path(folder), intrinsics, depth_scale, Intrinsics())[0]


def _examine(
    folder: Path, intrinsics: Intrinsics | None, depth_scale: float | None, camera: Intrinsics
) -> tuple[RecordingReport, Recording | None]:
    layout = "unknown"
    try:
        layout = _recognise(folder)
        readers = {"yaml": read_yaml_layout, "tum": read_tum_layout, "iplanner": read_iplanner_layout}
        metadata = readers[layout](folder, intrinsics, depth_scale)
        check_intrinsics(metadata.intrinsics)
        depth_from_uint16(np.zeros((1, 1), np.uint16), metadata.depth_scale)
        if not metadata.images:
            raise InputError("It holds no PNG depth images.")
    except InputError as error:
        return RecordingReport(folder, layout, fatal=str(error)), None
    found = len(metadata.images)
    metadata, fits = _keep_usable(metadata, camera)
    report = RecordingReport(
        folder,
        layout,
        found,
        tuple(_name(metadata, path) for path in metadata.images),
        tuple(metadata.problems),
        tuple(metadata.assumptions),
        intrinsics=metadata.intrinsics,
        depth_scale=metadata.depth_scale,
    )
    if not metadata.images:
        first = report.problems[-found]
        fatal = f"None of its {found} images is usable. The first: {first.file} {first.problem}"
        return replace(report, fatal=fatal), None
    mounts, assumption = _mounts(metadata.mounts, fits)
    median = tuple(float(value) for value in np.median(mounts, axis=0))
    report = replace(report, assumptions=(*report.assumptions, *assumption), mount=median)
    poses, goals = (None if table is None else table.astype(np.float32) for table in (metadata.poses, metadata.goals))
    return report, Recording(report, metadata, mounts.astype(np.float32), poses, goals, camera)


def _recognise(folder: Path) -> str:
    if not folder.is_dir():
        raise InputError("There is no such folder.")
    if (folder / yaml_layout.FILE_NAME).is_file():
        return "yaml"
    if (folder / iplanner_layout.ODOMETRY).is_file():
        return "iplanner"
    if (folder / "depth.txt").is_file() or (folder / "groundtruth.txt").is_file():
        return "tum"
    if any(folder.glob("*.png")) or any(folder.glob("depth/*.png")):
        return "yaml"
    raise InputError(
        "It is in none of the known layouts: recording.yaml with PNG images, TUM RGB-D (depth.txt), or iPlanner "
        "(odom_ground_truth.txt)."
    )


def _keep_usable(metadata: RecordingMetadata, camera: Intrinsics) -> tuple[RecordingMetadata, Float[np.ndarray, "n 4"]]:
    """The metadata with only its usable frames, and their floor fits [height, pitch, roll, valid]."""
    kept, fits, problems = [], [], list(metadata.problems)
    if metadata.poses is not None and not np.isfinite(metadata.poses).all(axis=1).any():
        problems.append(FileProblem("poses", "are not finite or not close in time for any image; they are left out."))
        metadata = replace(metadata, poses=None, mounts=None if metadata.layout == "iplanner" else metadata.mounts)
    for row, path in enumerate(metadata.images):
        try:
            frame = _reprojected_frame(metadata, path, camera)
            _check_row(metadata, row)
        except InputError as error:
            problems.append(FileProblem(_name(metadata, path), str(error)))
            continue
        kept.append(row)
        fit = _fit(frame, camera)
        fits.append([float(fit.height), float(fit.pitch), float(fit.roll), float(fit.valid)])
    usable = replace(
        metadata,
        images=[metadata.images[row] for row in kept],
        poses=None if metadata.poses is None else metadata.poses[kept],
        mounts=None if metadata.mounts is None else metadata.mounts[kept],
        goals=None if metadata.goals is None else metadata.goals[kept],
        problems=problems,
    )
    return usable, np.array(fits).reshape(-1, 4)


def _check_row(metadata: RecordingMetadata, row: int) -> None:
    """Refuse a frame whose pose or goal is unknown; a recorded mount may lack its height, which is fitted."""
    for table, what in ((metadata.poses, "pose"), (metadata.goals, "goal")):
        if table is not None and not np.isfinite(table[row]).all():
            raise InputError(f"has no finite {what} (none recorded for it, none close in time, or not a number).")


def _reprojected_frame(metadata: RecordingMetadata, path: Path, camera: Intrinsics) -> Float[Array, "height width"]:
    intrinsics = metadata.intrinsics
    depth = read_depth_png(path, metadata.depth_scale, (intrinsics.width, intrinsics.height))
    if metadata.upside_down:
        depth = depth[::-1, ::-1]
        intrinsics = replace(
            intrinsics, cx=intrinsics.width - 1 - intrinsics.cx, cy=intrinsics.height - 1 - intrinsics.cy
        )
    return _resize(jnp.asarray(depth), intrinsics, camera)


@functools.partial(jax.jit, static_argnums=(1, 2))
def _resize(
    depth: Float[Array, "stored_height stored_width"], intrinsics: Intrinsics, camera: Intrinsics
) -> Float[Array, "height width"]:
    return resize_depth(depth, intrinsics, camera)


@functools.partial(jax.jit, static_argnums=1)
def _fit(frame: Float[Array, "height width"], camera: Intrinsics) -> FloorFit:
    return fit_floor(clean_depth(frame), camera)


def _mounts(
    recorded: Float[np.ndarray, "n 5"] | None, fits: Float[np.ndarray, "n 4"]
) -> tuple[Float[np.ndarray, "n 5"], tuple[str, ...]]:
    """(mounts, assumptions): recorded ones, their height fitted where it is NaN; all fitted where none are recorded."""
    if recorded is not None and np.isfinite(recorded).all():
        return recorded, ()
    valid = fits[:, 3] > 0
    default = np.array([CameraMount.height, CameraMount.pitch, CameraMount.roll])
    median = np.median(fits[valid, :3], axis=0) if valid.any() else default
    share = f"the floor was found in {int(valid.sum())} of {len(fits)} frames"
    origin = f"fitted ({share})" if valid.any() else f"taken from the default mount ({share})"
    if recorded is not None:
        mounts = np.where(np.isfinite(recorded), recorded, 0.0)
        mounts[:, 0] = median[0]
        return mounts, (f"The camera's height, {median[0]:.2f} m, is {origin}.",)
    near = valid & (np.abs(fits[:, :3] - median) <= _MAX_MOUNT_DEVIATION).all(axis=1)
    tilt = np.where(near[:, None], fits[:, :3], median)
    mounts = np.concatenate([tilt, np.zeros((len(fits), 2))], axis=1)
    degrees = np.degrees(median[1:])
    return mounts, (
        f"The camera's mount is {origin}: median height {median[0]:.2f} m, pitch {degrees[0]:.1f} degrees down, roll "
        f"{degrees[1]:.1f} degrees; it is taken to sit above the base's origin.",
    )


def _name(metadata: RecordingMetadata, path: Path) -> str:
    return str(path.relative_to(metadata.folder)) if path.is_relative_to(metadata.folder) else str(path)

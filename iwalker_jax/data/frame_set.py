"""Frame sets: depth images with mounts and goals, the one form in which training data reaches the planner."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int, UInt16

from iwalker_jax.errors import InputError, MissingFileError
from iwalker_jax.perception import Intrinsics
from iwalker_jax.runtime import read_npz, write_npz

DEPTH_UNIT = 0.001
"""[m] stored depth unit: depth images rest as uint16 millimetres, as the sensors deliver them."""


_ARRAYS = ("depth", "mounts", "goals", "poses", "scene_index")


@dataclass(frozen=True, eq=False)
class FrameSet:
    """Depth images with what a planner is asked there.

    Attributes:
        depth: (n, height, width) uint16 z-depth [mm], 0 = no return.
        mounts: (n, 5) float32 camera mounts [height, pitch, roll, forward, left] ([m], [rad]).
        goals: (n, g, 2) float32 [m] goals in the base frame; the first is the route's end, the others are further
            reachable points used to vary the task.
        poses: (n, 3) float32 [x, y, yaw] of the base in its scene's world frame; NaN where unknown.
        scene_index: (n,) int32 index into `scene_names`; frames of one scene are consecutive.
        scene_names: names of the scenes or recordings.
        camera: that all images are seen through.
    """

    depth: np.ndarray
    mounts: np.ndarray
    goals: np.ndarray
    poses: np.ndarray
    scene_index: np.ndarray
    scene_names: tuple[str, ...]
    camera: Intrinsics

    def __post_init__(self) -> None:
        n = len(self.depth)
        if n == 0:
            raise InputError("A frame set needs at least one frame; check that the recording or the scenes hold any.")
        if self.depth.ndim != 3 or self.depth.dtype != np.uint16:
            raise InputError(
                f"Depth must be a (frames, height, width) array of uint16 millimetres, got {self.depth.dtype} "
                f"{self.depth.shape}."
            )
        if self.depth.shape[1:] != (self.camera.height, self.camera.width):
            raise InputError(
                f"Images of {self.depth.shape[1:]} px do not belong to a camera of "
                f"{(self.camera.height, self.camera.width)} px (height, width)."
            )
        shapes = {
            "mounts": (self.mounts.shape, (n, 5)),
            "poses": (self.poses.shape, (n, 3)),
            "scene_index": (self.scene_index.shape, (n,)),
            "goals": ((len(self.goals), *self.goals.shape[2:]), (n, 2)),
        }
        for name, (got, wanted) in shapes.items():
            if got != wanted:
                raise InputError(f"Frame set field {name} has shape {got}, expected {wanted} for {n} frames.")
        if self.goals.shape[1] == 0:
            raise InputError("A frame set needs at least one goal for each frame, but goals has none.")
        if not np.isfinite(self.mounts).all() or not np.isfinite(self.goals).all():
            raise InputError("Camera mounts and goals must be finite; remove or repair the frames with NaN values.")
        if self.scene_index.min() < 0 or self.scene_index.max() >= len(self.scene_names):
            raise InputError("scene_index points outside scene_names.")

    def __len__(self) -> int:
        return len(self.depth)

    def depth_metres(self) -> Float32[np.ndarray, "n height width"]:
        """Depth [m]."""
        return self.depth.astype(np.float32) * np.float32(DEPTH_UNIT)

    def select(self, index: Int[np.ndarray, " k"]) -> "FrameSet":
        """The frames at the given indices, in that order."""
        return FrameSet(
            self.depth[index],
            self.mounts[index],
            self.goals[index],
            self.poses[index],
            self.scene_index[index],
            self.scene_names,
            self.camera,
        )


def concatenate(parts: Sequence[FrameSet]) -> FrameSet:
    """One frame set of several, whose scenes keep their names and their order.

    Raises:
        InputError: for no parts, or if their cameras or their numbers of goals differ.
    """
    if not parts:
        raise InputError("There are no frames to put together; give at least one frame set.")
    (camera, goals), *others = [(part.camera, part.goals.shape[1]) for part in parts]
    for other in others:
        if other != (camera, goals):
            raise InputError(
                f"Frames with {goals} goals through {camera} and frames with {other[1]} goals through {other[0]} "
                "cannot be trained on together; make them with the same camera and number of goals."
            )
    first_scene = np.cumsum([0, *(len(part.scene_names) for part in parts[:-1])]).tolist()
    return FrameSet(
        depth=np.concatenate([part.depth for part in parts]),
        mounts=np.concatenate([part.mounts for part in parts]),
        goals=np.concatenate([part.goals for part in parts]),
        poses=np.concatenate([part.poses for part in parts]),
        scene_index=np.concatenate([part.scene_index + first for part, first in zip(parts, first_scene)]),
        scene_names=tuple(name for part in parts for name in part.scene_names),
        camera=camera,
    )


def depth_to_millimetres(depth: Float[np.ndarray, "*shape"]) -> UInt16[np.ndarray, "*shape"]:
    """[mm] of a depth [m]; what is not finite, negative or beyond 65 m becomes 0 (no return)."""
    usable = np.isfinite(depth) & (depth > 0) & (depth < 65.0)
    return np.where(usable, np.round(np.where(usable, depth, 0.0) / DEPTH_UNIT), 0).astype(np.uint16)


def save_frames(frames: FrameSet, file: Path) -> None:
    """Write a frame set to an .npz file with a checksum; it appears only when complete.

    Raises:
        InputError: if it cannot be written; a file that was there before is kept.
    """
    arrays = {name: getattr(frames, name) for name in _ARRAYS}
    texts = {"scene_names": json.dumps(frames.scene_names), "camera": json.dumps(asdict(frames.camera))}
    try:
        write_npz(file, arrays | texts)
    except OSError as error:
        raise InputError(f"Cannot write {file}: {error.strerror}; free some space or choose another folder.") from error


def load_frames(file: Path) -> FrameSet:
    """Read a frame set.

    Raises:
        InputError: if the file is missing, truncated or does not match its checksum.
    """
    again = "run the command again to make it anew"
    advice = f"delete it and {again}"
    try:
        data = read_npz(file)
    except MissingFileError as error:
        raise MissingFileError(f"{error}; {again}.") from error
    except InputError as error:
        raise InputError(f"{error}; {advice}.") from error
    try:
        strange = [name for name in _ARRAYS if data[name].dtype.kind not in "fiu"]
        if strange:
            raise ValueError(f"{strange[0]} holds no real numbers")
        return FrameSet(
            **{name: data[name] for name in _ARRAYS},
            scene_names=tuple(json.loads(str(data["scene_names"]))),
            camera=Intrinsics(**json.loads(str(data["camera"]))),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{file} is not a frame set written by this version ({error}); {advice}.") from error

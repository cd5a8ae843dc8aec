"""Poses over time in a bag: nav_msgs/Odometry, and the tree of frames of tf."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from iwalker_jax.data.recordings.bag.stream import Bag
from iwalker_jax.data.recordings.folder_files import MAX_ROWS
from iwalker_jax.data.recordings.metadata import nearest_in_time, rotation_from_quaternion
from iwalker_jax.errors import InputError

ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
STATIC = "/tf_static"

_BODIES = ("base_footprint", "base_link", "base", "body", "pelvis", "torso")
"""Names of a robot's body, the first that is there."""


class PosesOverTime(NamedTuple):
    """A frame in another, row by row; NaN where it is unknown."""

    R: Float[np.ndarray, "n 3 3"]
    p: Float[np.ndarray, "n 3"]

    def then(self, other: "PosesOverTime") -> "PosesOverTime":
        """The other, which is given in this frame, in the frame that this is given in."""
        return PosesOverTime(self.R @ other.R, self.p + (self.R @ other.p[:, :, None])[:, :, 0])


@dataclass(frozen=True)
class TrackedFrame:
    """A frame whose pose in its parent was recorded again and again.

    Attributes:
        parent: frame that the poses are given in.
        stamps: [s] in order.
        rows: x, y, z [m], qx, qy, qz, qw.
        static: whether the pose is the same at all times.
    """

    parent: str
    stamps: Float[np.ndarray, " m"]
    rows: Float[np.ndarray, "m 7"]
    static: bool

    def at(self, stamps: Float[np.ndarray, " n"]) -> PosesOverTime:
        """The recorded pose nearest in time to each stamp [s]."""
        index = np.full(len(stamps), len(self.rows) - 1) if self.static else nearest_in_time(self.stamps, stamps)
        rows = np.where((index >= 0)[:, None], self.rows[np.maximum(index, 0)], np.nan)
        rotations = [rotation_from_quaternion(row[3:]) for row in rows]
        return PosesOverTime(np.array(rotations).reshape(-1, 3, 3), rows[:, :3])


@dataclass(frozen=True)
class FrameTree:
    """The frames of tf by their names; each is given in its parent."""

    frames: dict[str, TrackedFrame]

    def ancestors(self, frame: str) -> list[str]:
        """The frame itself, its parent, and so on to the root."""
        found = [frame]
        while found[-1] in self.frames and self.frames[found[-1]].parent not in found:
            found.append(self.frames[found[-1]].parent)
        return found

    def pose(self, ancestor: str, frame: str, stamps: Float[np.ndarray, " n"]) -> PosesOverTime | None:
        """The frame in one of its ancestors at each stamp [s]; None if it is none of its ancestors."""
        chain = self.ancestors(frame)
        if ancestor not in chain:
            return None
        n = len(stamps)
        result = PosesOverTime(np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)))
        for name in chain[: chain.index(ancestor)]:
            result = self.frames[name].at(stamps).then(result)
        return result

    def body_of(self, camera: str) -> str:
        """The robot's body among the camera's ancestors: by its name, or else the camera itself."""
        chain = self.ancestors(camera)
        return next((name for name in _BODIES if name in chain), camera)

    def moves(self, ancestor: str, frame: str) -> bool:
        """Whether the frame's pose in one of its ancestors was recorded over time."""
        chain = self.ancestors(frame)
        return any(not self.frames[name].static for name in chain[: chain.index(ancestor)])


def plain_frame(name: str) -> str:
    """A frame's name without the slash that ROS 1 once put before it."""
    return name.lstrip("/")


def stamp_of(header: Any, recorded: int) -> float:
    """[s] at which a message's content was measured; at which it was recorded if it does not say."""
    measured = header.stamp.sec + 1e-9 * header.stamp.nanosec
    return measured if measured > 0 else 1e-9 * recorded


def read_odometry(bag: Bag, topic: str) -> tuple[TrackedFrame, str]:
    """The body's poses, and the name of its frame.

    Raises:
        InputError: for a bag that is damaged, or more poses than are read.
    """
    stamps: list[float] = []
    rows: list[list[float]] = []
    parent, child = "", ""
    for recorded, message in bag.messages(topic):
        if isinstance(message, InputError):
            continue
        _count(len(rows), topic)
        parent, child = plain_frame(message.header.frame_id), plain_frame(message.child_frame_id)
        stamps.append(stamp_of(message.header, recorded))
        pose = message.pose.pose
        rows.append(_row(pose.position, pose.orientation))
    if not rows:
        raise InputError(f"No message of {topic} can be read.")
    return _tracked(parent, stamps, rows, static=False), child


def read_transforms(bag: Bag) -> FrameTree:
    """All frames of the bag's tf topics; one that changes its parent keeps the last.

    Raises:
        InputError: for a bag that is damaged, or more transforms than are read.
    """
    found: dict[tuple[str, str, bool], tuple[list[float], list[list[float]]]] = {}
    for topic in bag.of_type(*TRANSFORMS):
        count = 0
        for recorded, message in bag.messages(topic.name):
            for transform in () if isinstance(message, InputError) else message.transforms:
                count += 1
                _count(count, topic.name)
                child, parent = plain_frame(transform.child_frame_id), plain_frame(transform.header.frame_id)
                stamps, rows = found.setdefault((child, parent, topic.name.endswith(STATIC)), ([], []))
                stamps.append(stamp_of(transform.header, recorded))
                rows.append(_row(transform.transform.translation, transform.transform.rotation))
    return FrameTree({c: _tracked(parent, *table, static) for (c, parent, static), table in found.items()})


def _tracked(parent: str, stamps: list[float], rows: list[list[float]], static: bool) -> TrackedFrame:
    order = np.argsort(stamps, kind="stable")
    return TrackedFrame(parent, np.array(stamps)[order], np.array(rows, float)[order], static)


def _row(position: Any, orientation: Any) -> list[float]:
    return [position.x, position.y, position.z, orientation.x, orientation.y, orientation.z, orientation.w]


def _count(count: int, topic: str) -> None:
    if count > MAX_ROWS:
        raise InputError(f"{topic} has more than {MAX_ROWS} poses; split the recording.")

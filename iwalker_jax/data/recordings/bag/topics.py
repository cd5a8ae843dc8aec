"""Which of a bag's topics are read, and why."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from iwalker_jax.data.recordings.bag.depth_messages import (
    COMPRESSED_IMAGE,
    IMAGE,
    depth_encoding,
    image_size,
    stated_kind,
)
from iwalker_jax.data.recordings.bag.stream import Bag
from iwalker_jax.data.recordings.bag.transforms import ODOMETRY, TRANSFORMS, plain_frame
from iwalker_jax.data.recordings.report import RecordedTopic
from iwalker_jax.errors import InputError
from iwalker_jax.runtime import printable

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
_PACKINGS = ("compressedDepth", "compressed")


@dataclass(frozen=True)
class DepthTopic:
    """A topic with depth images.

    Attributes:
        name: of the topic.
        messages: their number.
        encoding: "16UC1" or "32FC1".
        size: (width, height) [px] of the first image.
        frame: name of the camera's optical frame.
        packed: whether the images are compressed.
        info: topic of the camera's calibration; None without one.
    """

    name: str
    messages: int
    encoding: str
    size: tuple[int, int]
    frame: str
    packed: bool
    info: str | None

    @property
    def rectified(self) -> bool:
        """Whether the images were freed of distortion before they were recorded, which ROS says in the topic's name."""
        return "image_rect" in self.name


@dataclass(frozen=True)
class ChosenTopics:
    """What is read of a bag.

    Attributes:
        depth: topic of the images.
        odometry: topic of the body's poses; None without one.
        listed: every topic of the bag with its use.
    """

    depth: DepthTopic
    odometry: str | None
    listed: list[RecordedTopic]


def choose_topics(bag: Bag, wanted: str | None, scratch: Path) -> ChosenTopics:
    """The topics of a bag that are read.

    Of several depth topics one with a calibration comes first, then one that is not packed, then the one with most
    images, then the first by name. Odometry with most messages is taken.

    Args:
        bag: that is read.
        wanted: depth topic that the user chose; None chooses here.
        scratch: file that may be written and is removed.

    Raises:
        InputError: if there is no depth topic, or not the one wanted.
    """
    uses: dict[str, str] = {}
    infos = {topic.name: bag.first(topic.name) for topic in bag.of_type(CAMERA_INFO)}
    found: list[DepthTopic] = []
    for topic in bag.of_type(IMAGE, COMPRESSED_IMAGE):
        message = bag.first(topic.name)
        encoding = depth_encoding(message)
        if encoding is None:
            uses[topic.name] = f"not used: {stated_kind(message)} is no depth"
            continue
        try:
            size = image_size(message, scratch)
        except InputError as error:
            uses[topic.name] = f"not used: its first image {error}"
            continue
        frame, packed = plain_frame(message.header.frame_id), topic.type == COMPRESSED_IMAGE
        info = _calibration_topic(topic.name, frame, size, infos)
        found.append(DepthTopic(topic.name, topic.messages, encoding, size, frame, packed, info))
    depth, why = _chosen(found, wanted, [replace(topic, use=uses.get(topic.name, "")) for topic in bag.topics])
    for other in found:
        uses[other.name] = "depth, not used (--topic chooses it)"
    uses[depth.name] = f"depth ({depth.encoding}): {why}"
    if depth.info is not None:
        uses[depth.info] = "calibration of the depth images"
    odometry = max(bag.of_type(ODOMETRY), key=lambda topic: topic.messages, default=None)
    if odometry is not None:
        uses[odometry.name] = "poses of the body"
    uses |= {topic.name: "frames" for topic in bag.of_type(*TRANSFORMS)}
    listed = [replace(topic, use=uses.get(topic.name, "not used")) for topic in bag.topics]
    return ChosenTopics(depth, None if odometry is None else odometry.name, listed)


def expected_calibration(depth: str) -> str:
    """The topic on which ROS publishes the calibration of an image topic: camera_info beside it."""
    parts = depth.rstrip("/").split("/")
    if parts[-1] in _PACKINGS:
        parts.pop()
    return "/".join([*parts[:-1], "camera_info"])


def _calibration_topic(depth: str, frame: str, size: tuple[int, int], infos: dict[str, Any]) -> str | None:
    """The calibration beside the images, or the only one of their size and frame."""
    beside = expected_calibration(depth)
    if beside in infos:
        return beside
    same = [
        name
        for name, info in infos.items()
        if (info.width, info.height) == size and plain_frame(info.header.frame_id) == frame
    ]
    return same[0] if len(same) == 1 else None


def _chosen(found: list[DepthTopic], wanted: str | None, listed: list[RecordedTopic]) -> tuple[DepthTopic, str]:
    """(depth topic, why it is the one)."""
    if wanted is not None:
        for topic in found:
            if topic.name.strip("/") == wanted.strip("/"):
                return topic, "chosen by you"
        there = ", ".join(printable(topic.name) for topic in found) or "none"
        raise InputError(f"It has no depth topic {printable(repr(wanted))}; its depth topics: {there}.")
    if not found:
        there = "; ".join(
            f"{printable(topic.name)} ({topic.type.split('/')[-1]}, {topic.messages} messages"
            + (f", {topic.use}" if topic.use else "")
            + ")"
            for topic in listed[:20]
        )
        raise InputError(
            "It has no topic with depth images (sensor_msgs/Image in 16UC1 or 32FC1, or CompressedImage by "
            f"compressedDepth); its topics: {there or 'none, it is empty'}."
        )
    best = min(found, key=lambda topic: (topic.info is None, topic.packed, -topic.messages, topic.name))
    if len(found) == 1:
        return best, "the only depth topic"
    others = [topic for topic in found if topic is not best]
    if best.info is not None and all(topic.info is None for topic in others):
        return best, f"the only one of {len(found)} depth topics with a calibration"
    if not best.packed and all(topic.packed for topic in others):
        return best, f"the only one of {len(found)} depth topics that is not packed"
    return (
        best,
        f"of {len(found)} depth topics the one with calibration, not packed, with most images, and first by name",
    )

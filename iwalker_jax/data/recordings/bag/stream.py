"""Messages of a bag by the package `rosbags`, whose errors become sentences."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from iwalker_jax.data.recordings.report import RecordedTopic
from iwalker_jax.errors import InputError
from iwalker_jax.runtime import printable


class Bag:
    """An opened bag.

    Attributes:
        topics: name, type and number of messages of each, in the order of their names.
    """

    def __init__(self, reader: Any):
        self._reader = reader
        self.topics = [
            RecordedTopic(name, info.msgtype or "several types", info.msgcount)
            for name, info in sorted(reader.topics.items())
        ]

    def of_type(self, *types: str) -> list[RecordedTopic]:
        """Topics with messages of one of the types."""
        return [topic for topic in self.topics if topic.type in types and topic.messages]

    def first(self, topic: str) -> Any:
        """The first message of a topic.

        Raises:
            InputError: if it cannot be read.
        """
        for _, message in self.messages(topic):
            if isinstance(message, InputError):
                raise InputError(f"The first message of {printable(topic)} {message}")
            return message
        raise InputError(f"{printable(topic)} has no messages.")

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """(time at which it was recorded [ns], message) of a topic in order; a message that is damaged is its error.

        Raises:
            InputError: if the bag ends in the middle, or is damaged.
        """
        connections = [connection for connection in self._reader.connections if connection.topic == topic]
        stream = self._reader.messages(connections=connections)
        while True:
            try:
                connection, stamp, content = next(stream)
            except StopIteration:
                return
            except Exception as error:  # its storage libraries have no common error
                raise _unreadable(error) from None
            try:
                message = self._reader.deserialize(content, connection.msgtype)
            except Exception:  # whatever a parser runs into when the bytes are not what they should be
                message = InputError("is damaged (it is not of its topic's type).")
            yield stamp, message


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """A bag, open for reading.

    Args:
        path: a .bag file of ROS 1, a folder of ROS 2 with metadata.yaml, or one .mcap or .db3 file.

    Raises:
        InputError: if the package `rosbags` is not installed, or the bag is damaged, truncated or none.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError(
            "It is a bag, and bags are read by the package rosbags, which is not installed; run `pip install "
            "'iwalker-jax[ros]'`."
        ) from None
    try:
        # Bags of older ROS 2 do not hold the definitions of their messages; those used here have not changed since.
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    except Exception as error:  # its storage libraries have no common error
        raise _unreadable(error) from None
    try:
        yield Bag(reader)
    finally:
        with suppress(Exception):
            reader.close()


def _unreadable(error: Exception) -> InputError:
    lines = str(error).strip().splitlines()
    reason = printable(lines[0] if lines else type(error).__name__, 120).rstrip(".")
    return InputError(
        f"It cannot be read as a bag ({reason}); if its recording was cut short, repair it with `rosbag reindex` or "
        "`ros2 bag reindex`, otherwise copy or record it again."
    )

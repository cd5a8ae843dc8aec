"""The messages between robot, controller and planner: a header of 32 bytes, then arrays of fixed size, little-endian.

A message is one datagram of a Unix socket. Names, types and shapes of its arrays follow from the policy's manifest;
truth values take one byte each.
"""

import struct
import time
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

MAGIC = b"IWLK"
VERSION = 1

HEADER = struct.Struct("<4sHHIxxxxqq")
"""Magic, version, kind, bytes of the arrays, 4 of padding, number, monotonic time of sending [ns]."""

Arrays = dict[str, Any]


class Kind(IntEnum):
    """What a message is."""

    STATE = 1
    """Robot to controller, every tick."""
    TORQUES = 2
    """Controller to robot, the answer; its number is that of the state."""
    IMAGE = 3
    """Robot to planner, every camera frame."""
    BODY = 4
    """Controller to planner, every few ticks: state, step clock and footsteps under way."""
    COMMAND = 5
    """Planner to controller, the answer: footsteps, new or not."""
    SEEN = 6
    """Planner to robot: the image of this number has been planned on."""


class Header(NamedTuple):
    """What a message says of itself.

    Attributes:
        kind: of the message.
        number: counted by the sender of what it answers.
        sent: [ns] on the machine's monotonic clock.
    """

    kind: Kind
    number: int
    sent: int


class MessageError(ValueError):
    """Bytes that are none of our messages; says why."""


class MessageLayout:
    """The arrays of one kind of message, in order."""

    def __init__(self, kind: Kind, fields: Mapping[str, tuple[str, tuple[int, ...]]]) -> None:
        """Lay out arrays of names, types and shapes."""
        self.kind = kind
        self.fields = {
            name: (np.dtype("u1" if dtype == "bool" else dtype).newbyteorder("<"), dtype == "bool", tuple(shape))
            for name, (dtype, shape) in fields.items()
        }
        self.size = sum(dtype.itemsize * int(np.prod(shape)) for dtype, _, shape in self.fields.values())

    def pack(self, number: int, arrays: Mapping[str, Any]) -> bytes:
        """The message of a number with these arrays, sent now."""
        parts = [HEADER.pack(MAGIC, VERSION, self.kind, self.size, number, time.monotonic_ns())]
        for name, (dtype, _, shape) in self.fields.items():
            array = np.asarray(arrays[name])
            if array.shape != shape:
                raise MessageError(f"{name} of a {self.kind.name} message is of shape {array.shape}; give {shape}.")
            parts.append(array.astype(dtype, copy=False).tobytes())
        return b"".join(parts)

    def unpack(self, content: bytes) -> Arrays:
        """The arrays of a message whose header has been read."""
        arrays: Arrays = {}
        at = HEADER.size
        for name, (dtype, truth, shape) in self.fields.items():
            count = int(np.prod(shape))
            array = np.frombuffer(content, dtype, count, at).reshape(shape)
            arrays[name] = array.astype(bool) if truth else array
            at += dtype.itemsize * count
        return arrays


def read_header(content: bytes, layouts: Mapping[Kind, MessageLayout]) -> Header:
    """Who speaks of what.

    Raises:
        MessageError: for bytes that are no message of this version and size.
    """
    if len(content) < HEADER.size:
        raise MessageError(f"A message of {len(content)} bytes is shorter than its header.")
    magic, version, kind, size, number, sent = HEADER.unpack_from(content)
    if magic != MAGIC or version != VERSION:
        raise MessageError(f"A message begins with {magic!r}, version {version}; this is {MAGIC!r}, version {VERSION}.")
    if kind not in set(layouts) or size != layouts[Kind(kind)].size or len(content) != HEADER.size + size:
        raise MessageError(f"A message of kind {kind} has {len(content) - HEADER.size} bytes of arrays, of {size}.")
    return Header(Kind(kind), number, sent)


def layouts_of(manifest: Mapping[str, Any]) -> dict[Kind, MessageLayout]:
    """The layouts of all kinds of messages of an exported policy."""
    functions = manifest["functions"]
    control, frame = functions["control"], functions["frame"]
    footsteps = functions["footsteps"]["inputs"]

    def of(entries: Mapping[str, Any], *names: str) -> dict[str, tuple[str, tuple[int, ...]]]:
        chosen = names or tuple(entries)
        return {name: (entries[name]["dtype"], tuple(entries[name]["shape"])) for name in chosen}

    state = of(control["inputs"], "qpos", "qvel", "touching")
    command = {name: entry for name, entry in control["inputs"].items() if name.startswith("command.")}
    body = {name: entry for name, entry in footsteps.items() if name.startswith(("clock.", "plan.", "stopping"))}
    touchdowns = of(control["inputs"], "memory.touchdowns")
    halted = {"halted": ("bool", ())}
    fields = {
        Kind.STATE: state,
        Kind.TORQUES: of(control["outputs"], "torques", "clock.mode", "fallen") | halted,
        Kind.IMAGE: of(frame["inputs"], "depth", "image.qpos", "image.qvel", "time"),
        Kind.BODY: state | of(body) | touchdowns,
        Kind.COMMAND: of(command),
        Kind.SEEN: {},
    }
    return {kind: MessageLayout(kind, entries) for kind, entries in fields.items()}

"""Unix datagram sockets by name in a folder: nothing leaves the machine, and a peer that is gone disturbs nobody."""

import contextlib
import select
import socket
from collections.abc import Mapping
from pathlib import Path

from iwalker_jax.deployment.live.messages import Arrays, Header, Kind, MessageError, MessageLayout, read_header

ROBOT, CONTROLLER, PLANNER = "robot", "controller", "planner"
"""Names of the three peers, and of their sockets."""

_BUFFER = 1 << 20  # [bytes] of a socket's queue


class Peer:
    """One of the three: receives at its own name, sends to the others'."""

    def __init__(self, place: Path, name: str, layouts: Mapping[Kind, MessageLayout]) -> None:
        """Bind to a name; whoever had it before has gone."""
        self._place, self._layouts = place, layouts
        self._largest = max(layout.size for layout in layouts.values()) + 64
        self.refused = 0
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        self._socket.setblocking(False)
        (place / name).unlink(missing_ok=True)
        self._socket.bind(str(place / name))

    def send(self, name: str, kind: Kind, number: int, arrays: Arrays) -> bool:
        """Send a message; False if nobody is there or its queue is full, and then it is lost."""
        try:
            self._socket.sendto(self._layouts[kind].pack(number, arrays), str(self._place / name))
        except OSError:
            return False
        return True

    def receive(self, timeout: float) -> list[tuple[Header, Arrays]]:
        """All messages that are there, oldest first; waits up to a time [s] for the first. Others are only counted."""
        select.select([self._socket], [], [], max(timeout, 0.0))
        messages: list[tuple[Header, Arrays]] = []
        with contextlib.suppress(BlockingIOError):
            while True:
                content = self._socket.recv(self._largest)
                try:
                    header = read_header(content, self._layouts)
                except MessageError:
                    self.refused += 1
                    continue
                messages.append((header, self._layouts[header.kind].unpack(content)))
        return messages

    def close(self) -> None:
        """Leave; the name is free again."""
        self._socket.close()


def newest(messages: list[tuple[Header, Arrays]], kind: Kind) -> tuple[Header, Arrays] | None:
    """The last message of a kind, or None."""
    return next((message for message in reversed(messages) if message[0].kind == kind), None)

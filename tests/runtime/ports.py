"""Ports for tests that talk to other processes."""

import socket


def free_port() -> int:
    """A port that nobody listens at."""
    with socket.socket() as held:
        held.bind(("", 0))
        return held.getsockname()[1]

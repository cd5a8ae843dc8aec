"""Processes find each other before JAX connects them: JAX ends a process without a word if another one is missing."""

import socket
import time
from typing import NamedTuple

from iwalker_jax.errors import InputError

_GO, _HELLO_TIME, _RETRY_TIME = b"go", 5.0, 0.2  # [s]


class Member(NamedTuple):
    """One process of a group.

    Attributes:
        host, port: where process 0 listens.
        process: number of this one; processes: how many there are.
        timeout: [s] that they wait for each other.
    """

    host: str
    port: int
    process: int
    processes: int
    timeout: float


def rendezvous(member: Member) -> None:
    """Return once all processes are there; process 0 calls the roll at its port, the others answer.

    Raises:
        InputError: if processes are missing, contradict each other, or cannot reach process 0.
    """
    deadline = time.monotonic() + member.timeout
    if member.process == 0:
        _call(member, deadline)
    else:
        _answer(member, deadline)


def bind_address(port: int) -> str:
    """HOST:PORT that stands for all of this machine's own addresses."""
    return f"[::]:{port}" if socket.has_dualstack_ipv6() else f"0.0.0.0:{port}"


def _call(member: Member, deadline: float) -> None:
    dual = socket.has_dualstack_ipv6()
    family = socket.AF_INET6 if dual else socket.AF_INET
    try:
        server = socket.create_server(("", member.port), family=family, dualstack_ipv6=dual)
    except OSError as error:
        raise InputError(
            f"Port {member.port} cannot be used on this machine ({error.strerror}); give --coordinator another one."
        ) from error
    present: dict[int, socket.socket] = {}
    try:
        with server:
            while len(present) < member.processes - 1:
                server.settimeout(_left(deadline))
                peer, _ = server.accept()
                number = _number_of(peer, member.processes)
                # A process that was started again takes the place of the earlier one.
                earlier = peer if number is None else present.get(number)
                if earlier is not None:
                    earlier.close()
                if number is not None:
                    present[number] = peer
        for peer in present.values():
            peer.sendall(_GO)
    except OSError as error:
        absent = ", ".join(str(k) for k in range(1, member.processes) if k not in present)
        raise InputError(
            f"Of {member.processes} processes, {absent or 'one'} did not come to port {member.port} within "
            f"{member.timeout:g} s; start all of them with the same --coordinator and --processes."
        ) from error
    finally:
        for peer in present.values():
            peer.close()


def _number_of(peer: socket.socket, processes: int) -> int | None:
    """The number that a process says it has; None for a stranger, or a process of another group."""
    peer.settimeout(_HELLO_TIME)
    try:
        words = peer.recv(64).split()
    except OSError:
        return None
    if len(words) != 2 or not all(word.isdigit() for word in words):
        return None
    number, group = (int(word) for word in words)
    return number if group == processes and 1 <= number < processes else None


def _answer(member: Member, deadline: float) -> None:
    with _connected(member, deadline) as peer:
        try:
            peer.sendall(b"%d %d" % (member.process, member.processes))
            peer.settimeout(_left(deadline))
            heard = peer.recv(len(_GO))
        except TimeoutError as error:
            raise InputError(
                f"Process 0 still waits for others after {member.timeout:g} s; start all {member.processes} processes."
            ) from error
        except OSError:
            heard = b""
    if heard != _GO:
        raise InputError(
            f"Process 0 at {member.host}:{member.port} has ended or has no place for process {member.process} of "
            f"{member.processes}; give each process its own --process, and all the same --processes."
        )


def _connected(member: Member, deadline: float) -> socket.socket:
    while True:
        try:
            return socket.create_connection((member.host, member.port), _left(deadline))
        except OSError as error:
            if time.monotonic() + _RETRY_TIME > deadline:
                raise InputError(
                    f"No process 0 was found at {member.host}:{member.port} within {member.timeout:g} s "
                    f"({error.strerror or 'no answer'}); start it, at an address that this machine can reach."
                ) from error
            time.sleep(_RETRY_TIME)


def _left(deadline: float) -> float:
    """[s] until the deadline; never 0, which would mean not to wait at all."""
    return max(deadline - time.monotonic(), 1e-3)

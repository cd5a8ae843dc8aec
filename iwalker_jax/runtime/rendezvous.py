"""Processes find each other before JAX connects them: JAX ends a process without a word if another one is missing."""

import socket
import time
from typing import NamedTuple

from iwalker_jax.errors import InputError

_GO, _HELLO_TIME, _RETRY_TIME = b"go", 5.0, 0.2  # [s]


class DistributedProcess(NamedTuple):
    """One process of a group.

    Attributes:
        host, port: where process 0 listens.
        process_id: number of this one, from 0; num_processes: how many there are.
        timeout: [s] that they wait for each other.
    """

    host: str
    port: int
    process_id: int
    num_processes: int
    timeout: float


def rendezvous(own: DistributedProcess) -> None:
    """Return once all processes are there; process 0 counts them at its port, where the others report.

    Raises:
        InputError: if processes are missing, contradict each other, or cannot reach process 0.
    """
    deadline = time.monotonic() + own.timeout
    if own.process_id == 0:
        _gather(own, deadline)
    else:
        _report(own, deadline)


def bind_address(host: str, port: int) -> str:
    """HOST:PORT at which process 0 listens: the coordinator's own address, so that `localhost` is nobody else's.

    All addresses of this machine only where the host is a name or address that others reach it by and that it does not
    have itself, as behind a translating router.
    """
    family, address = _own_address(host)
    return f"[{address}]:{port}" if family == socket.AF_INET6 else f"{address}:{port}"


def _own_address(host: str) -> tuple[int, str]:
    """Family and address of the coordinator's host on this machine."""
    try:
        found = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except OSError:
        found = []
    # JAX's and this module's clients try IPv4 first where a name has both.
    for family, _, _, _, address in sorted(found, key=lambda entry: entry[0] != socket.AF_INET):
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            try:
                probe.bind((address[0], 0))
            except OSError:
                continue
            return family, str(address[0])
    return (socket.AF_INET6, "::") if socket.has_dualstack_ipv6() else (socket.AF_INET, "0.0.0.0")


def _gather(own: DistributedProcess, deadline: float) -> None:
    family, address = _own_address(own.host)
    try:
        server = socket.create_server((address, own.port), family=family, dualstack_ipv6=address == "::")
    except OSError as error:
        raise InputError(
            f"Port {own.port} cannot be used on this machine ({error.strerror}); give --coordinator another one."
        ) from error
    present: dict[int, socket.socket] = {}
    try:
        with server:
            while len(present) < own.num_processes - 1:
                server.settimeout(_left(deadline))
                peer, _ = server.accept()
                number = _index_of(peer, own.num_processes)
                # A process that was started again takes the place of the earlier one.
                earlier = peer if number is None else present.get(number)
                if earlier is not None:
                    earlier.close()
                if number is not None:
                    present[number] = peer
        for peer in present.values():
            peer.sendall(_GO)
    except OSError as error:
        absent = ", ".join(str(k) for k in range(1, own.num_processes) if k not in present)
        raise InputError(
            f"Of {own.num_processes} processes, {absent or 'one'} did not come to port {own.port} within "
            f"{own.timeout:g} s; start all of them with the same --coordinator and --processes."
        ) from error
    finally:
        for peer in present.values():
            peer.close()


def _index_of(peer: socket.socket, processes: int) -> int | None:
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


def _report(own: DistributedProcess, deadline: float) -> None:
    with _connected(own, deadline) as peer:
        try:
            peer.sendall(b"%d %d" % (own.process_id, own.num_processes))
            peer.settimeout(_left(deadline))
            heard = peer.recv(len(_GO))
        except TimeoutError as error:
            raise InputError(
                f"Process 0 still waits for others after {own.timeout:g} s; start all {own.num_processes} processes."
            ) from error
        except OSError:
            heard = b""
    if heard != _GO:
        raise InputError(
            f"Process 0 at {own.host}:{own.port} has ended or has no place for process {own.process_id} of "
            f"{own.num_processes}; give each process its own --process, and all the same --processes."
        )


def _connected(own: DistributedProcess, deadline: float) -> socket.socket:
    while True:
        try:
            return socket.create_connection((own.host, own.port), _left(deadline))
        except OSError as error:
            if time.monotonic() + _RETRY_TIME > deadline:
                raise InputError(
                    f"No process 0 was found at {own.host}:{own.port} within {own.timeout:g} s "
                    f"({error.strerror or 'no answer'}); start it, at an address that this machine can reach."
                ) from error
            time.sleep(_RETRY_TIME)


def _left(deadline: float) -> float:
    """[s] until the deadline; never 0, which would mean not to wait at all."""
    return max(deadline - time.monotonic(), 1e-3)

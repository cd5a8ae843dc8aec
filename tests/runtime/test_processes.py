"""How processes come together: options, and the rendezvous with everyone there and with someone missing."""

import socket
import threading

import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.runtime.processes import ProcessGroup
from iwalker_jax.runtime.rendezvous import DistributedProcess, bind_address, rendezvous
from tests.runtime.ports import free_port


def test_options_win_over_the_environment():
    environment = {"IWALKER_COORDINATOR": "far:1", "IWALKER_PROCESSES": "4", "IWALKER_PROCESS": "3"}
    assert ProcessGroup().this_process({}) is None
    assert ProcessGroup().this_process(environment) == DistributedProcess("far", 1, 3, 4, 300.0)
    assert ProcessGroup("[::1]:8476", process=0, join_timeout=5.0).this_process(environment) == DistributedProcess(
        "::1", 8476, 0, 4, 5
    )


@pytest.mark.parametrize(
    ("options", "environment", "words"),
    [
        ({"coordinator": "a:1"}, {}, "give also --processes N and --process K"),
        ({"coordinator": "a:1", "processes": 2, "process": 2}, {}, "no process 2 of 2"),
        ({"coordinator": "a:1", "processes": 2, "process": -1}, {}, "no process -1 of 2"),
        ({"coordinator": "a:1", "processes": 0, "process": 0}, {}, "no process 0 of 0"),
        ({"coordinator": "a", "processes": 2, "process": 0}, {}, "HOST:PORT"),
        ({"coordinator": "a:99999", "processes": 2, "process": 0}, {}, "HOST:PORT"),
        ({"coordinator": "a:1", "process": 0}, {"IWALKER_PROCESSES": "two"}, "IWALKER_PROCESSES is 'two'"),
        ({"coordinator": "a:1", "processes": 2, "process": 0, "join_timeout": float("nan")}, {}, "positive time"),
    ],
)
def test_bad_options(options, environment, words):
    with pytest.raises(InputError, match=words):
        ProcessGroup(**options).this_process(environment)


def rendezvous_of(*processes: DistributedProcess) -> list[str]:
    """What each process hears: an error's sentence, or nothing."""
    heard = [""] * len(processes)

    def answer(k: int) -> None:
        try:
            rendezvous(processes[k])
        except InputError as error:
            heard[k] = str(error)

    threads = [threading.Thread(target=answer, args=(k,), daemon=True) for k in range(len(processes))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
        assert not thread.is_alive()
    return heard


def test_everyone_goes_on_once_all_are_there():
    port = free_port()
    assert rendezvous_of(*(DistributedProcess("localhost", port, k, 3, 15) for k in (2, 0, 1))) == ["", "", ""]


@pytest.mark.parametrize(
    ("answers", "calls_out", "others"),
    [
        ((), "1 did not come", ()),
        (((1, 3),), "1 did not come", ("no place for process 1 of 3",)),
        (((1, 1),), "1 did not come", ("no place for process 1 of 1",)),
    ],
)
def test_who_is_missing_is_said(answers, calls_out, others):
    port = free_port()
    processes = [
        DistributedProcess("localhost", port, 0, 2, 1),
        *(DistributedProcess("localhost", port, *answer, 1) for answer in answers),
    ]
    first, *rest = rendezvous_of(*processes)
    assert calls_out in first
    assert all(words in sentence for words, sentence in zip(others, rest, strict=True))


def test_a_coordinator_that_is_not_there_is_said():
    (sentence,) = rendezvous_of(DistributedProcess("localhost", free_port(), 1, 2, 0.5))
    assert "No process 0 was found" in sentence


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1"])
def test_a_coordinator_at_the_loopback_is_reached_from_nowhere_else(host):
    """Oracle: what a client finds at the machine's other addresses while process 0 waits; there may be none."""
    if host == "::1" and not socket.has_dualstack_ipv6():
        pytest.skip("no IPv6 here")
    port = free_port()
    assert bind_address(host, port) in (f"127.0.0.1:{port}", f"[::1]:{port}")
    others = {str(entry[4][0]) for entry in socket.getaddrinfo(socket.gethostname(), None)} - {"127.0.0.1", "::1"}
    found = []

    def knock() -> None:
        for address in others:
            try:
                socket.create_connection((address, port), 0.3).close()
            except OSError:
                continue
            found.append(address)

    thread = threading.Timer(0.2, knock)
    thread.start()
    (sentence,) = rendezvous_of(DistributedProcess(host, port, 0, 2, 1.0))
    thread.join()
    assert "did not come" in sentence and found == []


def test_an_address_that_this_machine_does_not_have_means_all_of_its_own():
    assert bind_address("192.0.2.1", 5) in ("[::]:5", "0.0.0.0:5")


def test_a_port_in_use_is_said():
    with socket.create_server(("", 0)) as taken:
        (sentence,) = rendezvous_of(DistributedProcess("localhost", taken.getsockname()[1], 0, 2, 0.5))
    assert "cannot be used" in sentence

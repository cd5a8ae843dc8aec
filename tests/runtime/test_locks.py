"""Locks: another process is kept out while this one holds a place, and a dead one leaves none behind."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.runtime.locks import exclusive

HOLDS = """
import sys
from pathlib import Path
from iwalker_jax.runtime.locks import exclusive

with exclusive(Path(sys.argv[1]), Path("the run")):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path):
    """Another process that holds the lock until its input ends."""
    root = Path(__file__).resolve().parents[2]
    command = [sys.executable, "-c", HOLDS, str(tmp_path / "run" / ".lock")]
    with subprocess.Popen(command, cwd=root, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_another_process_is_refused_with_a_sentence_until_the_first_has_ended(holder, tmp_path):
    lock = tmp_path / "run" / ".lock"
    in_use = rf"^the run is in use by process {holder.pid} on .*; wait until"
    with pytest.raises(InputError, match=in_use) as caught, exclusive(lock, Path("the run")):
        pytest.fail("two at once")
    assert "\n" not in str(caught.value)
    holder.communicate("")
    with exclusive(lock, Path("the run")):
        assert str(os.getpid()) in lock.read_text()
    assert not lock.exists()


def test_a_killed_process_leaves_no_lock_behind(holder, tmp_path):
    """It had no time to remove the file; the system has given the lock back all the same."""
    lock = tmp_path / "run" / ".lock"
    holder.send_signal(signal.SIGKILL)
    holder.wait(10)
    assert lock.exists()
    with exclusive(lock, Path("the run")):
        pass
    assert not lock.exists()


def test_one_process_may_ask_twice(tmp_path):
    """A command holds its folder while the training that it calls asks for it too."""
    lock = tmp_path / ".lock"
    with exclusive(lock, tmp_path):
        with exclusive(lock, tmp_path):
            pass
        assert lock.exists()
    assert not lock.exists()

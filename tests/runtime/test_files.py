"""Files that the product writes: whole or not there, checked on what is on the disk after a write was cut short."""

import errno
import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.runtime.files import atomic_write, read_npz, write_csv, write_json, write_npz, write_text

KILLED = """
import os, signal, sys
from pathlib import Path
from iwalker_jax.runtime.files import atomic_write

with atomic_write(Path(sys.argv[1])) as part, part.open("w") as stream:
    stream.write("half of what was to be wri")
    stream.flush()
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("before", [None, "the old content"])
def test_a_killed_writer_leaves_what_was_there(tmp_path, before):
    """A process that dies by SIGKILL between the first byte and the last leaves the old file, or none."""
    file = tmp_path / "figures.json"
    if before is not None:
        file.write_text(before)
    root = Path(__file__).resolve().parents[2]
    killed = subprocess.run([sys.executable, "-c", KILLED, str(file)], cwd=root, timeout=120)
    assert killed.returncode == -signal.SIGKILL
    assert (file.read_text() if file.exists() else None) == before
    # The rest of the killed process is in nobody's way, and the next writer clears it.
    write_text(file, "the new content")
    assert file.read_text() == "the new content"
    assert list(tmp_path.iterdir()) == [file]


def test_a_writer_that_raises_leaves_what_was_there(tmp_path):
    file = tmp_path / "table.csv"
    file.write_text("old")
    with pytest.raises(RuntimeError, match="stopped"), atomic_write(file) as part:
        part.write_text("new")
        raise RuntimeError("stopped")
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_the_content_is_on_the_disk_before_the_file_gets_its_name(tmp_path, monkeypatch):
    """The order of the system's calls: a sync of the part, and only then the renaming."""
    order = []
    sync, replace = os.fsync, Path.replace
    monkeypatch.setattr(os, "fsync", lambda number: (order.append("fsync"), sync(number)))
    monkeypatch.setattr(Path, "replace", lambda self, to: (order.append("replace"), replace(self, to))[1])
    write_text(tmp_path / "page.html", "whole")
    assert order == ["fsync", "replace"]


def test_a_disk_that_fills_up_at_the_end_keeps_the_old_file(tmp_path, monkeypatch):
    """What only the sync reports must not be taken for written."""
    file = tmp_path / "page.html"
    file.write_text("old")

    def full(number: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_text(file, "new")
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_every_kind_of_file_reads_back(tmp_path):
    """Oracle: the standard library's and NumPy's own readers."""
    folder = tmp_path / "new" / "folders"
    write_json(folder / "a.json", {"speed": 0.1, "none": None})
    assert json.loads((folder / "a.json").read_text()) == {"speed": 0.1, "none": None}
    write_csv(folder / "a.csv", [["name", "value"], ["a, b", 1 / 3]])
    assert (folder / "a.csv").read_bytes().decode() == f'name,value\r\n"a, b",{1 / 3!r}\r\n'
    write_npz(folder / "a.npz", {"x": np.arange(3), "y": 2.5})
    with np.load(folder / "a.npz") as stored:
        np.testing.assert_array_equal(stored["x"], [0, 1, 2])
        assert stored["y"] == 2.5
    assert sorted(file.name for file in folder.iterdir()) == ["a.csv", "a.json", "a.npz"]


def test_objects_are_no_arrays(tmp_path):
    """A file that only pickle could read is not written."""
    with pytest.raises(ValueError, match="pickle"):
        write_npz(tmp_path / "a.npz", {"x": np.array([{}], object)})
    assert list(tmp_path.iterdir()) == []


def test_flipped_bits_are_noticed_or_harmless(tmp_path):
    """Oracle: the arrays that were written. 300 single bits, anywhere in the file; many lie in fields of the archive
    that say nothing, such as dates."""
    arrays = {"weights": np.linspace(0, 1, 40, dtype=np.float16).reshape(8, 5), "config": np.array('{"seed": 0}')}
    file = tmp_path / "a.npz"
    write_npz(file, arrays)
    content = file.read_bytes()
    noticed = 0
    for bit in np.random.default_rng(0).integers(0, 8 * len(content), 300):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << (bit % 8)
        file.write_bytes(bytes(damaged))
        try:
            found = read_npz(file)
        except InputError as error:
            assert str(file) in str(error) and "\n" not in str(error)
            noticed += 1
            continue
        assert list(found) == list(arrays)
        for name, array in arrays.items():
            assert found[name].dtype == array.dtype
            np.testing.assert_array_equal(found[name], array)
    assert noticed > 150


def test_edited_arrays_are_noticed(tmp_path):
    """NumPy's own writer gives the edited file an archive that is whole."""
    file = tmp_path / "a.npz"
    write_npz(file, {"x": np.zeros(3)})
    with np.load(file) as stored:
        checksum = stored["sha256"]
    np.savez(file, x=np.array([0.0, 0.0, 1.0]), sha256=checksum)
    with pytest.raises(InputError, match="does not match its checksum"):
        read_npz(file)
    np.savez(file, x=np.zeros(3))
    with pytest.raises(InputError, match="no checksum"):
        read_npz(file)
    assert list(read_npz(file, foreign=True)) == ["x"]


def test_an_error_of_the_disk_names_the_file(tmp_path, monkeypatch):
    def full(number: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as caught:
        write_text(tmp_path / "page.html", "new")
    assert caught.value.filename == str(tmp_path / "page.html")


def test_two_that_write_one_file_take_turns(tmp_path):
    """By construction: the second begins while the first is half done; the file is never half written, and the last
    writer's content stays."""
    file, seen = tmp_path / "a.txt", []

    def second() -> None:
        with atomic_write(file) as part:
            seen.append(file.read_text())
            part.write_text("second")

    with atomic_write(file) as part:
        part.write_text("fir")
        thread = threading.Thread(target=second)
        thread.start()
        thread.join(0.2)
        assert thread.is_alive() and not file.exists()
        part.write_text("first")
    thread.join(10)
    assert seen == ["first"] and file.read_text() == "second"
    assert list(tmp_path.iterdir()) == [file]

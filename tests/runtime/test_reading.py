"""Files of others: what is no regular file is not opened, what is too large not read, marks are what they say."""

import codecs
import os
from pathlib import Path

import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.runtime import printable, read_bytes, read_text


@pytest.mark.parametrize("encoded", [b"", codecs.BOM_UTF8, codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE])
def test_byte_order_marks_are_left_out(tmp_path, encoded):
    """Oracle: Python's codecs."""
    codec = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}.get(encoded, "utf-8")
    (tmp_path / "a.txt").write_bytes(encoded + "é 1\n".encode(codec))
    assert read_text(tmp_path / "a.txt", 100) == "é 1\n"


def test_what_cannot_be_read_is_said(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").write_bytes(bytes(11))
    (tmp_path / "latin").write_bytes(b"caf\xe9")
    for name, words in {"pipe": "regular file", "large": "larger than", "latin": "UTF-8", "absent": "missing"}.items():
        with pytest.raises(InputError, match=words):
            read_text(tmp_path / name, 10)
    for name in (tmp_path, Path("/dev/zero")):
        with pytest.raises(InputError, match="regular file"):
            read_bytes(name, 10)
    with pytest.raises(InputError, match="NUL"):
        read_text(tmp_path / "large", 11)
    with pytest.raises(InputError, match="no file's name"):
        read_bytes(Path("a\0b"), 10)


def test_printable_holds_nothing_that_a_terminal_acts_on():
    assert printable("a\x1b[2J\n\udcff") == "a\\x1b[2J\\n\\udcff"
    assert len(printable("x" * 1000, 50)) == 50

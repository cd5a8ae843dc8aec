"""Files that others wrote, read within limits: only regular ones, not larger than expected, text in UTF-8 or UTF-16."""

import codecs
import stat
from pathlib import Path

from iwalker_jax.errors import InputError, MissingFileError

MOST_TEXT = 16 * 1024 * 1024
"""[bytes] of a table or list that is read into memory whole."""

_MARKS = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}


def read_bytes(file: Path, most: int) -> bytes:
    """Content of a regular file of at most so many bytes; pipes, sockets and devices are never opened.

    Raises:
        InputError: saying what is wrong in words that follow the file's name; a `MissingFileError` if there is none.
    """
    try:
        status = file.stat()
        regular = stat.S_ISREG(status.st_mode)
        content = b""
        if regular:
            with file.open("rb") as stream:
                # As much memory is taken as is asked for; some files of the system say that they are empty.
                content = stream.read(min(most, max(status.st_size, MOST_TEXT)) + 1)
    except FileNotFoundError:
        raise MissingFileError("is missing.") from None
    except ValueError:
        raise InputError("is no file's name.") from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror}).") from None
    if not regular:
        raise InputError("is a folder, pipe, socket or device; it must be a regular file.")
    if len(content) > most:
        raise InputError(f"is larger than {most / 1e6:g} MB, the most that is read of such a file.")
    return content


def read_text(file: Path, most: int = MOST_TEXT) -> str:
    """Text of a file as `read_bytes`; a byte order mark is taken for what it says and left out.

    Raises:
        InputError: as `read_bytes`, and for what is not text.
    """
    content = read_bytes(file, most)
    mark, encoding = next(((m, e) for m, e in _MARKS.items() if content.startswith(m)), (b"", "utf-8"))
    try:
        text = content[len(mark) :].decode(encoding)
    except UnicodeDecodeError:
        raise InputError("is not a text file in UTF-8; save it as UTF-8.") from None
    if "\0" in text:
        raise InputError("holds NUL bytes, so it is not a text file or is damaged; write it again.")
    return text


def printable(text: object, most: int = 80) -> str:
    """A text of others for a sentence: at most so long, and nothing in it that a terminal would act on."""
    shown = str(text)
    shown = shown if len(shown) <= most else shown[: most - 4] + " ..."
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in shown)

"""Locks between processes, so that two of them do not write to one place; a process that dies gives its own back."""

import contextlib
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from iwalker_jax.errors import InputError

try:
    import fcntl
except ImportError:  # a system without them, where nothing is locked
    fcntl = None  # type: ignore[assignment]

_held: dict[Path, int] = {}


@contextmanager
def exclusive(lock: Path, place: Path) -> Iterator[None]:
    """Keep other processes from using a place; this one may ask for it again meanwhile.

    The system takes the lock from a process that ends in whatever way, so that no lock is ever stale. Folders that were
    made for the lock alone go with it.

    Args:
        lock: file to lock, made and removed here; its folder is made as needed.
        place: what a refused process is told is in use.

    Raises:
        InputError: if another process uses it.
        OSError: if the lock file cannot be made.
    """
    lock = lock.absolute()
    if lock in _held:
        yield
        return
    made = [folder for folder in (lock.parent, *lock.parent.parents) if not folder.exists()]
    lock.parent.mkdir(parents=True, exist_ok=True)
    try:
        number = lock_file(lock, wait=False)
    except BlockingIOError as error:
        raise InputError(
            f"{place} is in use by {_owner(lock)}; wait until that has ended, or choose another place."
        ) from error
    os.truncate(number, 0)
    os.write(number, f"process {os.getpid()} on {socket.gethostname()}".encode())
    _held[lock] = number
    try:
        yield
    finally:
        del _held[lock]
        lock.unlink(missing_ok=True)
        os.close(number)
        # A command that was refused leaves no empty folders behind.
        with contextlib.suppress(OSError):
            for folder in made:
                folder.rmdir()


def lock_file(file: Path, wait: bool) -> int:
    """Descriptor of a file, made if it is not there, that no other process has locked; closing it gives it back.

    Raises:
        BlockingIOError: if another process has it and `wait` is false.
        OSError: if the file cannot be made.
    """
    while True:
        number = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _lock(number, wait)
            # Whoever had it may have removed or renamed it meanwhile: then its name belongs to another file.
            if file.exists() and os.path.samestat(os.fstat(number), os.stat(file)):
                return number
        except FileNotFoundError:
            pass
        except BaseException:
            os.close(number)
            raise
        os.close(number)


def _lock(number: int, wait: bool) -> None:
    if fcntl is None:
        return
    try:
        fcntl.flock(number, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        raise
    except OSError:
        # Some network file systems have no locks; what is written there is whole all the same.
        return


def _owner(lock: Path) -> str:
    try:
        return lock.read_text(encoding="utf-8", errors="replace").strip()[:200] or "another process"
    except OSError:
        return "another process"

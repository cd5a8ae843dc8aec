"""Every kind of malformed input, and how a case of one is tried.

A kind makes one case with a random generator and a fresh folder, and returns what is wrong with how the product
received it: None if nothing is. Whatever it raises has escaped from the product.
"""

import signal
import time
import traceback
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

Kind = Callable[[np.random.Generator, Path], str | None]

SECONDS = 10.0
"""[s] of a processor; a case that takes longer hangs."""
WAIT = 40.0
"""[s] of a clock; a case that waits longer, for a pipe say, hangs."""

ENDINGS = ("sentence", "traceback", "hang", "silently wrong")
"""How a case may end: as it must, or in one of three ways in which it must not."""


class HangError(BaseException):
    """Raised in a case that takes too long; no `except Exception` takes it for its own."""


@dataclass(frozen=True)
class Ending:
    """How a case ended.

    Attributes:
        kind, seed, number: of the case.
        ending: one of `ENDINGS`.
        sentence: what is wrong, if anything is.
    """

    kind: str
    seed: int
    number: int
    ending: str
    sentence: str = ""

    def __str__(self) -> str:
        return f"{self.kind} {self.seed}/{self.number}: {self.ending}: {self.sentence}"


@contextmanager
def time_limit() -> Any:
    """Raise HangError in a block that takes more than `SECONDS` of a processor, or waits for more than `WAIT`."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise HangError(f"not done after {SECONDS:g} s of a processor or {WAIT:g} s, {_place(frame)}")

    before = {name: signal.signal(name, stop) for name in (signal.SIGPROF, signal.SIGALRM)}
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.setitimer(signal.ITIMER_REAL, WAIT)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        for name, handler in before.items():
            signal.signal(name, handler)


def _place(frame: FrameType | None) -> str:
    """Where in the product the process is."""
    while frame is not None and "iwalker_jax" not in frame.f_code.co_filename:
        frame = frame.f_back
    return "outside of the product" if frame is None else f"in {frame.f_code.co_filename}:{frame.f_lineno}"


def try_case(name: str, kind: Kind, seed: int, number: int, folder: Path) -> Ending:
    """One case, in a folder that does not exist yet."""
    folder.mkdir(parents=True)
    begin = time.process_time()
    try:
        with time_limit():
            wrong = kind(np.random.default_rng([seed, number]), folder)
    except HangError as error:
        return Ending(name, seed, number, "hang", str(error))
    except Exception as error:
        where = traceback.extract_tb((error.__cause__ or error).__traceback__)[-1]
        said = f"{type(error).__name__}: {' '.join(str(error).split())[:300]} ({where.filename}:{where.lineno})"
        return Ending(name, seed, number, "traceback", said)
    seconds = time.process_time() - begin
    if seconds > SECONDS:
        return Ending(name, seed, number, "hang", f"took {seconds:.0f} s of a processor")
    return Ending(name, seed, number, "silently wrong" if wrong else "sentence", wrong or "")

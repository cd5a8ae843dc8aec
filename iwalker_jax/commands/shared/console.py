"""What the commands share: progress bars, clear exits on bad input, and the run-folder conventions."""

import errno
import functools
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn, ParamSpec, Protocol

import jax
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from iwalker_jax.deployment.loader import ArtifactError
from iwalker_jax.errors import CheckpointError, InputError
from iwalker_jax.runtime import ProcessGroup, exit_process, is_first, join_group, local_devices
from iwalker_jax.runtime.files import first_line
from iwalker_jax.runtime.reading import printable

console = Console(highlight=False)

P = ParamSpec("P")

STOPPED = 130
"""Exit status of a command that Ctrl-C ended."""

FAILURES = (
    InputError,
    CheckpointError,
    ArtifactError,
    FloatingPointError,
    OSError,
    MemoryError,
    jax.errors.JaxRuntimeError,
)
"""What a command answers with one sentence."""

LARGEST_COUNT = 1_000_000
"""Of frames, episodes, seeds and the like; more would run for months."""


LONGEST_SENTENCE = 1000
"""Characters of an error, which may quote what somebody wrote."""


class ShowProgress(Protocol):
    """Moves a progress bar to `done` with a note beside it."""

    def __call__(self, done: int, note: str = "") -> None: ...


@contextmanager
def progress_bar(title: str, total: int) -> Iterator[ShowProgress]:
    """A bar that the block advances by calling the yielded function with (done, note)."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(title, total=total, note="")

        def advance(done: int, note: str = "") -> None:
            bar.update(task, completed=done, note=note)

        yield advance


def come_together(group: ProcessGroup) -> None:
    """Join the group; process 0 speaks for all.

    Raises:
        InputError: for a bad group, one that does not come together, or a JAX without devices.
    """
    join_group(group)
    require_devices()
    console.quiet = not is_first()


def say(sentence: str) -> None:
    """Print a sentence without interpreting brackets as markup."""
    console.print(sentence, markup=False, soft_wrap=True)


def exit_with(error: Exception) -> NoReturn:
    """Leave with the error's sentence and status 1, without a traceback.

    Raises:
        JaxRuntimeError: the error itself, if it is one of the few that are not about memory.
    """
    if isinstance(error, jax.errors.JaxRuntimeError) and "RESOURCE_EXHAUSTED" not in str(error):
        raise error
    print(f"error: {printable(_sentence(error), LONGEST_SENTENCE)}", file=sys.stderr)
    exit_process(1)


def _sentence(error: BaseException) -> str:
    if isinstance(error, (MemoryError, jax.errors.JaxRuntimeError)):
        return f"The memory does not suffice ({first_line(error)}); ask for less at a time, or for smaller networks."
    if not isinstance(error, OSError) or error.errno is None:
        return str(error)
    where = f"{error.filename}: " if error.filename else ""
    advice = "free some space" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "choose another place"
    return f"{where}{error.strerror}; {advice} and run the same command again."


def require_devices() -> None:
    """Refuse, before any work is done, to go on without the devices that JAX was told to use.

    Raises:
        InputError: if there are none.
    """
    local_devices()


def require_counts(command: Any, **least: int) -> None:
    """Refuse numbers of a command's options that are too small or beyond `LARGEST_COUNT`, before any work is done.

    Raises:
        InputError: for the first of them.
    """
    for name, low in least.items():
        value, option = getattr(command, name), "--" + name.replace("_", "-")
        if value < low:
            raise InputError(f"{option} is {value}; give at least {low}.")
        if value > LARGEST_COUNT:
            raise InputError(f"{option} is {value}; give at most {LARGEST_COUNT}.")


def ends_in_a_sentence(if_stopped: str = "") -> Callable[[Callable[P, int]], Callable[P, int]]:
    """Decorator of what a command runs: failures end the process with one sentence and status 1, Ctrl-C with 130.

    Args:
        if_stopped: how to go on after Ctrl-C, as the end of a sentence; left out for a command of seconds.
    """

    def decorate(run: Callable[P, int]) -> Callable[P, int]:
        @functools.wraps(run)
        def decorated(*args: P.args, **kwargs: P.kwargs) -> int:
            try:
                return run(*args, **kwargs)
            except BrokenPipeError:
                # An OSError, yet no failure: whoever read the output has gone, which whoever launched us knows to end.
                raise
            except FAILURES as error:
                exit_with(error)
            except KeyboardInterrupt:
                say(f"Stopped; {if_stopped}." if if_stopped else "Stopped.")
                return STOPPED

        return decorated

    return decorate


def config_file(run: Path) -> Path:
    """Where a run's configuration stands."""
    return run / "config.json"

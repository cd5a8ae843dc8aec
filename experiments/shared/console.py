"""What the commands share: progress bars, clear exits on bad input, and the run-folder conventions."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn, Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from iwalker_jax.errors import InputError
from iwalker_jax.runtime import ProcessGroup, exit_process, is_first, join_group

console = Console(highlight=False)


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
    """Join the group; process 0 speaks for all."""
    join_group(group)
    console.quiet = not is_first()


def say(sentence: str) -> None:
    """Print a sentence without interpreting brackets as markup."""
    console.print(sentence, markup=False, soft_wrap=True)


def exit_with(error: Exception) -> NoReturn:
    """Leave with the error's sentence and status 1, without a traceback."""
    print(f"error: {error}", file=sys.stderr)
    exit_process(1)


def require_at_least(command: Any, **least: int) -> None:
    """Refuse numbers of a command's options that are too small, before any work is done.

    Raises:
        InputError: for the first of them.
    """
    for name, value in least.items():
        if getattr(command, name) < value:
            option = "--" + name.replace("_", "-")
            raise InputError(f"{option} is {getattr(command, name)}; give at least {value}.")


def stopped(advice: str) -> int:
    """Say that Ctrl-C ended the command and how to go on; returns the exit status."""
    say(f"Stopped; {advice}.")
    return 130


def config_file(run: Path) -> Path:
    """Where a run's configuration stands."""
    return run / "config.json"

"""One small training run, shared by the tests of both commands."""

from pathlib import Path
from typing import NamedTuple

import pytest

from tests.experiments.commands import shorten_evaluation, train_command


class Run(NamedTuple):
    """A finished run: its folder, exit status and what it printed."""

    folder: Path
    status: int
    printed: str


@pytest.fixture(scope="session")
def cache(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def own_cache(cache, monkeypatch):
    """Commands under test neither read nor write the user's own cache, and evaluate little."""
    monkeypatch.setenv("IWALKER_CACHE", str(cache))
    shorten_evaluation(monkeypatch)


@pytest.fixture(scope="session")
def finished_run(cache, tmp_path_factory) -> Run:
    """The command run once to its end."""
    from iwalker_jax.commands.shared.console import console

    folder = tmp_path_factory.mktemp("runs") / "first"
    with pytest.MonkeyPatch.context() as patch, console.capture() as capture:
        patch.setenv("IWALKER_CACHE", str(cache))
        shorten_evaluation(patch)
        status = train_command(folder)
    return Run(folder, status, capture.get())

"""Command lines read by the very parser of their command, which then stops before it does anything."""

import argparse
import contextlib
import importlib.util
import io
import runpy
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tyro

from iwalker_jax import film, runtime
from iwalker_jax.commands.shared import config_file
from iwalker_jax.film import headless
from iwalker_jax.runtime import settings


class _ParsedOptions(BaseException):
    """Raised with the parsed options; no command catches it."""


def parse_command(module: str, arguments: tuple[str, ...]) -> str | None:
    """Why a module's command does not take these arguments, in its own words; None if it does."""
    source = importlib.util.find_spec(module)
    if source is not None and source.submodule_search_locations:
        # `python -m` runs the main module of a folder that has one.
        source = importlib.util.find_spec(f"{module}.__main__") or source
    if source is None or source.origin is None:
        return f"there is no module {module}"
    if "__main__" not in Path(source.origin).read_text(encoding="utf-8"):
        return f"{module} is no command"
    said = io.StringIO()
    with (
        _stopped_after_parsing(module, arguments),
        contextlib.redirect_stderr(said),
        contextlib.redirect_stdout(said),
        warnings.catch_warnings(),
    ):
        # That the module may have been imported before does no harm: it only reads its options.
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            runpy.run_module(module, run_name="__main__", alter_sys=True)
        except _ParsedOptions:
            return None
        except SystemExit as end:
            return None if end.code in (0, None) and "--help" in arguments else said.getvalue()
    return f"{module} ran without reading its options"


@contextlib.contextmanager
def _stopped_after_parsing(module: str, arguments: tuple[str, ...]) -> Iterator[None]:
    """Both parsers in use stop the command when they are done; process settings stay the tests' own."""
    parse_args, cli = argparse.ArgumentParser.parse_args, tyro.cli

    def parse_and_stop(parse: Any) -> Any:
        def stop(*given: Any, **options: Any) -> None:
            raise _ParsedOptions(parse(*given, **options))

        return stop

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [module, *arguments])
        patch.setattr(argparse.ArgumentParser, "parse_args", parse_and_stop(parse_args))
        patch.setattr(tyro, "cli", parse_and_stop(cli))
        # A page's configuration file need not be there.
        patch.setattr(config_file, "read_text", lambda file: "{}")
        # The faces first: they look their names up when asked, and would keep what stands in for them.
        for place in (runtime, settings):
            patch.setattr(place, "configure_runtime", lambda *devices: None)
        for place in (film, headless):
            patch.setattr(place, "configure_rendering", lambda: None, raising=False)
        yield

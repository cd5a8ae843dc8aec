"""What `python -m benchmarks` does: runs, writes, compares, publishes."""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.suite.comparison import comparison_text
from benchmarks.suite.page import page
from benchmarks.suite.pictures import draw, picture_names
from benchmarks.suite.registry import ACCELERATOR, BENCHMARKS, ROOT, chosen
from benchmarks.suite.report import Report, load, save
from benchmarks.suite.runs import run_all
from iwalker_jax.commands.shared.console import say
from iwalker_jax.errors import InputError
from iwalker_jax.runtime.files import require_writable, write_text

DOCUMENTATION = ROOT / "docs"
_REPORT = "report.json"
_STEM = "performance"


def run(names: tuple[str, ...], quick: bool, gpu: bool, out: Path, arguments: Sequence[str]) -> Report:
    """Run benchmarks and write their report, page and pictures to a folder.

    Raises:
        InputError: for a name that there is not, names together with the accelerator's set, or no accelerator for it.
    """
    if gpu and names:
        raise InputError("--gpu is a set of its own; leave the names out, or leave out --gpu.")
    benchmarks = [BENCHMARKS[ACCELERATOR]] if gpu else chosen(names, quick)
    require_writable(out)
    report = run_all(benchmarks, quick, arguments, say)
    if gpu and not report.results[ACCELERATOR].groups:
        raise InputError(report.results[ACCELERATOR].failure)
    write(report, out, out / _REPORT)
    return report


def write(report: Report, folder: Path, figures: Path) -> None:
    """Write a report's figures to a file, and its page and pictures to a folder."""
    save(report, figures)
    names = picture_names(report, _STEM)
    draw(report, folder, names)
    write_text(folder / f"{_STEM}.md", page(report, names))


def compare(out: Path, other: Path) -> str:
    """What changed in the last run of a folder against another run's report."""
    return comparison_text(load(other), load(out / _REPORT))


def publish(out: Path) -> None:
    """Write the last run of a folder as the page of the documentation, its figures beside it."""
    write(load(out / _REPORT), DOCUMENTATION, DOCUMENTATION / f"{_STEM}.json")

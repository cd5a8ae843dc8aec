"""All benchmarks in one command: `python -m benchmarks` lists them, `python -m benchmarks qp unicycle` runs two.

It writes the figures, a page and pictures to a folder, says what changed against another run's figures, and publishes
the page in docs/.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import tyro

from benchmarks.suite.command import DOCUMENTATION, compare, publish, run
from benchmarks.suite.registry import listing
from iwalker_jax.commands.shared.console import ends_in_a_sentence, say


@dataclass(frozen=True)
class Command:
    """List or run benchmarks, write their figures and page, and compare runs.

    Attributes:
        names: benchmarks to run, or `all`; none lists them. The machine's floor is measured with every run.
        quick: fewer and smaller problems, and of `all` only those not marked full: some minutes.
        gpu: check and time large batches on an accelerator, in eight minutes at most.
        compare: report.json of another run; says what changed against it, of this run or of the last one in the folder.
        publish: also write the page to docs/performance.md, of this run or of the last one in the folder.
        out: folder for report.json, performance.md and pictures.
    """

    names: tyro.conf.Positional[tuple[str, ...]] = ()
    quick: bool = False
    gpu: bool = False
    compare: Path | None = None
    publish: bool = False
    out: Path = Path("runs/benchmarks")


@ends_in_a_sentence("the figures of the benchmarks that had ended are lost; name fewer at a time")
def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status: 1 if a benchmark failed."""
    given = sys.argv[1:] if arguments is None else arguments
    command = tyro.cli(Command, args=given, description=__doc__)
    status = 0
    if command.names or command.gpu:
        report = run(command.names, command.quick, command.gpu, command.out, given)
        status = int(any(result.failure for result in report.results.values()))
        say(f"\nFigures, page and pictures are in {command.out}.")
    elif command.compare is None and not command.publish:
        say(listing())
    if command.compare is not None:
        say(compare(command.out, command.compare))
    if command.publish:
        publish(command.out)
        say(f"The page is {DOCUMENTATION / 'performance.md'}.")
    return status


if __name__ == "__main__":
    raise SystemExit(main())

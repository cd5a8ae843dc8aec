"""Try malformed inputs of all kinds: python -m tests.malformed [--count 3000] [--seed 0] [--only KIND]."""

import argparse
import resource
import shutil
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    # Before JAX is imported: what is compiled once is kept for the next time.
    configure_runtime()

from tests.malformed.kinds import ENDINGS, Ending, try_case
from tests.malformed.registry import FAMILIES, schedule

MEMORY = 16 * 1024**3
"""[bytes] of addresses that the command may take."""


def run(count: int, seed: int, only: str | None = None) -> list[Ending]:
    """The endings of so many cases, of all families or kinds in turn, or of one."""
    endings = []
    with tempfile.TemporaryDirectory() as place:
        for name, kind, number in schedule(count, only):
            folder = Path(place) / f"{name}{number}"
            endings.append(try_case(name, kind, seed, number, folder))
            shutil.rmtree(folder, ignore_errors=True)
            if endings[-1].ending != "sentence":
                print(endings[-1], flush=True)
    return endings


def summary(endings: Sequence[Ending]) -> str:
    """How many cases of each kind ended how, a line a kind, and all of them."""
    names = list(dict.fromkeys(each.kind for each in endings))
    counts = Counter((each.kind, each.ending) for each in endings) + Counter(("all", each.ending) for each in endings)
    lines = [f"{'':28}" + "".join(f"{ending:>16}" for ending in ENDINGS)]
    lines += [f"{name:28}" + "".join(f"{counts[name, ending]:16}" for ending in ENDINGS) for name in [*names, "all"]]
    return "\n".join(lines)


def main() -> int:
    """Run the command; returns the exit status, 0 if nothing is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.malformed", description=__doc__)
    parser.add_argument("--count", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help=f"a family ({', '.join(FAMILIES)}) or one of its kinds")
    options = parser.parse_args()
    # A case that would take all of a machine's memory gets a MemoryError instead.
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    endings = run(options.count, options.seed, options.only)
    print(summary(endings))
    return int(any(each.ending != "sentence" for each in endings))


if __name__ == "__main__":
    raise SystemExit(main())

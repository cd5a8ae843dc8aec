"""All benchmarks by name, with the line that each says of itself."""

import ast
from pathlib import Path
from typing import NamedTuple

from iwalker_jax.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
"""The checkout."""

FLOOR, ACCELERATOR = "floor", "accelerator"


class Benchmark(NamedTuple):
    """A benchmark that is a command of its own.

    Attributes:
        name: as it is asked for.
        module: that `python -m` runs.
        quick: whether it is part of a quick run of all; the others take minutes to compile.
        limit: [s] after which it is stopped; None for never.
    """

    name: str
    module: str
    quick: bool = True
    limit: float | None = None

    def line(self) -> str:
        """The first line of its docstring."""
        file = ROOT / (self.module.replace(".", "/") + ".py")
        return (ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "").splitlines()[0]


BENCHMARKS = {
    each.name: each
    for each in (
        Benchmark(FLOOR, "benchmarks.floor"),
        Benchmark("qp", "benchmarks.qp"),
        Benchmark("unicycle", "benchmarks.unicycle"),
        Benchmark("step_mpc", "benchmarks.step_mpc"),
        Benchmark("distance_field", "benchmarks.distance_field"),
        Benchmark("cost_to_go", "benchmarks.cost_to_go"),
        Benchmark("local_map", "benchmarks.local_map"),
        Benchmark("depth_rendering", "benchmarks.depth_rendering"),
        Benchmark("physics_step", "benchmarks.choices.physics_step"),
        Benchmark("training_speed", "benchmarks.training_speed", quick=False),
        Benchmark("closed_loop", "benchmarks.closed_loop", quick=False),
        Benchmark("qp_verdicts", "benchmarks.qp_verdicts", quick=False),
        Benchmark("walking_gradients", "benchmarks.walking_gradients", quick=False),
        Benchmark("unicycle_methods", "benchmarks.choices.unicycle_methods", quick=False),
        Benchmark("qp_methods", "benchmarks.choices.qp_methods", quick=False),
        Benchmark(ACCELERATOR, "benchmarks.accelerator", quick=False, limit=480.0),
    )
}


def chosen(names: tuple[str, ...], quick: bool) -> list[Benchmark]:
    """The benchmarks of names, in their usual order; the floor is always among them, `all` stands for all on a CPU.

    Raises:
        InputError: for a name that there is not.
    """
    everything = "all" in names
    unknown = [name for name in names if name not in BENCHMARKS and name != "all"]
    if unknown:
        raise InputError(f"There is no benchmark {unknown[0]!r}; choose of all, {', '.join(BENCHMARKS)}.")
    wanted = {FLOOR, *names}
    usual = [each for each in BENCHMARKS.values() if each.name != ACCELERATOR and (each.quick or not quick)]
    if everything:
        wanted |= {each.name for each in usual}
    return [each for each in BENCHMARKS.values() if each.name in wanted]


def listing() -> str:
    """A line for each, for the console."""
    width = max(len(name) for name in BENCHMARKS)
    return "\n".join(
        f"{each.name:<{width}}  {'     ' if each.quick else 'full '}  {each.line()}" for each in BENCHMARKS.values()
    )

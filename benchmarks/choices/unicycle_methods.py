"""Second-order or Gauss-Newton iterations of the unicycle MPC: iterations, time, optima and derivatives of both.

Run with `python -m benchmarks.choices.unicycle_methods`. Both methods meet the same references, and both
are judged by the residual of the second-order model.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import get_args

from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from benchmarks.problems.unicycle_references import references
from benchmarks.suite.alone import Options, present
from benchmarks.suite.contest import Contender, contest
from benchmarks.suite.figures import Fact, Group
from iwalker_jax.optimization import (
    GradientMode,
    Solution,
    Status,
    UnicycleMethod,
    UnicycleParameters,
    initial_state_from_reference,
    solve_unicycle,
)

GRADIENTS: tuple[GradientMode, ...] = ("implicit", "unrolled")
METHODS = {method: UnicycleParameters(method=method) for method in get_args(UnicycleMethod)}
_BATCH = 64
_GRADIENT_BATCH = 16
_GRADIENT_ROWS = 64


@dataclass(frozen=True)
class Config(Options):
    """Compare both methods.

    Attributes:
        paths: references, rounded up to whole batches of 64; 64 with --quick.
        seed: of the references.
    """

    paths: int = 1024
    seed: int = 0


def slope(parameters: UnicycleParameters, mode: GradientMode, reference: jax.Array, state: jax.Array) -> jax.Array:
    """Derivative of half the squared plan by its reference."""
    return jax.grad(lambda r: jnp.sum(solve_unicycle(r, state, parameters, mode).value.path ** 2) / 2)(reference)


def plans(solve: Callable, paths: jax.Array, starts: jax.Array) -> Solution:
    """Solutions of all references, in batches, as NumPy arrays."""
    parts = [solve(paths[k : k + _BATCH], starts[k : k + _BATCH]) for k in range(0, len(paths), _BATCH)]
    return jax.tree.map(lambda *leaves: np.concatenate([np.asarray(leaf) for leaf in leaves]), *parts)


def optima(solved: dict[str, Solution]) -> Iterator[Fact]:
    """Convergence, iterations, and how the costs compare."""
    costs = {method: solution.value.cost for method, solution in solved.items()}
    best = np.minimum.reduce(list(costs.values()))
    for method, solution in solved.items():
        yield Fact(f"{method}: converged", 100 * float(np.mean(solution.status == Status.CONVERGED)), "%")
        for share in (50, 90, 99, 100):
            yield Fact(f"{method}: iterations, {share} %", float(np.percentile(solution.iterations, share)))
        near = 100 * float(np.mean(costs[method] <= 1.001 * best + 1e-7))
        yield Fact(f"{method}: cost within 0.1 % of the better one", near, "%")


def times(
    solve: Mapping[str, Callable], learn: Mapping[str, Callable], paths: jax.Array, starts: jax.Array
) -> Iterator[Group]:
    """Times of one plan, of a batch and of derivatives."""
    few, many = (paths[:_GRADIENT_BATCH], starts[:_GRADIENT_BATCH]), (paths[:_BATCH], starts[:_BATCH])
    alone = {method: jax.jit(partial(solve_unicycle, parameters=parameters)) for method, parameters in METHODS.items()}
    groups = {
        "One path": [Contender(method, "ours", partial(alone[method], paths[0], starts[0])) for method in METHODS],
        f"{_BATCH} paths": [Contender(method, "ours", partial(solve[method], *many), _BATCH) for method in METHODS],
        f"Gradients of {_GRADIENT_BATCH} paths": [
            Contender(name, "ours", partial(call, *few), _GRADIENT_BATCH) for name, call in learn.items()
        ],
    }
    for title, rows in groups.items():
        yield contest(title, "a path", rows, 10)


def derivatives(
    solved: dict[str, Solution], learn: Mapping[str, Callable], paths: jax.Array, starts: jax.Array
) -> Iterator[Fact]:
    """Derivatives of both methods beside the second-order method's, where both found the same plan."""
    rows = min(len(paths), _GRADIENT_ROWS)
    first, second = (jax.tree.map(lambda leaf: leaf[:rows], solution) for solution in solved.values())
    apart = np.max(np.abs(first.value.path - second.value.path), axis=(1, 2))
    same = (apart < 1e-2) & first.gradient_valid & second.gradient_valid

    def slopes(call: Callable) -> np.ndarray:
        parts = [call(paths[k : k + _GRADIENT_BATCH], starts[k : k + _GRADIENT_BATCH]) for k in batches]
        return np.concatenate([np.asarray(part) for part in parts])[same].reshape(int(same.sum()), -1)

    batches = range(0, rows, _GRADIENT_BATCH)
    exact = slopes(learn["ddp, implicit"])
    yield Fact("references with the same plan by both", float(same.sum()), f"of {rows}")
    for name, call in learn.items():
        off = np.linalg.norm(slopes(call) - exact, axis=1) / np.linalg.norm(exact, axis=1)
        for share in (50, 90):
            yield Fact(f"{name} derivative off by, {share} %", float(np.percentile(off, share)), "of its size")


def measure(config: Config) -> Iterator[Group | Fact]:
    """All figures of this benchmark."""
    count = _BATCH if config.quick else -(-config.paths // _BATCH) * _BATCH
    paths = jnp.asarray(references(count, config.seed))
    starts = jax.vmap(initial_state_from_reference)(paths)
    solve = {m: jax.jit(jax.vmap(partial(solve_unicycle, parameters=p))) for m, p in METHODS.items()}
    learn = {
        f"{method}, {mode}": jax.jit(jax.vmap(partial(slope, parameters, mode)))
        for method, parameters in METHODS.items()
        for mode in GRADIENTS
    }
    yield from times(solve, learn, paths, starts)
    solved = {method: plans(call, paths, starts) for method, call in solve.items()}
    yield from optima(solved)
    yield from derivatives(solved, learn, paths, starts)


if __name__ == "__main__":
    options = tyro.cli(Config, description=__doc__)
    present(measure(options), options)

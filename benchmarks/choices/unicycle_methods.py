"""Second-order or Gauss-Newton iterations of the unicycle MPC: iterations, time, optima and derivatives of both.

Run with `python -m benchmarks.choices.unicycle_methods`. Both methods meet the same references, and both
are judged by the residual of the second-order model.
"""

import argparse
from collections.abc import Callable, Mapping
from functools import partial
from typing import get_args

from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.problems.unicycle_references import POINTS, references
from benchmarks.timing import in_turns
from iwalker_jax.optimization import (
    GradientMode,
    Solution,
    Status,
    UnicycleMethod,
    UnicycleParameters,
    initial_state_from_reference,
    solve_unicycle,
)
from iwalker_jax.runtime.devices import machine

GRADIENTS: tuple[GradientMode, ...] = ("implicit", "unrolled")
METHODS = {method: UnicycleParameters(method=method) for method in get_args(UnicycleMethod)}
_BATCH = 64
_GRADIENT_BATCH = 16
_GRADIENT_ROWS = 64


def slope(parameters: UnicycleParameters, mode: GradientMode, reference: jax.Array, state: jax.Array) -> jax.Array:
    """Derivative of half the squared plan by its reference."""
    return jax.grad(lambda r: jnp.sum(solve_unicycle(r, state, parameters, mode).value.path ** 2) / 2)(reference)


def plans(solve: Callable, paths: jax.Array, starts: jax.Array) -> Solution:
    """Solutions of all references, in batches, as NumPy arrays."""
    parts = [solve(paths[k : k + _BATCH], starts[k : k + _BATCH]) for k in range(0, len(paths), _BATCH)]
    return jax.tree.map(lambda *leaves: np.concatenate([np.asarray(leaf) for leaf in leaves]), *parts)


def print_optima(solved: dict[str, Solution]) -> None:
    """Convergence, iterations, and how the costs compare."""
    costs = {method: solution.value.cost for method, solution in solved.items()}
    best = np.minimum.reduce(list(costs.values()))
    print("| method | converged | iterations: median | 90 % | 99 % | most | cost within 0.1 % of the better one |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for method, solution in solved.items():
        shares = np.percentile(solution.iterations, [50, 90, 99, 100])
        converged = np.mean(solution.status == Status.CONVERGED)
        near = np.mean(costs[method] <= 1.001 * best + 1e-7)
        print(f"| {method} | {converged:.2%} | {' | '.join(f'{k:.0f}' for k in shares)} | {near:.2%} |")


def print_times(
    solve: Mapping[str, Callable], learn: Mapping[str, Callable], paths: jax.Array, starts: jax.Array
) -> None:
    """Times of one plan, of a batch and of derivatives; the methods take turns."""
    few, many = (paths[:_GRADIENT_BATCH], starts[:_GRADIENT_BATCH]), (paths[:_BATCH], starts[:_BATCH])
    calls: dict[str, tuple[Callable, int]] = {}
    for method, parameters in METHODS.items():
        alone = jax.jit(partial(solve_unicycle, parameters=parameters))
        calls[f"{method}, one path"] = partial(alone, paths[0], starts[0]), 1
        calls[f"{method}, batch of {_BATCH}, a path"] = partial(solve[method], *many), _BATCH
    for name, call in learn.items():
        calls[f"{name} gradient, batch of {_GRADIENT_BATCH}, a path"] = partial(call, *few), _GRADIENT_BATCH
    times = in_turns({name: call for name, (call, _) in calls.items()}, 10)
    print("\n| what | best [ms] | median [ms] |\n| --- | --- | --- |")
    for name, (_, count) in calls.items():
        each = times[name].each(count)
        print(f"| {name} | {1e3 * each.best:.2f} | {1e3 * each.median:.2f} |")


def print_derivatives(
    solved: dict[str, Solution], learn: Mapping[str, Callable], paths: jax.Array, starts: jax.Array
) -> None:
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
    print(f"\n{same.sum()} of {rows} references where both plans are the same: derivatives differ from the first by")
    print("| derivative | median | 90 % |\n| --- | --- | --- |")
    for name, call in learn.items():
        off = np.linalg.norm(slopes(call) - exact, axis=1) / np.linalg.norm(exact, axis=1)
        print(f"| {name} | {np.median(off):.1e} | {np.percentile(off, 90):.1e} |")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--paths", type=int, default=1024, help="references; rounded up to whole batches of 64")
    parser.add_argument("--seed", type=int, default=0, help="of the references")
    options = parser.parse_args()
    count = -(-options.paths // _BATCH) * _BATCH
    paths = jnp.asarray(references(count, options.seed))
    starts = jax.vmap(initial_state_from_reference)(paths)
    print(
        f"{machine()}, float32, {count} references of {POINTS} points, tolerance {UnicycleParameters().tolerance:g}\n"
    )
    solve = {m: jax.jit(jax.vmap(partial(solve_unicycle, parameters=p))) for m, p in METHODS.items()}
    learn = {
        f"{method}, {mode}": jax.jit(jax.vmap(partial(slope, parameters, mode)))
        for method, parameters in METHODS.items()
        for mode in GRADIENTS
    }
    solved = {method: plans(call, paths, starts) for method, call in solve.items()}
    print_optima(solved)
    print_derivatives(solved, learn, paths, starts)
    print_times(solve, learn, paths, starts)


if __name__ == "__main__":
    main()

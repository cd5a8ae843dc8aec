"""Is what `solve_qp` says true? Thousands of ugly programs, judged against Clarabel and by construction.

Run with `python -m benchmarks.qp_verdicts --count 1000`; `--double` for double precision. Of each character it counts
answers called CONVERGED that are not, solvable programs called INFEASIBLE, UNBOUNDED or NOT_CONVEX, derivatives called
valid where there are none, and answers that do not claim anything.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from benchmarks.suite.extras import require
from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()
require("clarabel", "scipy")

import clarabel  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import scipy.sparse as sparse  # noqa: E402
import tyro  # noqa: E402
from scipy.optimize import linprog  # noqa: E402

from benchmarks.problems.ugly_qps import UglyQp, ugly_qps  # noqa: E402
from benchmarks.suite.alone import Options, present  # noqa: E402
from benchmarks.suite.figures import Fact  # noqa: E402
from iwalker_jax.optimization import QuadraticProgram, Status, solve_qp  # noqa: E402


@dataclass(frozen=True)
class Config(Options):
    """Count false statements.

    Attributes:
        count: programs of each character; 50 with --quick.
        seed: of the programs.
        double: double precision.
    """

    count: int = 1000
    seed: int = 0
    double: bool = False


_COUNTS = ("wrong", "false infeasible", "false other", "false derivative", "no claim")
_WRONG = 1e-2  # of the cost's own terms, or of a row's


def clarabel_point(qp: UglyQp) -> np.ndarray | None:
    """The optimum in double precision; None if Clarabel finds none that holds the rows.

    Solved in units in which the cost's diagonal is one and in those in which the rows are: units break solvers.
    """
    P, C = np.asarray(qp.P, float), np.asarray(qp.C, float)
    diagonal, reach = np.diagonal(P), np.max(np.abs(C), axis=0, initial=0)
    by_rows = np.where(reach > 0, 1 / np.where(reach > 0, reach, 1), 1.0)
    by_cost = np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1)), by_rows)
    points = [point for units in (by_cost, by_rows) if (point := _clarabel_in_units(qp, units)) is not None]
    points = [point for point in points if not violates(qp, point, 1e-2)]
    return min(points, key=lambda x: x @ P @ x / 2 + np.asarray(qp.q, float) @ x, default=None)


def _clarabel_in_units(qp: UglyQp, units: np.ndarray) -> np.ndarray | None:
    P, q, C, low, high = (np.asarray(a, float) for a in qp[:5])
    rows = np.max(np.abs(C * units), axis=1)
    rows = 1 / np.where(rows > 0, rows, 1)
    P, q, C, low, high = P * units * units[:, None], q * units, rows[:, None] * C * units, rows * low, rows * high
    equal = low == high
    above, below = np.isfinite(high) & ~equal, np.isfinite(low) & ~equal
    cones = [clarabel.ZeroConeT(int(equal.sum())), clarabel.NonnegativeConeT(int(above.sum() + below.sum()))]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = 500
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(P)),
        q,
        sparse.csc_matrix(np.concatenate([C[equal], C[above], -C[below]])),
        np.concatenate([high[equal], high[above], -low[below]]),
        cones,
        settings,
    )
    solution = solver.solve()
    return units * np.asarray(solution.x) if str(solution.status) in ("Solved", "AlmostSolved") else None


def feasible(qp: UglyQp) -> bool:
    """Whether HiGHS finds a point within the bounds."""
    _, _, C, low, high = (np.asarray(a, float) for a in qp[:5])
    above, below = np.isfinite(high), np.isfinite(low)
    rows, ends = np.concatenate([C[above], -C[below]]), np.concatenate([high[above], -low[below]])
    return linprog(np.zeros(C.shape[1]), A_ub=rows, b_ub=ends, bounds=(None, None), method="highs").status == 0


def violates(qp: UglyQp, x: np.ndarray, share: float = 1.0) -> bool:
    """Whether a row lies outside by a part of its bound and its terms that anyone would notice."""
    _, _, C, low, high = (np.asarray(a, float) for a in qp[:5])
    value, terms = C @ x, np.abs(C) @ np.abs(x)
    outside = np.maximum(np.maximum(value - high, low - value), 0)
    bound = np.abs(np.where(value > high, high, low))
    return bool(np.any(outside > share * 0.1 * _WRONG * np.maximum(np.where(outside > 0, bound, 0), terms)))


def improved(qp: UglyQp, x: np.ndarray, better: np.ndarray) -> bool:
    """Whether the other point costs noticeably less."""
    P, q = np.asarray(qp.P, float), np.asarray(qp.q, float)
    cost = [p @ P @ p / 2 + q @ p for p in (x, better)]
    size = max(np.abs(q) @ np.abs(better), np.abs(q) @ np.abs(x), abs(cost[1]))
    return bool(cost[0] - cost[1] > _WRONG * size)


def judge(qp: UglyQp, status: Status, x: np.ndarray, valid: bool) -> str | None:
    """What is false about an answer: one of the counts, or None."""
    if qp.fact == "tie" and valid:
        return "false derivative"
    if status in (Status.MAX_ITERATIONS, Status.NON_FINITE):
        return "no claim"
    solvable = qp.fact in ("solvable", "tie")
    if status == Status.CONVERGED:
        if not solvable:
            return "wrong"
        optimum = clarabel_point(qp)
        return "wrong" if violates(qp, x) or (optimum is not None and improved(qp, x, optimum)) else None
    if status == Status.INFEASIBLE:
        return "false infeasible" if solvable and feasible(qp) else None
    if status == Status.NOT_CONVEX or solvable or qp.fact == "infeasible":
        return "false other"
    return None


def count_verdicts(count: int, seed: int, dtype: type[np.floating]) -> dict[str, dict[str, int]]:
    """How many answers of each character are false, and how."""
    solve = jax.jit(jax.vmap(solve_qp))
    table = {}
    for name, qps in ugly_qps(count, seed, dtype).items():
        P, q, C, low, high = (jnp.asarray(np.stack(arrays)) for arrays in zip(*(qp[:5] for qp in qps)))
        solution = jax.device_get(solve(QuadraticProgram(P, q, C, low, high)))
        words = [
            judge(qp, Status(int(status)), np.asarray(x, float), bool(valid))
            for qp, status, x, valid in zip(qps, solution.status, solution.value.x, solution.gradient_valid)
        ]
        table[name] = {word: words.count(word) for word in _COUNTS}
    return table


def measure(config: Config) -> Iterator[Fact]:
    """Counts of every character that has any, and of all of them."""
    jax.config.update("jax_enable_x64", config.double)
    count = min(config.count, 50) if config.quick else config.count
    found = count_verdicts(count, config.seed, np.float64 if config.double else np.float32)
    for word in _COUNTS:
        for name, row in found.items():
            if row[word]:
                yield Fact(f"{name.replace('_', ' ')}: {word}", row[word], f"of {count}")
        yield Fact(f"all characters: {word}", sum(row[word] for row in found.values()), f"of {count * len(found)}")


if __name__ == "__main__":
    options = tyro.cli(Config, description=__doc__)
    present(measure(options), options)

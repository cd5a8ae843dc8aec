"""General QPs: accuracy and speed side by side with quadprog, OSQP and ProxQP, Clarabel being the judge.

Run with `python -m benchmarks.qp`; `--devices 2` spreads batches over two host devices, `--file stack.npz` reads logged
programs (stacked P, q, C, low, high as written by `QuadraticProgram.save`, one robot, in time order).
"""

import argparse
import sys
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec

from benchmarks.extras import require
from iwalker_jax.runtime.settings import configure_runtime, requested_devices

configure_runtime(requested_devices(sys.argv))
require("clarabel", "osqp", "quadprog", "scipy")

import clarabel  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import osqp  # noqa: E402
import quadprog  # noqa: E402
import scipy.sparse as sparse  # noqa: E402
from jax.sharding import Mesh, PartitionSpec  # noqa: E402

from benchmarks.problems.hard_qps import hard_qps  # noqa: E402
from benchmarks.problems.whole_body_qps import whole_body_qps  # noqa: E402
from benchmarks.timing import compiled, timed  # noqa: E402
from iwalker_jax.optimization import (  # noqa: E402
    QpPoint,
    QpSettings,
    QuadraticProgram,
    Solution,
    Status,
    cold_start,
    control_settings,
    load_program,
    solve_qp,
)
from iwalker_jax.runtime.devices import machine  # noqa: E402

Arrays = tuple[np.ndarray, ...]
REPEATS = 7


def stacked_rows(C: np.ndarray, low: np.ndarray, high: np.ndarray, slack: float = 0.0) -> tuple[np.ndarray, ...]:
    """Equality rows first, then G x >= h, and the number of equalities."""
    equal = (low == high) & (slack == 0)
    below, above = np.isfinite(low) & ~equal, np.isfinite(high) & ~equal
    G = np.concatenate([C[equal], C[below], -C[above]])
    h = np.concatenate([low[equal], low[below] - slack, -high[above] - slack])
    return G, h, np.asarray(equal.sum())


def clarabel_solver(P: np.ndarray, q: np.ndarray, C: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The judge, at 1e-10."""
    G, h, equalities = stacked_rows(C, low, high)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    cones = [clarabel.ZeroConeT(int(equalities)), clarabel.NonnegativeConeT(len(h) - int(equalities))]
    solver = clarabel.DefaultSolver(sparse.csc_matrix(np.triu(P)), q, sparse.csc_matrix(-G), -h, cones, settings)
    return np.asarray(solver.solve().x)


def quadprog_solver(P: np.ndarray, q: np.ndarray, C: np.ndarray, low: np.ndarray, high: np.ndarray) -> Callable:
    """Goldfarb and Idnani in C; bounds are relaxed by 1e-8 because it calls exactly degenerate ones inconsistent."""
    G, h, equalities = stacked_rows(C, low, high, 1e-8)
    rows = np.ascontiguousarray(G.T)
    return lambda: quadprog.solve_qp(P, -q, rows, h, int(equalities))[0]


def osqp_solver(P: np.ndarray, q: np.ndarray, C: np.ndarray, low: np.ndarray, high: np.ndarray) -> Callable:
    """OSQP's own default accuracy made finer, without its set-up in the time."""
    solver = osqp.OSQP()
    solver.setup(
        sparse.csc_matrix(np.triu(P)),
        q,
        sparse.csc_matrix(C),
        low,
        high,
        verbose=False,
        warm_starting=False,
        eps_abs=1e-5,
        eps_rel=1e-5,
    )
    return lambda: solver.solve().x


def proxqp_solver(P: np.ndarray, q: np.ndarray, C: np.ndarray, low: np.ndarray, high: np.ndarray) -> Callable:
    """ProxQP's dense back end, if installed."""
    import proxsuite

    solver = proxsuite.proxqp.dense.QP(len(q), 0, len(low))
    solver.settings.eps_abs = 1e-6
    solver.init(P, q, None, None, C, np.maximum(low, -1e20), np.minimum(high, 1e20))

    def solve() -> np.ndarray:
        solver.solve()
        return np.asarray(solver.results.x)

    return solve


def walk_tick(settings: QpSettings, guesses: QpPoint, problems: QuadraticProgram) -> tuple[QpPoint, Solution]:
    """One tick of one robot, or of a batch."""
    solve = partial(solve_qp, settings=settings, gradient="stopped")
    solution = solve(problems, guesses) if problems.q.ndim == 1 else jax.vmap(solve)(problems, guesses)
    return solution.value, solution


def scan_walk(stack: QuadraticProgram, batch: int, settings: QpSettings) -> Callable[[], Solution]:
    """Compile a scan over time; robots of a batch start at different times of the log and go round.

    All read the one log, as the peers do: a copy for every robot would time the memory instead.
    """
    length = stack.q.shape[0]
    offsets = jnp.arange(batch) * length // batch
    first = jax.tree.map(lambda a: a[offsets], stack)
    start = jax.vmap(cold_start)(first)
    if batch == 1:
        offsets, start = offsets[0], jax.tree.map(lambda a: a[0], start)

    def walk(start: QpPoint, offsets: jax.Array, stack: QuadraticProgram) -> Solution:
        def tick(guesses: QpPoint, t: jax.Array) -> tuple[QpPoint, Solution]:
            return walk_tick(settings, guesses, jax.tree.map(lambda a: a[(t + offsets) % length], stack))

        return jax.lax.scan(tick, start, jnp.arange(length))[1]

    if batch >= 2 * jax.device_count() > 2:
        mesh = Mesh(np.asarray(jax.devices()), ("robots",))
        robots, ticks = PartitionSpec("robots"), PartitionSpec(None, "robots")
        walk = jax.shard_map(
            walk, mesh=mesh, in_specs=(robots, robots, PartitionSpec()), out_specs=ticks, check_vma=False
        )
    program, taken = compiled(jax.jit(walk), start, offsets, stack)
    print(f"    batch {batch}: compiled, or loaded from the cache, in {taken:.1f} s")
    return partial(program, start, offsets, stack)


def solve_all(solvers: list[Callable], answers: list[np.ndarray]) -> None:
    """Solve program after program; no value is returned, so that none is searched for JAX arrays in the time."""
    answers[:] = [solve() for solve in solvers]


def quality(x: np.ndarray, expected: np.ndarray, problems: Arrays, torque_map: np.ndarray, offset: np.ndarray) -> str:
    """Relative torque error (median, 99 %, worst) and worst violation relative to the largest variable."""
    torque = np.einsum("tij,tj->ti", torque_map, expected) + offset
    error = np.max(np.abs(np.einsum("tij,tj->ti", torque_map, x - expected)), axis=1) / np.max(np.abs(torque), axis=1)
    value = np.einsum("tij,tj->ti", problems[2], x)
    violation = np.max(np.maximum(np.maximum(value - problems[4], problems[3] - value), 0), axis=1)
    relative = violation / np.max(np.abs(x), axis=1)
    return f"{np.median(error):8.0e} {np.quantile(error, 0.99):8.0e} {np.max(error):8.0e} {np.max(relative):10.0e}"


def compare(name: str, problems: Arrays, torque_map: np.ndarray, offset: np.ndarray, batches: tuple[int, ...]) -> None:
    """Print one table."""
    length, n = problems[1].shape
    print(f"\n{name}: {n} variables, {problems[3].shape[1]} rows, {length} ticks")
    expected = np.stack([clarabel_solver(*(a[t] for a in problems)) for t in range(length)])
    P, q, C, low, high = (jnp.asarray(a, jnp.float32) for a in problems)
    stack = QuadraticProgram(P, q, C, low, high)
    lines = []
    peers = {"quadprog": quadprog_solver, "OSQP 1e-5": osqp_solver}
    if find_spec("proxsuite"):
        peers["ProxQP 1e-6"] = proxqp_solver
    for peer, make in peers.items():
        solvers = [make(*(a[t] for a in problems)) for t in range(length)]
        answers: list[np.ndarray] = []
        each = timed(solve_all, solvers, answers, repeats=3).each(length)
        lines.append((peer, 1, each, quality(np.stack(answers), expected, problems, torque_map, offset), ""))
    for label, settings in (("control", control_settings()), ("default", QpSettings())):
        for batch in batches if label == "control" else batches[:2]:
            call = scan_walk(stack, batch, settings)
            solution, each = call(), timed(call, repeats=REPEATS).each(length * batch)
            x = np.asarray(solution.value.x if batch == 1 else solution.value.x[:, 0], float)
            converged, pivots = np.mean(solution.status == Status.CONVERGED), np.mean(solution.iterations)
            rated = quality(x, expected, problems, torque_map, offset)
            note = f"{100 * converged:.1f} % converged, {pivots:.1f} pivots"
            lines.append((f"ours, {label}", batch, each, rated, note))
    print(f"  {'solver':<15} {'batch':>5} {'us a QP':>16}   torque error 50 / 99 / 100 %   violation")
    for solver, batch, each, rated, note in lines:
        print(f"  {solver:<15} {batch:>5} {1e6 * each.best:7.1f} ({1e6 * each.median:6.1f}) {rated}   {note}")


def hard_statuses(seeds: int) -> None:
    """Count how hard programs end, in single precision."""
    solve = jax.jit(solve_qp)
    print(f"\nHard programs, {seeds} of each kind, single precision")
    ends: dict[str, list[str]] = {}
    for seed in range(seeds):
        for name, case in hard_qps(seed).items():
            P, q, C, low, high = (jnp.asarray(a, jnp.float32) for a in case[:5])
            ends.setdefault(f"{name} ({case.outcome})", []).append(
                Status(int(solve(QuadraticProgram(P, q, C, low, high)).status)).name.lower()
            )
    for name, found in ends.items():
        print(f"  {name:<42} " + ", ".join(f"{found.count(s)} {s}" for s in sorted(set(found))))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=1, help="host devices to spread batches over")
    parser.add_argument("--file", help="logged programs to use instead of generated ones")
    parser.add_argument("--batches", type=int, nargs="+", default=[1, 16, 64, 256])
    parser.add_argument("--ticks", type=int, default=250)
    arguments = parser.parse_args()
    batches = tuple(arguments.batches)
    print(f"{machine()}; microseconds a QP, best (median); peers in double precision on one core")
    if arguments.file:
        stack = load_program(arguments.file)
        problems = tuple(a[: arguments.ticks].astype(float) for a in stack.arrays())
        start = sum(count for name, count in stack.blocks if name != "torque") if stack.blocks else 0
        rows = problems[2][:, start:]
        compare(arguments.file, problems, rows, np.zeros(rows.shape[:2]), batches)
        return
    for name, eliminate in (("base eliminated", True), ("base kept", False)):
        walk = whole_body_qps(arguments.ticks, eliminate=eliminate)
        problems = (walk.P, walk.q, walk.C, walk.low, walk.high)
        compare(f"Whole body, {name}", problems, walk.torque_map, walk.torque_offset, batches)
    hard_statuses(10)


if __name__ == "__main__":
    main()

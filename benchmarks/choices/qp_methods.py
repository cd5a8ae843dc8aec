"""Active set or ADMM in the walking loop: accuracy beside Clarabel, time, derivatives, and what it does to walks.

Run with `python -m benchmarks.choices.qp_methods`; `--devices 2` spreads the walks over two host devices, `--ticks` and
`--robots` say how many programs and walks. Both methods meet the same programs and the same robots.
"""

import argparse
import sys
from functools import partial

from benchmarks.extras import require
from iwalker_jax.runtime.settings import configure_runtime, requested_devices

if __name__ == "__main__":
    configure_runtime(requested_devices(sys.argv))
require("clarabel", "scipy")

import clarabel  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import scipy.sparse as sparse  # noqa: E402

from benchmarks.problems.whole_body_qps import WholeBodyQps, whole_body_qps  # noqa: E402
from benchmarks.timing import in_turns  # noqa: E402
from iwalker_jax.api import walk  # noqa: E402
from iwalker_jax.optimization import (  # noqa: E402
    QpMethod,
    QpPoint,
    QuadraticProgram,
    Solution,
    Status,
    cold_start,
    control_settings,
    solve_qp,
)
from iwalker_jax.walking import Disturbances, Motion  # noqa: E402

METHODS: tuple[QpMethod, ...] = ("active_set", "admm")
_BATCH = 64


def clarabel_torques(walk: WholeBodyQps) -> np.ndarray:
    """(T, 10) [N m], the torques of the exact optima: an interior-point method in double precision."""
    rows = []
    for P, q, C, low, high, M, offset in zip(
        walk.P, walk.q, walk.C, walk.low, walk.high, walk.torque_map, walk.torque_offset
    ):
        equal = low == high
        above, below = np.isfinite(high) & ~equal, np.isfinite(low) & ~equal
        A = np.vstack([C[equal], C[above], -C[below]])
        b = np.concatenate([high[equal], high[above], -low[below]])
        cones = [clarabel.ZeroConeT(int(equal.sum())), clarabel.NonnegativeConeT(int(above.sum() + below.sum()))]
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
        upper, rows_of = sparse.csc_matrix(np.triu(P)), sparse.csc_matrix(A)
        x = np.asarray(clarabel.DefaultSolver(upper, q, rows_of, b, cones, settings).solve().x)
        rows.append(M @ x + offset)
    return np.stack(rows)


def in_time_order(method: QpMethod, programs: QuadraticProgram) -> Solution:
    """Solutions of programs (T, ...), each started from the one before."""

    def tick(guess: QpPoint, problem: QuadraticProgram) -> tuple[QpPoint, Solution]:
        solution = solve_qp(problem, guess, control_settings(method), "stopped")
        return solution.value, solution

    return jax.lax.scan(tick, cold_start(jax.tree.map(lambda leaf: leaf[0], programs)), programs)[1]


def slopes(method: QpMethod, programs: QuadraticProgram) -> np.ndarray:
    """(T, n) implicit derivative of half the squared solution by q, of the programs each by itself."""

    def size(q: jax.Array, program: QuadraticProgram) -> jax.Array:
        x = solve_qp(QuadraticProgram(program.P, q, program.C, program.low, program.high), None, settings).value.x
        return jnp.sum(x**2) / 2

    settings = control_settings(method)
    return np.asarray(jax.jit(jax.vmap(jax.grad(size)))(programs.q, programs))


def print_programs(ticks: int, seed: int) -> None:
    """Accuracy and time on the programs of one pushed walk after the other."""
    walk = whole_body_qps(ticks, seed)
    P, q, C, low, high = (jnp.asarray(leaf, jnp.float32) for leaf in walk[:5])
    programs = QuadraticProgram(P, q, C, low, high)
    exact = clarabel_torques(walk)
    alone = {method: jax.jit(partial(in_time_order, method)) for method in METHODS}
    batch = {method: jax.jit(jax.vmap(partial(in_time_order, method))) for method in METHODS}
    short = jax.tree.map(lambda leaf: jnp.repeat(leaf[None, :50], _BATCH, axis=0), programs)
    one = in_turns({method: partial(alone[method], programs) for method in METHODS}, 5)
    many = in_turns({method: partial(batch[method], short) for method in METHODS}, 5)
    gradients = {method: slopes(method, jax.tree.map(lambda leaf: leaf[:100], programs)) for method in METHODS}
    away = np.linalg.norm(gradients["admm"] - gradients["active_set"], axis=1)
    away = away / np.linalg.norm(gradients["active_set"], axis=1)
    print(f"{ticks} whole-body QPs of a pushed walk in time order, warm-started, single precision, seed {seed}")
    print(
        "| method | converged | torques within 1 % | worst torque error [N m] | one QP [us] | of a batch of 64 [us] |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    for method in METHODS:
        solution = alone[method](programs)
        torques = np.einsum("tij,tj->ti", walk.torque_map, np.asarray(solution.value.x, float)) + walk.torque_offset
        error = np.abs(torques - exact)
        within = np.mean(error <= 0.01 * np.maximum(np.abs(exact), 1.0))
        converged = int(np.sum(np.asarray(solution.status) == Status.CONVERGED))
        times = 1e6 * one[method].best / ticks, 1e6 * many[method].best / (50 * _BATCH)
        print(
            f"| {method} | {converged} of {ticks} | {100 * within:.2f} % | {error.max():.3f} "
            f"| {times[0]:.0f} | {times[1]:.0f} |"
        )
    print(f"derivatives of 100 of them by q: apart by {100 * np.median(away):.3f} % in the median\n")


def print_walks(robots: int, seed: int) -> None:
    """Falls and errors of the same robots under both methods."""
    print(f"{robots} robots each, 8 s at 0.1 m/s, friction 0.5 to 1.0, masses within 5 %, seed {seed}")
    print("| walk | method | fell | QPs not converged [ticks a robot] | footsteps off by [cm] | computing [s] |")
    print("| --- | --- | --- | --- | --- | --- |")
    walks = {
        "nominal": Disturbances(),
        "pushed by 2 N s from behind or before": Disturbances(push_impulse=2.0, push_axis="x"),
        "pushed by 1 N s from a side": Disturbances(push_impulse=1.0, push_axis="y"),
    }
    for name, disturbances in walks.items():
        for method in METHODS:
            motion = Motion("straight", speed=0.1, seconds=8.0)
            result = walk(motion, robots, disturbances=disturbances, solver=method, seed=seed)
            fell = sum(metrics.fallen for metrics in result.metrics)
            failures = np.mean([metrics.qp_failures for metrics in result.metrics])
            off = 100 * np.mean(np.concatenate([metrics.footstep_errors for metrics in result.metrics]))
            print(f"| {name} | {method} | {fell} | {failures:.2f} | {off:.2f} | {result.batch.seconds:.0f} |")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=1000, help="programs")
    parser.add_argument("--robots", type=int, default=100, help="of each walk; 0 for programs alone")
    parser.add_argument("--seed", type=int, default=0, help="of programs and robots")
    parser.add_argument("--devices", type=int, default=None, help="host devices for the walks")
    options = parser.parse_args()
    print_programs(options.ticks, options.seed)
    if options.robots:
        print_walks(options.robots, options.seed)


if __name__ == "__main__":
    main()

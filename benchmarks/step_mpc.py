"""Step MPC: time and error beside OSQP, Clarabel and our own general QP solver on the same problems.

Run: python -m benchmarks.step_mpc [--horizon 20] [--batch 16]
"""

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.extras import require
from iwalker_jax.runtime.settings import configure_runtime

configure_runtime()
require("clarabel", "osqp", "scipy")

import clarabel  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import osqp  # noqa: E402
import tyro  # noqa: E402
from jaxtyping import Array  # noqa: E402
from scipy import sparse  # noqa: E402

from benchmarks.problems.step_qps import StepQp, build_step_qp, irregular_walk  # noqa: E402
from benchmarks.timing import timed  # noqa: E402
from iwalker_jax.optimization import (  # noqa: E402
    HlipParameters,
    QuadraticProgram,
    Status,
    StepMpcWeights,
    StepReach,
    solve_bounded_step_mpc,
    solve_qp,
    solve_step_mpc,
    step_bounds,
)
from iwalker_jax.runtime.devices import machine  # noqa: E402

Plan = Callable[[Array, Array, Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Config:
    """Sizes of the benchmark.

    Attributes:
        horizon: steps a problem.
        batch: problems a batch.
        noise: irregularity of the wanted footsteps [m].
        repeats: timed calls.
    """

    horizon: int = 20
    batch: int = 16
    noise: float = 0.02
    repeats: int = 100


def clarabel_solver(qp: StepQp, low: np.ndarray, high: np.ndarray) -> clarabel.DefaultSolver:
    """Clarabel on the QP, with bounds if there are any."""
    rows, values = [qp.dynamics, qp.heading, -qp.heading], [qp.drift, high, -low]
    bounded = np.isfinite(high).all()
    cones = [clarabel.ZeroConeT(len(qp.drift)), clarabel.NonnegativeConeT(2 * len(high))]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    return clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(qp.hessian)),
        qp.linear,
        sparse.csc_matrix(np.concatenate(rows if bounded else rows[:1])),
        np.concatenate(values if bounded else values[:1]),
        cones if bounded else cones[:1],
        settings,
    )


def osqp_solver(qp: StepQp, low: np.ndarray, high: np.ndarray, tolerance: float) -> osqp.OSQP:
    """OSQP on the QP, factorised: only its iterations are timed."""
    solver = osqp.OSQP()
    solver.setup(
        sparse.csc_matrix(np.triu(qp.hessian)),
        qp.linear,
        sparse.csc_matrix(np.concatenate([qp.dynamics, qp.heading])),
        np.concatenate([qp.drift, low]),
        np.concatenate([qp.drift, high]),
        verbose=False,
        warm_starting=False,
        eps_abs=tolerance,
        eps_rel=tolerance,
        max_iter=100000,
    )
    return solver


def general_program(qp: StepQp, low: np.ndarray, high: np.ndarray) -> QuadraticProgram:
    """The QP for `solve_qp`, in single precision like ours."""
    rows = np.concatenate([qp.dynamics, qp.heading])
    ends = (np.concatenate([qp.drift, x]) for x in (low, high))
    P, q, C, lowest, highest = (jnp.asarray(x, jnp.float32) for x in (qp.hessian, qp.linear, rows, *ends))
    return QuadraticProgram(P, q, C, lowest, highest)


def row(name: str, call: Callable[[], object], count: int, error: float, repeats: int) -> float:
    """Print one line and return the time of one problem [ms]."""
    first, best, median = (1e3 * seconds for seconds in timed(call, repeats=repeats))
    print(f"{name:34s}{first:10.1f}{best:10.3f}{median:10.3f}{best / count:11.4f}{error:12.1e}")
    return best / count


def compare(title: str, plan: Plan, low: np.ndarray, high: np.ndarray, config: Config) -> None:
    """Print the table of one planner beside general solvers with the same bounds."""
    walks = [irregular_walk(config.horizon, seed, config.noise) for seed in range(config.batch)]
    problems = tuple(np.stack(x).astype(np.float32) for x in zip(*walks))
    qps = [build_step_qp(*walk[:2], HlipParameters(), StepMpcWeights(), walk[2]) for walk in walks]
    exact = np.stack([qp.unpack(np.asarray(clarabel_solver(qp, low, high).solve().x))[0] for qp in qps])
    first = tuple(x[0] for x in problems)
    one, many = jax.jit(plan), jax.jit(jax.vmap(plan))
    slope = jax.jit(jax.grad(lambda f, x, h: jnp.sum((jax.vmap(plan)(f, x, h)[0] - f) ** 2), (0, 1)))
    footsteps, status = jax.jit(jax.vmap(plan))(*problems)
    good = np.asarray(status) == Status.CONVERGED
    error = 1e3 * float(np.abs(np.asarray(footsteps)[good] - exact[good]).max())
    print(f"\n{title}: {good.sum()} of {len(good)} converged")
    print(f"{'':34s}{'first ms':>10s}{'min ms':>10s}{'median ms':>10s}{'a problem':>11s}{'error mm':>12s}")
    single = row("one problem", lambda: one(*first), 1, error, config.repeats)
    batch = row(f"batch of {config.batch}", lambda: many(*problems), config.batch, error, config.repeats)
    row("batch, forward and backward", lambda: slope(*problems), config.batch, error, config.repeats)
    for tolerance in (1e-3, 1e-7):
        solver = osqp_solver(qps[0], low, high, tolerance)
        z = np.asarray(solver.solve(raise_error=False).x)
        zeros = np.zeros_like(z), np.zeros(len(qps[0].drift) + len(high))

        def again(solver: osqp.OSQP = solver, zeros: tuple = zeros) -> object:
            solver.warm_start(x=zeros[0], y=zeros[1])
            return solver.solve(raise_error=False).info.iter

        error = 1e3 * float(np.abs(qps[0].unpack(z)[0] - exact[0]).max())
        peer = row(f"OSQP {tolerance:g}, factorised before", again, 1, error, 20)
        print(f"{'':34s}takes {peer / single:.1f} x our time for one problem, {peer / batch:.1f} x in a batch")
    program = general_program(qps[0], low, high)
    general = jax.jit(solve_qp)
    solution = general(program)
    error = 1e3 * float(np.abs(qps[0].unpack(np.asarray(solution.value.x, float))[0] - exact[0]).max())
    row(f"solve_qp, {Status(int(solution.status)).name.lower()}", lambda: general(program), 1, error, 20)
    row("Clarabel, with its set-up", lambda: clarabel_solver(qps[0], low, high).solve().status, 1, 0.0, 20)


def free_plan(f: Array, x: Array, h: Array) -> tuple[Array, Array]:
    """Footsteps and status of the closed-form MPC; headings do not enter."""
    solution = solve_step_mpc(f, x)
    return solution.value.footsteps, solution.status


def bounded_plan(f: Array, x: Array, h: Array) -> tuple[Array, Array]:
    """Footsteps and status of the bounded MPC."""
    solution = solve_bounded_step_mpc(f, x, jnp.asarray(1.0), h)
    return solution.value.footsteps, solution.status


def main(config: Config) -> None:
    """Print one table for the closed-form MPC and one for the bounded one."""
    print(f"{machine()}, float32; peers in float64")
    print(f"N = {config.horizon}, batch {config.batch}, footsteps irregular by {config.noise} m")
    low, high = (np.ravel(x) for x in step_bounds(StepReach(), jnp.asarray(1.0), config.horizon))
    infinite = np.full_like(high, np.inf)
    compare("closed form", free_plan, -infinite, infinite, config)
    compare("bounded", bounded_plan, low, high, config)


if __name__ == "__main__":
    main(tyro.cli(Config))

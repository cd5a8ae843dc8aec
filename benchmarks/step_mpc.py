"""Step MPC beside OSQP, Clarabel and our own general QP solver on the same problems.

Run: python -m benchmarks.step_mpc [--horizon 20] [--batch 16]
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from benchmarks.suite.extras import require
from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
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
from benchmarks.suite.alone import Options, present  # noqa: E402
from benchmarks.suite.contest import Contender, contest  # noqa: E402
from benchmarks.suite.figures import Fact, Group, Work  # noqa: E402
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

Plan = Callable[[Array, Array, Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Config(Options):
    """Sizes of the benchmark.

    Attributes:
        horizon: steps a problem.
        batch: problems a batch.
        noise: irregularity of the wanted footsteps [m].
        repeats: turns; 15 with --quick.
    """

    horizon: int = 20
    batch: int = 16
    noise: float = 0.02
    repeats: int = 40


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


def osqp_again(solver: osqp.OSQP, variables: int, rows: int) -> np.ndarray:
    """The answer from no guess."""
    solver.warm_start(x=np.zeros(variables), y=np.zeros(rows))
    return np.asarray(solver.solve(raise_error=False).x)


def compare(title: str, plan: Plan, low: np.ndarray, high: np.ndarray, config: Config) -> Iterator[Group | Fact]:
    """One planner beside general solvers with the same bounds."""
    walks = [irregular_walk(config.horizon, seed, config.noise) for seed in range(config.batch)]
    problems = tuple(np.stack(x).astype(np.float32) for x in zip(*walks))
    qps = [build_step_qp(*walk[:2], HlipParameters(), StepMpcWeights(), walk[2]) for walk in walks]
    exact = np.stack([qp.unpack(np.asarray(clarabel_solver(qp, low, high).solve().x))[0] for qp in qps])
    first, repeats = tuple(x[0] for x in problems), 15 if config.quick else config.repeats
    many = jax.jit(jax.vmap(plan))
    slope = jax.jit(jax.grad(lambda f, x, h: jnp.sum((jax.vmap(plan)(f, x, h)[0] - f) ** 2), (0, 1)))

    def apart(answer: tuple[np.ndarray, np.ndarray]) -> dict[str, float]:
        footsteps = answer[0] if np.ndim(answer[0]) == 3 else answer[0][None]
        good = np.atleast_1d(answer[1]) == Status.CONVERGED
        return {"worst error [mm]": 1e3 * float(np.abs(footsteps - exact[: len(footsteps)])[good].max())}

    def by_point(z: np.ndarray) -> dict[str, float]:
        return {"worst error [mm]": 1e3 * float(np.abs(qps[0].unpack(np.asarray(z, float))[0] - exact[0]).max())}

    work = Work(bytes=4.0 * config.horizon * 8, steps=2.0 * config.horizon)
    general = partial(jax.jit(solve_qp), general_program(qps[0], low, high))
    sizes = len(qps[0].linear), len(qps[0].drift) + len(high)
    rows = [
        Contender("ours, one problem", "ours", partial(jax.jit(plan), *first), 1, apart, work),
        Contender(f"ours, {config.batch} side by side", "ours", partial(many, *problems), config.batch, apart),
        *([] if config.quick else [Contender("our solve_qp", "ours", lambda: general().value.x, 1, by_point)]),
        *(
            Contender(
                f"OSQP {tolerance:g}, factorised before",
                "peer",
                partial(osqp_again, osqp_solver(qps[0], low, high, tolerance), *sizes),
                1,
                by_point,
                compiles=False,
            )
            for tolerance in (1e-3, 1e-7)
        ),
        Contender(
            "Clarabel, with its set-up",
            "peer",
            lambda: np.asarray(clarabel_solver(qps[0], low, high).solve().x),
            1,
            by_point,
            compiles=False,
        ),
    ]
    yield contest(f"{title}, {config.horizon} steps", "a problem", rows, repeats)
    learned = Contender(f"ours, {config.batch} side by side", "ours", partial(slope, *problems), config.batch)
    yield contest(f"{title}, {config.horizon} steps, with gradient", "a problem", [learned], repeats)
    converged = np.asarray(many(*problems)[1]) == Status.CONVERGED
    yield Fact(f"{title}: converged", float(converged.sum()), f"of {len(converged)}")


def free_plan(f: Array, x: Array, h: Array) -> tuple[Array, Array]:
    """Footsteps and status of the closed-form MPC; headings do not enter."""
    solution = solve_step_mpc(f, x)
    return solution.value.footsteps, solution.status


def bounded_plan(f: Array, x: Array, h: Array) -> tuple[Array, Array]:
    """Footsteps and status of the bounded MPC."""
    solution = solve_bounded_step_mpc(f, x, jnp.asarray(1.0), h)
    return solution.value.footsteps, solution.status


def measure(config: Config) -> Iterator[Group | Fact]:
    """The closed-form MPC and the bounded one."""
    low, high = (np.ravel(x) for x in step_bounds(StepReach(), jnp.asarray(1.0), config.horizon))
    infinite = np.full_like(high, np.inf)
    yield from compare("closed form", free_plan, -infinite, infinite, config)
    yield from compare("bounded", bounded_plan, low, high, config)


if __name__ == "__main__":
    options = tyro.cli(Config, description=__doc__)
    present(measure(options), options)

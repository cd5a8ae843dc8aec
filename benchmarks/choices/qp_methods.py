"""Active set or ADMM in the walking loop: accuracy beside Clarabel, time, derivatives, and what it does to walks.

Run with `python -m benchmarks.choices.qp_methods`; `--devices 2` spreads the walks over two host devices, `--ticks` and
`--robots` say how many programs and walks. Both methods meet the same programs and the same robots.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from benchmarks.suite.extras import require
from iwalker_jax.runtime.settings import configure_runtime, requested_devices

if __name__ == "__main__":
    configure_runtime(requested_devices(sys.argv))
require("clarabel", "scipy")

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import tyro  # noqa: E402

from benchmarks.peers.qp_solvers import Programs, clarabel_points  # noqa: E402
from benchmarks.problems.whole_body_qps import WholeBodyQps, whole_body_qps  # noqa: E402
from benchmarks.suite.alone import Options, present  # noqa: E402
from benchmarks.suite.contest import Contender, contest  # noqa: E402
from benchmarks.suite.figures import Fact, Group  # noqa: E402
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


@dataclass(frozen=True)
class Config(Options):
    """Compare both methods.

    Attributes:
        ticks: programs; 100 with --quick.
        robots: of each walk; 0, and with --quick, for programs alone.
        seed: of programs and robots.
        devices: host devices for the walks.
    """

    ticks: int = 1000
    robots: int = 100
    seed: int = 0
    devices: int | None = None


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


def torques_of(walk: WholeBodyQps, points: np.ndarray) -> np.ndarray:
    """(T, 10) [N m] of solutions (T, n)."""
    return np.einsum("tij,tj->ti", walk.torque_map, points) + walk.torque_offset


def programs_by_both(ticks: int, seed: int) -> Iterator[Group | Fact]:
    """Accuracy and time on the programs of one pushed walk after the other, warm-started, in single precision."""
    walk = whole_body_qps(ticks, seed)
    P, q, C, low, high = (jnp.asarray(leaf, jnp.float32) for leaf in walk[:5])
    programs = QuadraticProgram(P, q, C, low, high)
    exact = torques_of(walk, clarabel_points(Programs(*walk[:5])))

    def judge(solution: Solution) -> dict[str, float]:
        error = np.abs(torques_of(walk, np.asarray(solution.value.x, float)) - exact)
        beyond = float(np.mean(error > 0.01 * np.maximum(np.abs(exact), 1.0)))
        unsolved = float(np.mean(np.asarray(solution.status) != Status.CONVERGED))
        return {"not converged": unsolved, "torques off by 1 %": beyond, "worst torque error [N m]": float(error.max())}

    alone = {method: jax.jit(partial(in_time_order, method)) for method in METHODS}
    batch = {method: jax.jit(jax.vmap(partial(in_time_order, method))) for method in METHODS}
    short = jax.tree.map(lambda leaf: jnp.repeat(leaf[None, :50], _BATCH, axis=0), programs)
    rows = [Contender(method, "ours", partial(alone[method], programs), ticks, judge) for method in METHODS]
    yield contest(f"{ticks} programs in time order", "a QP", rows, 5)
    rows = [Contender(method, "ours", partial(batch[method], short), 50 * _BATCH) for method in METHODS]
    yield contest(f"{_BATCH} side by side", "a QP", rows, 5)
    gradients = {method: slopes(method, jax.tree.map(lambda leaf: leaf[:100], programs)) for method in METHODS}
    away = np.linalg.norm(gradients["admm"] - gradients["active_set"], axis=1)
    away = away / np.linalg.norm(gradients["active_set"], axis=1)
    yield Fact("derivatives by q apart, median", 100 * float(np.median(away)), "%")


def walks_by_both(robots: int, seed: int) -> Iterator[Fact]:
    """Falls and errors of the same robots under both methods: 8 s at 0.1 m/s, floors and masses that vary."""
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
            label = f"{name}, {method}"
            yield Fact(f"{label}: fell", float(fell), f"of {robots}")
            yield Fact(f"{label}: QPs not converged", float(failures), "ticks a robot")
            yield Fact(f"{label}: footsteps off by", float(off), "cm")
            yield Fact(f"{label}: computing", float(result.batch.seconds), "s")


def measure(config: Config) -> Iterator[Group | Fact]:
    """All figures of this benchmark."""
    yield from programs_by_both(min(config.ticks, 100) if config.quick else config.ticks, config.seed)
    if config.robots and not config.quick:
        yield from walks_by_both(config.robots, config.seed)


if __name__ == "__main__":
    options = tyro.cli(Config, description=__doc__)
    present(measure(options), options)

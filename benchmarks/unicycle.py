"""Unicycle MPC beside IPOPT, the published way and a textbook iLQR, on random smooth and jagged references.

Run with `python -m benchmarks.unicycle`. The published way solves a chain of 100 quadratic programs a path with OSQP,
each linearised about the last solution; here its matrices are built once and updated in place, and OSQP starts warm.
Quality is the cost of a plan over the better one of IPOPT's local optima from two usual starts.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Any

from benchmarks.suite.extras import absent, require
from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()
require("casadi")

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import tyro  # noqa: E402

from benchmarks.peers.unicycle import FREE, Ipopt, PublishedWay, cost_of, guesses, textbook_ilqr  # noqa: E402
from benchmarks.problems.unicycle_references import POINTS, references  # noqa: E402
from benchmarks.suite.alone import Options, present  # noqa: E402
from benchmarks.suite.contest import Contender, contest  # noqa: E402
from benchmarks.suite.figures import Fact, Group, Work  # noqa: E402
from iwalker_jax.optimization import Solution, Status, initial_state_from_reference, solve_unicycle  # noqa: E402

BATCH = 64
LEARNED = 16
_NEAR = 1e-3


@dataclass(frozen=True)
class Config(Options):
    """Time plans one by one, in batches and with a gradient, and judge their costs.

    Attributes:
        paths: references whose plans are compared with IPOPT's; 64 with --quick.
        timed: references that are planned one by one in the time; 7 with --quick.
    """

    paths: int = 1000
    timed: int = 21


class Judge:
    """Costs of plans over IPOPT's of the same references."""

    def __init__(self, paths: np.ndarray, starts: np.ndarray) -> None:
        self.paths, self.starts = paths, starts
        ipopt = Ipopt()
        self.found: dict[str, np.ndarray] = {}
        for name in ("reference", "straight"):
            plans = [ipopt.plan(r, s, guesses(r, s)[name]) for r, s in zip(paths, starts, strict=True)]
            costs = self.costs(np.stack(plans))
            self.found[name] = np.where(np.isfinite(costs), costs, np.inf)
        self.best = np.min(list(self.found.values()), axis=0)

    def costs(self, controls: np.ndarray) -> np.ndarray:
        """(K,) of the first K references."""
        rows = zip(controls.astype(float), self.paths, self.starts, strict=False)
        return np.array([cost_of(*row) for row in rows])

    def near(self, controls: np.ndarray, limit: np.ndarray | None = None) -> float:
        """Share whose cost is within 0.1 % of IPOPT's, or lower."""
        costs = self.costs(controls)
        return float(np.mean(costs <= (self.best if limit is None else limit)[: len(costs)] * (1 + _NEAR) + 1e-7))

    def __call__(self, controls: Any) -> dict[str, float]:
        points = np.asarray(controls)
        costs, best = self.costs(points), self.best[: len(points)]
        excess = (costs - best) / np.maximum(best, 1e-3)
        return {"median excess cost": float(np.median(excess)), "not within 0.1 %": 1 - self.near(points)}


def one_by_one(plan: Callable, judge: Judge, count: int) -> Callable[[], np.ndarray]:
    """Plans the first references one after the other."""
    rows = list(zip(judge.paths[:count], judge.starts[:count], strict=True))
    return lambda: np.stack([np.asarray(plan(*row)) for row in rows])


def alone(judge: Judge, count: int) -> Iterator[Contender]:
    """Contenders that are given one path at a time; a sweep each way is the least that a plan needs."""
    work = Work(bytes=4.0 * POINTS * 8, steps=2.0 * POINTS)
    ours = jax.jit(lambda r, s: solve_unicycle(r, s, FREE).value.controls)
    single = [(jnp.asarray(r, jnp.float32), jnp.asarray(s, jnp.float32)) for r, s in zip(judge.paths, judge.starts)]
    given = single[:count]
    yield Contender("ours", "ours", lambda: np.stack([ours(*row) for row in given]), count, judge, work)
    textbook = jax.jit(textbook_ilqr)

    def in_double(r: np.ndarray, s: np.ndarray) -> np.ndarray:
        with jax.enable_x64(True):
            return np.asarray(textbook(r, s))

    yield Contender("textbook iLQR, double", "peer", one_by_one(in_double, judge, count), count, judge)
    ipopt = Ipopt()

    def by_ipopt(r: np.ndarray, s: np.ndarray) -> np.ndarray:
        return ipopt.plan(r, s, guesses(r, s)["reference"])

    yield Contender("IPOPT by CasADi", "peer", one_by_one(by_ipopt, judge, count), count, judge, compiles=False)
    if find_spec("osqp") and find_spec("scipy"):
        published = PublishedWay()
        few = max(1, count // 7)
        call = one_by_one(published.plan, judge, few)
        yield Contender("published, 100 OSQP solves", "peer", call, few, judge, compiles=False)


def together(judge: Judge) -> Iterator[Contender]:
    """Contenders that plan a batch at once."""
    paths, starts = judge.paths[:BATCH], judge.starts[:BATCH]
    single = jnp.asarray(paths, jnp.float32), jnp.asarray(starts, jnp.float32)
    ours = jax.jit(jax.vmap(lambda r, s: solve_unicycle(r, s, FREE).value.controls))
    work = Work(bytes=4.0 * POINTS * 8, steps=2.0 * POINTS / BATCH)
    yield Contender(f"ours, {BATCH} side by side", "ours", lambda: ours(*single), BATCH, judge, work)
    textbook = jax.jit(jax.vmap(textbook_ilqr))
    yield Contender(f"textbook iLQR, {BATCH} side by side", "peer", lambda: textbook(*single), BATCH, judge)


def with_gradient(judge: Judge) -> Iterator[Contender]:
    """The derivative of a loss of the plan by its reference, implicit beside differentiated iterations."""
    few = (jnp.asarray(leaf[:LEARNED], jnp.float32) for leaf in (judge.paths, judge.starts))
    batch = tuple(few)
    for name, mode in (("implicit", "implicit"), ("through the iterations", "unrolled")):

        def pull(r: jax.Array, s: jax.Array, mode: Any = mode) -> jax.Array:
            return jnp.sum(solve_unicycle(r, s, FREE, mode).value.path ** 2)

        learn = jax.jit(jax.vmap(jax.grad(pull)))
        yield Contender(f"ours, {name}", "ours", partial(learn, *batch), LEARNED)


def measure(config: Config) -> Iterator[Group | Fact]:
    """All figures of this benchmark."""
    count = 64 if config.quick else max(config.paths, BATCH)
    few = 7 if config.quick else min(config.timed, count)
    paths = references(count)
    starts = np.asarray(jax.vmap(initial_state_from_reference)(jnp.asarray(paths)), float)
    judge = Judge(paths.astype(float), starts)
    repeats = 5 if config.quick else 15
    yield contest(f"One path of {POINTS} points at a time, {few} of them", "a path", alone(judge, few), repeats)
    yield contest(f"Paths of {POINTS} points side by side", "a path", together(judge), repeats)
    yield contest(f"Plan and gradient, {LEARNED} side by side", "a path", with_gradient(judge), repeats)
    many = jax.jit(jax.vmap(lambda r, s: solve_unicycle(r, s, FREE)))
    parts: list[Solution] = []
    for k in range(0, count - count % BATCH, BATCH):
        parts.append(jax.device_get(many(*(leaf[k : k + BATCH].astype(np.float32) for leaf in (paths, starts)))))
    controls = np.concatenate([part.value.controls for part in parts])
    status = np.concatenate([part.status for part in parts])
    yield Fact(f"of {len(status)} references, converged", 100 * float(np.mean(status == Status.CONVERGED)), "%")
    for name, limit in (*judge.found.items(), ("the better one", judge.best)):
        yield Fact(f"cost within 0.1 % of IPOPT's from {name}, or lower", 100 * judge.near(controls, limit), "%")


if __name__ == "__main__":
    options = tyro.cli(Config, description=__doc__)
    present(measure(options), options, absent({"osqp": "osqp", "scipy": "scipy"}))

"""Unicycle MPC: quality against IPOPT and speed against the published way (`python -m benchmarks.unicycle`).

The published way solves a chain of 100 quadratic programs a path with OSQP, each linearised about the last solution;
here its matrices are built once and updated in place, and OSQP is warm-started. Quality is the cost of a plan over
the cost of IPOPT's local optimum of the same problem, on random smooth and jagged references.
"""

import argparse
import statistics
from typing import Any

from benchmarks.extras import require
from iwalker_jax.runtime.settings import configure_runtime

configure_runtime()
require("casadi", "osqp", "scipy")

import casadi  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import osqp  # noqa: E402
from scipy import sparse  # noqa: E402

from benchmarks.problems.unicycle_references import POINTS, references  # noqa: E402
from benchmarks.timing import once, timed  # noqa: E402
from iwalker_jax.optimization import (  # noqa: E402
    UnicycleParameters,
    initial_state_from_reference,
    solve_unicycle,
)
from iwalker_jax.runtime.devices import machine  # noqa: E402

LINEARISATIONS = 100
BATCH = 64
FREE = UnicycleParameters()


class Ipopt:
    """The same problem over states and controls for IPOPT."""

    def __init__(self) -> None:
        x, u = casadi.MX.sym("x", 4, POINTS), casadi.MX.sym("u", 2, POINTS - 1)
        reference, start = casadi.MX.sym("r", 2, POINTS), casadi.MX.sym("s", 4)
        v, theta = x[2, :-1], x[3, :-1]
        moved = x[:, :-1] + casadi.vertcat(v * casadi.cos(theta), v * casadi.sin(theta), u[1, :], u[0, :])
        cost = FREE.position_weight * casadi.sumsqr(x[:2, :] - reference)
        cost += FREE.turn_weight * casadi.sumsqr(u[0, :]) + FREE.acceleration_weight * casadi.sumsqr(u[1, :])
        problem: dict[str, Any] = {
            "x": casadi.vertcat(casadi.vec(x), casadi.vec(u)),
            "p": casadi.vertcat(casadi.vec(reference), start),
            "f": cost,
            "g": casadi.vertcat(x[:, 0] - start, casadi.vec(x[:, 1:] - moved)),
        }
        quiet: dict[str, Any] = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.max_iter": 500}
        self._solver = casadi.nlpsol("unicycle", "ipopt", problem, quiet)

    def cost(self, reference: np.ndarray, start: np.ndarray, guess: np.ndarray) -> float:
        """Cost of the local optimum reached from guessed states (N, 4) and zero controls."""
        first = np.concatenate([guess.ravel(), np.zeros(2 * (POINTS - 1))])
        answer = self._solver(x0=first, p=np.concatenate([reference.ravel(), start]), lbg=0, ubg=0)
        return float(answer["f"]) if self._solver.stats()["success"] else np.inf


def guesses(reference: np.ndarray, start: np.ndarray) -> dict[str, np.ndarray]:
    """Two usual starts for IPOPT: the reference with its own speeds and unwrapped headings, and driving straight on."""
    steps = np.diff(reference, axis=0, append=2 * reference[-1:] - reference[-2:-1])
    heading = np.unwrap(np.concatenate([start[3:], np.arctan2(steps[:, 1], steps[:, 0])]))[1:]
    followed = np.column_stack([reference, np.linalg.norm(steps, axis=1), heading])
    ahead = np.arange(POINTS)[:, None] * start[2] * np.array([np.cos(start[3]), np.sin(start[3])])
    straight = np.column_stack([start[:2] + ahead, np.full(POINTS, start[2]), np.full(POINTS, start[3])])
    return {"reference": followed, "straight": straight}


class PublishedWay:
    """100 quadratic programs a path, each linearised about the last one's solution, by OSQP."""

    def __init__(self) -> None:
        n, m = POINTS, POINTS - 1
        weights = np.concatenate([np.tile([2.0, 2.0, 0, 0], n), np.tile([2e3, 1e4], m)])
        rows, columns = [np.arange(4 * n)], [np.arange(4 * n)]
        step = np.arange(m)[:, None] * 4
        pattern = [(0, 0), (1, 1), (2, 2), (3, 3), (0, 2), (0, 3), (1, 2), (1, 3)]
        for row, column in pattern:
            rows.append((step + 4 + row).ravel())
            columns.append((step + column).ravel())
        for row, column in ((3, 0), (2, 1)):
            rows.append((step + 4 + row).ravel())
            columns.append(4 * n + 2 * np.arange(m) + column)
        where = (np.concatenate(rows), np.concatenate(columns))
        order = sparse.csc_matrix((np.arange(1, len(where[0]) + 1), where), (4 * n, 4 * n + 2 * m))
        self._order = order.data - 1
        order.data = np.ones_like(order.data, dtype=float)
        self._solver = osqp.OSQP()
        zero = np.zeros(4 * n)
        self._solver.setup(
            sparse.diags(weights, format="csc"), np.zeros(4 * n + 2 * m), order, zero, zero, verbose=False
        )

    def plan(self, reference: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Controls (N-1, 2) after 100 linearisations from driving straight on."""
        n, m = POINTS, POINTS - 1
        states = guesses(reference, start)["straight"]
        linear = np.zeros(4 * n + 2 * m)
        linear[: 4 * n].reshape(n, 4)[:, :2] = -2 * reference
        for _ in range(LINEARISATIONS):
            v, theta = states[:-1, 2], states[:-1, 3]
            c, s = np.cos(theta), np.sin(theta)
            identity, minus = np.ones(4 * n), -np.ones(m)
            entries = [identity, minus, minus, minus, minus, -c, v * s, -s, -v * c, minus, minus]
            target = np.zeros((n, 4))
            target[0] = start
            target[1:, 0], target[1:, 1] = v * s * theta, -v * c * theta
            self._solver.update(q=linear, l=target.ravel(), u=target.ravel(), Ax=np.concatenate(entries)[self._order])
            solution = self._solver.solve().x
            states = solution[: 4 * n].reshape(n, 4)
        return solution[4 * n :].reshape(m, 2)


def cost_of(controls: np.ndarray, reference: np.ndarray, start: np.ndarray) -> float:
    """Objective of controls under the true motion, in double precision."""
    theta = start[3] + np.concatenate([[0], np.cumsum(controls[:, 0])])
    speed = start[2] + np.concatenate([[0], np.cumsum(controls[:, 1])])
    steps = (speed * np.stack([np.cos(theta), np.sin(theta)])).T[:-1]
    path = start[:2] + np.concatenate([[[0, 0]], np.cumsum(steps, axis=0)])
    effort = FREE.turn_weight * np.sum(controls[:, 0] ** 2) + FREE.acceleration_weight * np.sum(controls[:, 1] ** 2)
    return float(FREE.position_weight * np.sum((path - reference) ** 2) + effort)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paths", type=int, default=1000, help="references compared with IPOPT")
    parser.add_argument("--timed", type=int, default=20, help="references timed one by one")
    arguments = parser.parse_args()

    count = max(arguments.paths, BATCH, arguments.timed)
    paths = references(count)
    starts = jax.vmap(initial_state_from_reference)(jnp.asarray(paths))
    one = jax.jit(lambda r, s: solve_unicycle(r, s, FREE))
    many = jax.jit(jax.vmap(one))

    def pull(r, s):
        return jnp.sum(solve_unicycle(r, s, FREE).value.path ** 2)

    learn = jax.jit(jax.vmap(jax.grad(pull)))
    batch = (jnp.asarray(paths[:BATCH]), starts[:BATCH])
    compiled = once(one, paths[0], starts[0])[1] + once(many, *batch)[1]

    solved = [many(jnp.asarray(paths[k : k + BATCH]), starts[k : k + BATCH]) for k in range(0, count, BATCH)]
    controls = np.concatenate([np.asarray(part.value.controls, float) for part in solved])
    status = np.concatenate([np.asarray(part.status) for part in solved])
    double = np.asarray(starts, float)
    ours = np.array([cost_of(*row) for row in zip(controls, paths.astype(float), double)])

    ipopt = Ipopt()
    found: dict[str, list[float]] = {"reference": [], "straight": []}
    for reference, start in zip(paths[: arguments.paths].astype(float), double):
        for name, guess in guesses(reference, start).items():
            found[name].append(ipopt.cost(reference, start, guess))
    print(f"{machine()}, float32, N = {POINTS}")
    print(
        f"quality on {arguments.paths} references: {np.sum(~np.isfinite(ours))} not finite, "
        f"{np.mean(status[: arguments.paths] == 0):.2%} converged"
    )
    limits = {**{k: np.array(v) for k, v in found.items()}, "the better one": np.min(list(found.values()), axis=0)}
    for name, oracle in limits.items():
        within = ours[: arguments.paths] <= oracle * 1.001 + 1e-7
        print(f"  cost within 1e-3 of IPOPT from {name:15s} {np.mean(within):7.2%}")

    published = PublishedWay()
    theirs, singles, excess = [], [], []
    for k in range(arguments.timed):
        reference, start = paths[k].astype(float), double[k]
        plan, taken = once(published.plan, reference, start)
        theirs.append(taken)
        excess.append(cost_of(plan, reference, start) / ours[k])
        singles.append(timed(one, paths[k], starts[k], repeats=5).best)
    batched = timed(many, *batch, repeats=15).each(BATCH)
    learned = timed(learn, *(leaf[:16] for leaf in batch), repeats=15)
    peer = statistics.median(theirs)
    rows = {
        "published, one path": (min(theirs), peer),
        "one path": (min(singles), statistics.median(singles)),
        f"batch {BATCH}, a path": (batched.best, batched.median),
    }
    print(f"speed (compilation {compiled:.1f} s, not counted)      min ms   median ms   ratio to published (medians)")
    for name, (best, median) in rows.items():
        print(f"  {name:38s} {1e3 * best:9.3f} {1e3 * median:11.3f} {peer / median:9.0f}x")
    print(f"  {'batch 16 with gradient, whole batch':38s} {1e3 * learned.best:9.3f} {1e3 * learned.median:11.3f}")
    print(f"published way's cost over ours: median {statistics.median(excess):.3f}, largest {max(excess):.3f}")


if __name__ == "__main__":
    main()

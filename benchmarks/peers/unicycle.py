"""The unicycle tracking problem by others: IPOPT, the published way, and a textbook iLQR; all in double precision."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from benchmarks.problems.unicycle_references import POINTS
from iwalker_jax.optimization import UnicycleParameters

LINEARISATIONS = 100
FREE = UnicycleParameters()


def cost_of(controls: np.ndarray, reference: np.ndarray, start: np.ndarray) -> float:
    """Objective of controls under the true motion, in double precision."""
    theta = start[3] + np.concatenate([[0], np.cumsum(controls[:, 0])])
    speed = start[2] + np.concatenate([[0], np.cumsum(controls[:, 1])])
    steps = (speed * np.stack([np.cos(theta), np.sin(theta)])).T[:-1]
    path = start[:2] + np.concatenate([[[0, 0]], np.cumsum(steps, axis=0)])
    effort = FREE.turn_weight * np.sum(controls[:, 0] ** 2) + FREE.acceleration_weight * np.sum(controls[:, 1] ** 2)
    return float(FREE.position_weight * np.sum((path - reference) ** 2) + effort)


class Ipopt:
    """The same problem over states and controls for IPOPT."""

    def __init__(self) -> None:
        import casadi

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

    def plan(self, reference: np.ndarray, start: np.ndarray, guess: np.ndarray) -> np.ndarray:
        """Controls (N-1, 2) of the local optimum reached from guessed states (N, 4) and zero controls; NaN for none."""
        first = np.concatenate([guess.ravel(), np.zeros(2 * (POINTS - 1))])
        answer = self._solver(x0=first, p=np.concatenate([reference.ravel(), start]), lbg=0, ubg=0)
        controls = np.asarray(answer["x"]).ravel()[4 * POINTS :].reshape(POINTS - 1, 2)
        return controls if self._solver.stats()["success"] else np.full_like(controls, np.nan)


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
        import osqp
        from scipy import sparse

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


_RATES = tuple(0.5**k for k in range(10))
"""Step lengths of the line search, longest first."""

_TURNS = 200


def _moved(x: Array, u: Array) -> Array:
    """The unicycle [px, py, v, theta] a sample later, under controls [turn, acceleration]."""
    return x + jnp.stack([x[2] * jnp.cos(x[3]), x[2] * jnp.sin(x[3]), u[1], u[0]])


def _rolled(start: Array, controls: Array) -> Array:
    """(N, 4) states."""

    def step(x: Array, u: Array) -> tuple[Array, Array]:
        following = _moved(x, u)
        return following, following

    return jnp.concatenate([start[None], jax.lax.scan(step, start, controls)[1]])


def _cost(states: Array, controls: Array, reference: Array) -> Array:
    effort = FREE.turn_weight * jnp.sum(controls[:, 0] ** 2) + FREE.acceleration_weight * jnp.sum(controls[:, 1] ** 2)
    return FREE.position_weight * jnp.sum((states[:, :2] - reference) ** 2) + effort


def _gains(states: Array, controls: Array, reference: Array, damping: Array) -> tuple[Array, Array]:
    """Feedforward (N-1, 2) and feedback (N-1, 2, 4): the Riccati recursion about a trajectory, from its end."""
    A = jax.vmap(jax.jacfwd(_moved, 0))(states[:-1], controls)
    B = jax.vmap(jax.jacfwd(_moved, 1))(states[:-1], controls)
    Q = 2 * FREE.position_weight * jnp.diag(jnp.asarray([1.0, 1.0, 0.0, 0.0]))
    R = 2 * jnp.diag(jnp.asarray([FREE.turn_weight, FREE.acceleration_weight]))
    slopes = jnp.concatenate([2 * FREE.position_weight * (states[:, :2] - reference), jnp.zeros_like(states[:, :2])], 1)

    def back(carry: tuple[Array, Array], row: tuple[Array, ...]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        V, v = carry
        A, B, slope, u = row
        Quu = R + B.T @ V @ B + damping * jnp.eye(2)
        Qux, Qu, Qx = B.T @ V @ A, R @ u + B.T @ v, slope + A.T @ v
        solved = jnp.linalg.solve(Quu, jnp.concatenate([Qu[:, None], Qux], 1))
        k, K = -solved[:, 0], -solved[:, 1:]
        return (Q + A.T @ V @ A + Qux.T @ K, Qx + Qux.T @ k), (k, K)

    return jax.lax.scan(back, (Q, slopes[-1]), (A, B, slopes[:-1], controls), reverse=True)[1]


def textbook_ilqr(reference: Array, start: Array) -> Array:
    """Controls (N-1, 2) by iterative LQR from zero controls, as a textbook has it.

    Gauss-Newton Riccati sweeps, a line search over ten step lengths side by side, damping that grows where none of them
    gains and shrinks where one does, until the cost gains less than 1e-9 of itself, or than rounding lets one see.

    Args:
        reference: (N, 2) [m].
        start: (4,) px, py, v, theta.
    """

    small = max(1e-9, 10 * float(jnp.finfo(reference.dtype).eps))

    def turn(carry: tuple[Array, Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array, Array]:
        controls, cost, damping, _, count = carry
        states = _rolled(start, controls)
        k, K = _gains(states, controls, reference, damping)

        def tried(rate: Array) -> tuple[Array, Array]:
            def step(x: Array, row: tuple[Array, ...]) -> tuple[Array, tuple[Array, Array]]:
                planned, u, k, K = row
                u = u + rate * k + K @ (x - planned)
                return _moved(x, u), (x, u)

            last, (way, made) = jax.lax.scan(step, start, (states[:-1], controls, k, K))
            return made, _cost(jnp.concatenate([way, last[None]]), made, reference)

        made, costs = jax.vmap(tried)(jnp.asarray(_RATES))
        best = jnp.argmin(jnp.where(jnp.isfinite(costs), costs, jnp.inf))
        better = costs[best] < cost
        done = jnp.where(better, cost - costs[best] < small * cost, damping > 1e8)
        controls = jnp.where(better, made[best], controls)
        damping = jnp.clip(jnp.where(better, damping / 5, damping * 10), 1e-6, 1e9)
        return controls, jnp.where(better, costs[best], cost), damping, done, count + 1

    controls = jnp.zeros((POINTS - 1, 2), reference.dtype)
    cost = _cost(_rolled(start, controls), controls, reference)
    first = controls, cost, jnp.asarray(1.0, reference.dtype), jnp.asarray(False), jnp.asarray(0)
    return jax.lax.while_loop(lambda carry: ~carry[3] & (carry[4] < _TURNS), turn, first)[0]

"""Quadratic programs that break solvers, by name, in NumPy: each with the outcome an honest solver reports."""

from typing import NamedTuple

import numpy as np

SIZES = (8, 12)  # variables, rows of all but the special cases: one program shape


class UglyQp(NamedTuple):
    """min x'P x / 2 + q'x with low <= C x <= high; `outcome` is "solved", "infeasible", "unbounded", "not convex"
    or "no solution" (both of infeasible and unbounded).
    """

    P: np.ndarray
    q: np.ndarray
    C: np.ndarray
    low: np.ndarray
    high: np.ndarray
    outcome: str


def benign(rng: np.random.Generator, n: int = SIZES[0], m: int = SIZES[1], rank: int | None = None) -> UglyQp:
    """A feasible program with about half of its rows tight; a random walk of P's rank."""
    factor = rng.normal(size=(n, rank or n + 4))
    C, inside = rng.normal(size=(m, n)), rng.normal(size=n)
    middle = C @ inside
    low, high = middle - rng.exponential(0.5, m), middle + rng.exponential(0.5, m)
    return UglyQp(factor @ factor.T / n, 3 * rng.normal(size=n), C, low, high, "solved")


def ugly_qps(seed: int = 0) -> dict[str, UglyQp]:
    """One of each kind; those of SIZES come first."""
    rng = np.random.default_rng(seed)
    n, m = SIZES
    cases: dict[str, UglyQp] = {"benign": benign(rng)}

    base, inside = benign(rng), rng.normal(size=n)
    low, high = base.low.copy(), base.high.copy()
    low[:], high[:] = base.C @ inside - 1, base.C @ inside + 1
    low[:4] = high[:4] = (base.C @ inside)[:4]
    cases["equalities"] = base._replace(low=low, high=high)

    C = base.C.copy()
    C[6:] = C[:6]
    middle = (base.low + base.high)[:6] / 2
    cases["duplicate rows"] = base._replace(C=C, low=np.tile(middle - 0.3, 2), high=np.tile(middle + 0.3, 2))

    low, high = np.tile(middle - 0.3, 2), np.tile(middle + 0.3, 2)
    low[[0, 1, 6, 7]] = high[[0, 1, 6, 7]] = middle[[0, 1, 0, 1]]
    cases["duplicate equalities"] = base._replace(C=C, low=low, high=high)

    C = base.C.copy()
    C[1] = C[0] + 1e-2 * C[1]
    inside = rng.normal(size=n)
    low, high = C @ inside - 1, C @ inside + 1
    low[:2] = high[:2] = C[:2] @ inside
    cases["nearly dependent equalities"] = base._replace(C=C, low=low, high=high)

    cone = rng.normal(size=(m, n))
    cases["degenerate vertex"] = base._replace(C=cone, low=np.full(m, -np.inf), high=np.zeros(m))

    pyramid = np.zeros((m, n))
    for k in range(2):
        for row, (axis, sign) in enumerate(((0, 1), (0, -1), (1, 1), (1, -1))):
            pyramid[5 * k + row, [3 * k + axis, 3 * k + 2]] = sign, -0.5
        pyramid[5 * k + 4, 3 * k + 2] = 1
    pyramid[10:, 6:] = np.eye(2)
    low, high = np.full(m, -np.inf), np.zeros(m)
    low[4], high[4], low[9], high[9] = 0, 0, 1, 100
    low[10:], high[10:] = -1, 1
    cases["foot in the air"] = base._replace(C=pyramid, low=low, high=high)

    cases["one-sided"] = benign(rng)._replace(low=np.full(m, -np.inf))
    cases["no bounds"] = benign(rng)._replace(low=np.full(m, -np.inf), high=np.full(m, np.inf))
    cases["rows of zeros"] = benign(rng)
    cases["rows of zeros"].C[::4] = 0
    cases["rows of zeros"].low[::4], cases["rows of zeros"].high[::4] = -1, 1

    base, rows = benign(rng), 10 ** rng.uniform(-4, 4, m)
    cases["badly scaled rows"] = base._replace(C=rows[:, None] * base.C, low=rows * base.low, high=rows * base.high)
    base, columns = benign(rng), 10 ** rng.uniform(-2, 2, n)
    cases["badly scaled columns"] = base._replace(
        P=base.P * columns * columns[:, None], q=base.q * columns, C=base.C * columns
    )
    base = benign(rng)
    cases["tiny cost"] = base._replace(P=1e-6 * base.P, q=1e-6 * base.q)
    cases["huge cost"] = base._replace(P=1e6 * base.P, q=1e6 * base.q)
    cases["far from the free optimum"] = base._replace(q=1e3 * base.q)
    cases["zero linear cost"] = base._replace(q=np.zeros(n), low=-np.ones(m), high=np.ones(m))

    turn = np.linalg.qr(rng.normal(size=(n, n)))[0]
    base = benign(rng)
    cases["ill-conditioned"] = base._replace(P=turn @ np.diag(np.logspace(0, -5, n)) @ turn.T)
    cases["semidefinite"] = benign(rng, rank=4)
    cases["linear program"] = benign(rng)._replace(P=np.zeros((n, n)))

    base = benign(rng)
    C, low, high = base.C.copy(), base.low.copy(), base.high.copy()
    C[1] = C[0]
    low[1], high[1] = high[0] + 1, high[0] + 2
    cases["contradicting rows"] = UglyQp(base.P, base.q, C, low, high, "infeasible")
    low, high = base.low.copy(), base.high.copy()
    middle = base.C @ rng.normal(size=n)
    low[:10] = high[:10] = middle[:10] + rng.normal(size=10)
    cases["too many equalities"] = base._replace(low=low, high=high, outcome="infeasible")
    C = base.C.copy()
    C[2] = C[0] + C[1]
    low, high = np.full(m, -np.inf), np.full(m, np.inf)
    high[:2], low[2] = 1, 3
    cases["contradicting sum"] = base._replace(C=C, low=low, high=high, outcome="infeasible")
    cases["infeasible linear program"] = cases["contradicting sum"]._replace(P=np.zeros((n, n)), outcome="no solution")

    base = benign(rng, rank=4)
    cases["unbounded"] = base._replace(C=0 * base.C, low=-np.ones(m), high=np.ones(m), outcome="unbounded")
    ray = rng.normal(size=(m, n))
    ray[:, 0] = -np.abs(ray[:, 0])
    cost = np.diag(np.r_[0.0, np.ones(n - 1)])
    cases["unbounded along the rows"] = UglyQp(
        cost, np.r_[-1.0, np.zeros(n - 1)], ray, np.full(m, -np.inf), np.ones(m), "unbounded"
    )
    cases["not convex"] = benign(rng)
    cases["not convex"] = cases["not convex"]._replace(
        P=turn @ np.diag(np.r_[-1.0, np.ones(n - 1)]) @ turn.T, outcome="not convex"
    )

    cases["one variable"] = UglyQp(np.eye(1), np.array([3.0]), np.eye(1), np.array([-1.0]), np.array([1.0]), "solved")
    base = benign(rng)
    cases["no rows"] = base._replace(C=np.zeros((0, n)), low=np.zeros(0), high=np.zeros(0))
    return cases

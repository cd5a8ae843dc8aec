"""Quadratic programs that break solvers, by name: each with the outcome an honest solver reports."""

from typing import NamedTuple

import numpy as np

SIZES = (8, 12)  # variables, rows of all but the special cases: one program shape


class HardQp(NamedTuple):
    """min x'P x / 2 + q'x with low <= C x <= high; `outcome` is "solved", "infeasible", "unbounded", "not convex"
    or "no solution" (both of infeasible and unbounded).
    """

    P: np.ndarray
    q: np.ndarray
    C: np.ndarray
    low: np.ndarray
    high: np.ndarray
    outcome: str


Cases = dict[str, HardQp]


def benign(rng: np.random.Generator, n: int = SIZES[0], m: int = SIZES[1], rank: int | None = None) -> HardQp:
    """A feasible program with about half of its rows tight; P has the rank asked for."""
    factor = rng.normal(size=(n, rank or n + 4))
    C, inside = rng.normal(size=(m, n)), rng.normal(size=n)
    middle = C @ inside
    low, high = middle - rng.exponential(0.5, m), middle + rng.exponential(0.5, m)
    return HardQp(factor @ factor.T / n, 3 * rng.normal(size=n), C, low, high, "solved")


def hard_qps(seed: int = 0) -> Cases:
    """One of each kind; those of SIZES come first."""
    rng = np.random.default_rng(seed)
    cases = {"benign": benign(rng)}
    cases |= _dependent_rows(rng)
    cases |= _unusual_rows(rng)
    cases |= _badly_scaled(rng)
    rotation = np.linalg.qr(rng.normal(size=(SIZES[0], SIZES[0])))[0]
    cases |= _flat_costs(rng, rotation)
    cases |= _infeasible(rng)
    cases |= _without_minimum(rng, rotation)
    cases["one variable"] = HardQp(np.eye(1), np.array([3.0]), np.eye(1), np.array([-1.0]), np.array([1.0]), "solved")
    base = benign(rng)
    cases["no rows"] = base._replace(C=np.zeros((0, SIZES[0])), low=np.zeros(0), high=np.zeros(0))
    return cases


def _dependent_rows(rng: np.random.Generator) -> Cases:
    """Equalities and rows that repeat each other or nearly do, and more tight rows than variables."""
    n, m = SIZES
    cases: Cases = {}
    base, inside = benign(rng), rng.normal(size=n)
    low, high = base.C @ inside - 1, base.C @ inside + 1
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
    pyramid, low, high = _friction_pyramids()
    cases["foot in the air"] = base._replace(C=pyramid, low=low, high=high)
    return cases


def _friction_pyramids() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows and bounds of two contacts, the first of which may carry no force."""
    n, m = SIZES
    pyramid = np.zeros((m, n))
    for k in range(2):
        for row, (axis, sign) in enumerate(((0, 1), (0, -1), (1, 1), (1, -1))):
            pyramid[5 * k + row, [3 * k + axis, 3 * k + 2]] = sign, -0.5
        pyramid[5 * k + 4, 3 * k + 2] = 1
    pyramid[10:, 6:] = np.eye(2)
    low, high = np.full(m, -np.inf), np.zeros(m)
    low[4], high[4], low[9], high[9] = 0, 0, 1, 100
    low[10:], high[10:] = -1, 1
    return pyramid, low, high


def _unusual_rows(rng: np.random.Generator) -> Cases:
    """Rows that bound from one side, not at all, or say nothing."""
    m = SIZES[1]
    cases = {
        "one-sided": benign(rng)._replace(low=np.full(m, -np.inf)),
        "no bounds": benign(rng)._replace(low=np.full(m, -np.inf), high=np.full(m, np.inf)),
        "rows of zeros": benign(rng),
    }
    cases["rows of zeros"].C[::4] = 0
    cases["rows of zeros"].low[::4], cases["rows of zeros"].high[::4] = -1, 1
    return cases


def _badly_scaled(rng: np.random.Generator) -> Cases:
    """Rows, variables and costs of very different sizes."""
    n, m = SIZES
    cases: Cases = {}
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
    return cases


def _flat_costs(rng: np.random.Generator, rotation: np.ndarray) -> Cases:
    """Costs with little or no curvature in some directions."""
    n = SIZES[0]
    base = benign(rng)
    return {
        "ill-conditioned": base._replace(P=rotation @ np.diag(np.logspace(0, -5, n)) @ rotation.T),
        "semidefinite": benign(rng, rank=4),
        "linear program": benign(rng)._replace(P=np.zeros((n, n))),
    }


def _infeasible(rng: np.random.Generator) -> Cases:
    """Constraints that contradict each other."""
    n, m = SIZES
    cases: Cases = {}
    base = benign(rng)
    C, low, high = base.C.copy(), base.low.copy(), base.high.copy()
    C[1] = C[0]
    low[1], high[1] = high[0] + 1, high[0] + 2
    cases["contradicting rows"] = HardQp(base.P, base.q, C, low, high, "infeasible")
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
    return cases


def _without_minimum(rng: np.random.Generator, rotation: np.ndarray) -> Cases:
    """Costs that fall without limit or curve downwards."""
    n, m = SIZES
    base = benign(rng, rank=4)
    unbounded = base._replace(C=0 * base.C, low=-np.ones(m), high=np.ones(m), outcome="unbounded")
    ray = rng.normal(size=(m, n))
    ray[:, 0] = -np.abs(ray[:, 0])
    cost = np.diag(np.r_[0.0, np.ones(n - 1)])
    along = HardQp(cost, np.r_[-1.0, np.zeros(n - 1)], ray, np.full(m, -np.inf), np.ones(m), "unbounded")
    saddle = rotation @ np.diag(np.r_[-1.0, np.ones(n - 1)]) @ rotation.T
    return {
        "unbounded": unbounded,
        "unbounded along the rows": along,
        "not convex": benign(rng)._replace(P=saddle, outcome="not convex"),
    }

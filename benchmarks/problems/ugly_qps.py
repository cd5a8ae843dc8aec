"""Random quadratic programs of the characters that break solvers, each with what is known of it by construction.

All of one shape, so that a batch of them is one call. Unlike `hard_qps`, which has one of each kind, these are drawn by
the thousand: how badly scaled, how nearly singular and how slightly infeasible is random over many decades.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

SIZES = (6, 10)  # variables, rows


class UglyQp(NamedTuple):
    """min x'P x / 2 + q'x with low <= C x <= high.

    `fact` is "solvable", "infeasible", "unbounded" or "tie" (solvable, without a derivative by some entry).
    """

    P: np.ndarray
    q: np.ndarray
    C: np.ndarray
    low: np.ndarray
    high: np.ndarray
    fact: str


def _cost(rng: np.random.Generator, eigenvalues: np.ndarray) -> np.ndarray:
    rotation = np.linalg.qr(rng.normal(size=(SIZES[0], SIZES[0])))[0]
    return rotation @ np.diag(eigenvalues) @ rotation.T


def _around(rng: np.random.Generator, P: np.ndarray, width: float = 1.0) -> UglyQp:
    """A feasible program with the cost's Hessian given; its optimum is bounded where the cost is definite."""
    n, m = SIZES
    C = rng.normal(size=(m, n))
    middle = C @ rng.normal(size=n)
    low, high = middle - width * rng.exponential(0.5, m), middle + width * rng.exponential(0.5, m)
    return UglyQp(P, 3 * rng.normal(size=n), C, low, high, "solvable")


def _boxed(qp: UglyQp) -> UglyQp:
    """The first rows become bounds on the variables, so that nothing is unbounded."""
    n = SIZES[0]
    C, low, high = qp.C.copy(), qp.low.copy(), qp.high.copy()
    C[:n] = np.eye(n)
    low[:n], high[:n] = -10, 10
    middle = C[n:] @ np.full(n, 0.5)
    low[n:], high[n:] = middle - 1, middle + 1
    return qp._replace(C=C, low=low, high=high)


def in_units(qp: UglyQp, units: np.ndarray) -> UglyQp:
    """The same program with x measured in other units: x = units * x'."""
    return qp._replace(P=qp.P * units * units[:, None], q=qp.q * units, C=qp.C * units)


def badly_scaled(rng: np.random.Generator, decades: float) -> UglyQp:
    """Variables and rows in units that differ by many decades."""
    base = _around(rng, _cost(rng, 10 ** rng.uniform(-1, 0, SIZES[0])))
    rows = 10 ** rng.uniform(-decades / 2, decades / 2, SIZES[1])
    base = base._replace(C=rows[:, None] * base.C, low=rows * base.low, high=rows * base.high)
    return in_units(base, 10 ** rng.uniform(-decades / 2, decades / 2, SIZES[0]))


def nearly_singular(rng: np.random.Generator, decades: float) -> UglyQp:
    """One direction of the cost is almost flat."""
    eigenvalues = 10 ** rng.uniform(-1, 0, SIZES[0])
    eigenvalues[0] = 10 ** -rng.uniform(decades / 3, decades)
    return _around(rng, _cost(rng, eigenvalues))


def ill_conditioned(rng: np.random.Generator, decades: float) -> UglyQp:
    """Curvatures spread over many decades."""
    return _around(rng, _cost(rng, 10 ** -np.linspace(0, rng.uniform(decades / 3, decades), SIZES[0])))


def rank_deficient(rng: np.random.Generator, decades: float) -> UglyQp:
    """A cost of low rank; bounds on all variables."""
    n = SIZES[0]
    factor = rng.normal(size=(n, rng.integers(1, n)))
    return _boxed(_around(rng, factor @ factor.T))


def linear(rng: np.random.Generator, decades: float) -> UglyQp:
    """No quadratic cost, or one of some variables only, in units of their own."""
    n = SIZES[0]
    base = _boxed(_around(rng, np.diag(rng.integers(0, 2, n) * 1.0)))
    return in_units(base, 10.0 ** rng.uniform(-decades / 4, decades / 4, n))


def cheap(rng: np.random.Generator, decades: float) -> UglyQp:
    """Variables whose free optimum is far outside their bounds."""
    n = SIZES[0]
    return _boxed(_around(rng, np.diag(10 ** rng.uniform(-decades, 0, n))))


def unbounded(rng: np.random.Generator, decades: float) -> UglyQp:
    """A direction without cost and bound along which the linear cost falls."""
    n, m = SIZES
    base = _around(rng, _cost(rng, np.ones(n)))
    P, C, q, low = base.P.copy(), base.C.copy(), base.q.copy(), base.low.copy()
    free = rng.integers(n)
    P[free] = P[:, free] = 0
    P += P.T
    C[:, free] = -np.abs(C[:, free]) * rng.integers(0, 2, m)
    low[C[:, free] != 0] = -np.inf
    q[free] = -(10 ** rng.uniform(-decades / 3, 0))
    qp = UglyQp(P, q, C, low, base.high, "unbounded")
    return in_units(qp, 10.0 ** rng.uniform(-decades / 6, decades / 6, n))


def infeasible_by_little(rng: np.random.Generator, decades: float) -> UglyQp:
    """Two rows, or a row and the sum of two, that miss each other by a small part of their bounds."""
    base = _boxed(_around(rng, _cost(rng, np.ones(SIZES[0]))))
    C, low, high = base.C.copy(), base.low.copy(), base.high.copy()
    gap = 10 ** -rng.uniform(0, decades / 2)
    if rng.integers(2):
        C[-1] = C[-2] * 2.0 ** rng.integers(-3, 4)
        factor = C[-1, 0] / C[-2, 0]
        low[-1], high[-1] = factor * (high[-2] + gap), np.inf
    else:
        C[-3:-1] = np.round(64 * C[-3:-1]) / 64
        C[-1] = C[-2] + C[-3]
        low[-3:-1], high[-3:-1] = -np.inf, [1.0, 2.0]
        low[-1], high[-1] = 3 + gap, np.inf
    return base._replace(C=C, low=low, high=high, fact="infeasible")


def feasible_by_little(rng: np.random.Generator, decades: float) -> UglyQp:
    """Bands so narrow that they are nearly equalities, more of them than variables, and near-parallel rows."""
    n = SIZES[0]
    base = _around(rng, _cost(rng, np.ones(n)), width=10 ** -rng.uniform(1, decades / 2))
    C, inside = base.C.copy(), rng.normal(size=n)
    C[1] = C[0] + 10 ** -rng.uniform(0, decades / 3) * rng.normal(size=n)
    middle, half = C @ inside, (base.high - base.low) / 2
    return base._replace(C=C, low=middle - half, high=middle + half)


def nearly_dependent_equalities(rng: np.random.Generator, decades: float) -> UglyQp:
    """Equalities at a small angle to each other."""
    n = SIZES[0]
    base = _around(rng, _cost(rng, np.ones(n)))
    C, low, high, inside = base.C.copy(), base.low.copy(), base.high.copy(), rng.normal(size=n)
    C[1] = C[0] + 10 ** -rng.uniform(0, decades / 3) * rng.normal(size=n)
    middle = C @ inside
    low, high = middle - 1, middle + 1
    low[:3] = high[:3] = middle[:3]
    return base._replace(C=C, low=low, high=high)


def _at_a_vertex(rng: np.random.Generator, eigenvalues: np.ndarray, active: int) -> tuple[UglyQp, np.ndarray]:
    """A program whose optimum is known: the first rows are active at it from above. In quarters, which floats hold."""
    n, m = SIZES
    root = np.round(4 * rng.normal(size=(n, n))) / 4 * np.sqrt(eigenvalues)
    P = root @ root.T
    C, x = np.round(4 * rng.normal(size=(m, n))) / 4, np.round(2 * rng.normal(size=n)) / 2
    y = np.zeros(m)
    y[:active] = rng.integers(1, 5, active) / 4
    value = C @ x
    low, high = np.full(m, -np.inf), value + 1.0
    high[:active] = value[:active]
    return UglyQp(P, -P @ x - C.T @ y, C, low, high, "tie"), y


def about_to_change(rng: np.random.Generator, decades: float) -> UglyQp:
    """A bound that touches without pushing."""
    qp, y = _at_a_vertex(rng, np.ones(SIZES[0]), 3)
    return qp._replace(q=qp.q + y[0] * qp.C[0])


def row_given_twice(rng: np.random.Generator, decades: float) -> UglyQp:
    """An active row a second time, or an inequality on an equality."""
    qp, _ = _at_a_vertex(rng, np.ones(SIZES[0]), 3)
    C, low, high = qp.C.copy(), qp.low.copy(), qp.high.copy()
    C[-1], high[-1] = C[0], high[0]
    if rng.integers(2):
        low[0] = high[0]
    return qp._replace(C=C, low=low, high=high)


def flat(rng: np.random.Generator, decades: float) -> UglyQp:
    """A variable without any cost, held by nothing but its own wide bounds."""
    n = SIZES[0]
    qp, _ = _at_a_vertex(rng, np.ones(n), 3)
    P, C, q, low, high = qp.P.copy(), qp.C.copy(), qp.q.copy(), qp.low.copy(), qp.high.copy()
    loose = rng.integers(n)
    P[loose] = P[:, loose] = q[loose] = 0
    C[:, loose] = 0
    C[-1], low[-1], high[-1] = np.eye(n)[loose], -50, 50
    return UglyQp(P, q, C, low, high, "tie")


CHARACTERS: tuple[Callable[[np.random.Generator, float], UglyQp], ...] = (
    badly_scaled,
    nearly_singular,
    ill_conditioned,
    rank_deficient,
    linear,
    cheap,
    unbounded,
    infeasible_by_little,
    feasible_by_little,
    nearly_dependent_equalities,
    about_to_change,
    row_given_twice,
    flat,
)


_BY_UNITS = (badly_scaled, linear)


def _rounded(qp: UglyQp, dtype: type[np.floating]) -> UglyQp:
    P, q, C, low, high = (np.asarray(a, dtype) for a in (qp.P, qp.q, qp.C, qp.low, qp.high))
    return UglyQp(P, q, C, low, high, qp.fact)


def ugly_qps(count: int, seed: int, dtype: type[np.floating]) -> dict[str, list[UglyQp]]:
    """So many of each character, rounded to a precision; double precision is given twice the decades."""
    rng = np.random.default_rng(seed)
    decades = 12.0 if dtype is np.float32 else 24.0
    return {
        make.__name__: [
            _rounded(make(rng, decades if make in _BY_UNITS else decades / 1.5), dtype) for _ in range(count)
        ]
        for make in CHARACTERS
    }

"""Other QP solvers on a sequence of dense programs, in time order, in double precision.

Every program has new matrices, so handing them over is in the time, as it is in ours; conversions to a format are not.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

_FAR = 1e20
"""Stands for no bound where infinity is not taken."""

_ROOM = 1e-8
"""Half the width that equal bounds are given where a solver needs an inside, or calls degenerate ones inconsistent."""


class Programs(NamedTuple):
    """min x'P x / 2 + q'x with low <= C x <= high, T of them in time order: (T, n, n), (T, n), (T, m, n), (T, m)."""

    P: np.ndarray
    q: np.ndarray
    C: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def objective(self, x: np.ndarray) -> np.ndarray:
        """(T,) of points (T, n)."""
        return np.einsum("ti,tij,tj->t", x, self.P, x) / 2 + np.sum(self.q * x, axis=1)

    def violation(self, x: np.ndarray) -> np.ndarray:
        """(T,) by which the worst row of points (T, n) lies outside its bounds."""
        value = np.einsum("tij,tj->ti", self.C, x)
        return np.max(np.maximum(np.maximum(value - self.high, self.low - value), 0), axis=1)


Solve = Callable[[], np.ndarray]
"""Solves the whole sequence; returns points (T, n)."""


def stacked_rows(C: np.ndarray, low: np.ndarray, high: np.ndarray, slack: float = 0.0) -> tuple[np.ndarray, ...]:
    """Equality rows first, then G x >= h, and the number of equalities."""
    equal = (low == high) & (slack == 0)
    below, above = np.isfinite(low) & ~equal, np.isfinite(high) & ~equal
    G = np.concatenate([C[equal], C[below], -C[above]])
    h = np.concatenate([low[equal], low[below] - slack, -high[above] - slack])
    return G, h, np.asarray(equal.sum())


def clarabel_points(programs: Programs) -> np.ndarray:
    """The judge: an interior-point method at 1e-10; (T, n)."""
    import clarabel
    from scipy import sparse

    points = []
    for P, q, C, low, high in zip(*programs, strict=True):
        G, h, equalities = stacked_rows(C, low, high)
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
        cones = [clarabel.ZeroConeT(int(equalities)), clarabel.NonnegativeConeT(len(h) - int(equalities))]
        solver = clarabel.DefaultSolver(sparse.csc_matrix(np.triu(P)), q, sparse.csc_matrix(-G), -h, cones, settings)
        points.append(np.asarray(solver.solve().x))
    return np.stack(points)


def quadprog_solver(programs: Programs) -> Solve:
    """Goldfarb and Idnani's dual method in C, from no guess."""
    import quadprog

    prepared = []
    for P, q, C, low, high in zip(*programs, strict=True):
        G, h, equalities = stacked_rows(C, low, high, _ROOM)
        prepared.append((P, -q, np.ascontiguousarray(G.T), h, int(equalities)))
    return lambda: np.stack([quadprog.solve_qp(*each)[0] for each in prepared])


def daqp_solver(programs: Programs) -> Solve:
    """A dual active-set method in C, from no guess: its equalities are named anew at every tick, which clears one."""
    import daqp

    prepared = []
    for P, q, C, low, high in zip(*programs, strict=True):
        equalities = np.where(low == high, 5, 0).astype(np.int32)
        bounds = np.minimum(high, _FAR), np.maximum(low, -_FAR)
        prepared.append((P, q, np.ascontiguousarray(C), *bounds, equalities))
    return lambda: np.stack([daqp.solve(*each)[0] for each in prepared])


def _proxqp_filled(solver: Any, programs: Programs, t: int) -> Any:
    """A fresh ProxQP object with the program of a tick.

    From the last tick's answer, or updated in place, proxsuite 0.8 returns points outside the bounds of these programs.
    """
    solver.settings.eps_abs = 1e-6
    low, high = np.maximum(programs.low[t], -_FAR), np.minimum(programs.high[t], _FAR)
    solver.init(programs.P[t], programs.q[t], None, None, programs.C[t], low, high)
    return solver


def proxqp_solver(programs: Programs) -> Solve:
    """ProxQP's dense back end at 1e-6, from no guess."""
    from proxsuite import proxqp

    length, n = programs.q.shape

    def solve() -> np.ndarray:
        points = np.empty((length, n))
        for t in range(length):
            solver = _proxqp_filled(proxqp.dense.QP(n, 0, programs.low.shape[1]), programs, t)
            solver.solve()
            points[t] = solver.results.x
        return points

    return solve


def proxqp_in_parallel(programs: Programs, threads: int) -> Solve:
    """ProxQP's own batch at 1e-6, on some threads."""
    from proxsuite import proxqp

    length, n = programs.q.shape

    def solve() -> np.ndarray:
        # Room for all of them at once: a vector that grows moves what was handed out.
        batch = proxqp.dense.BatchQP(length)
        size = n, 0, programs.low.shape[1]
        solvers = [_proxqp_filled(batch.init_qp_in_place(*size), programs, t) for t in range(length)]
        proxqp.dense.solve_in_parallel(batch, threads)
        return np.stack([solver.results.x for solver in solvers])

    return solve


def osqp_solver(programs: Programs) -> Solve:
    """OSQP at 1e-5, set up for every program and started from the last one's answer."""
    import osqp
    from scipy import sparse

    costs = [sparse.csc_matrix(np.triu(P)) for P in programs.P]
    rows = [sparse.csc_matrix(C) for C in programs.C]

    def solve() -> np.ndarray:
        points = np.empty(programs.q.shape)
        last = None
        for t, bounds in enumerate(zip(programs.low, programs.high, strict=True)):
            solver = osqp.OSQP()
            solver.setup(costs[t], programs.q[t], rows[t], *bounds, verbose=False, eps_abs=1e-5, eps_rel=1e-5)
            if last is not None:
                solver.warm_start(x=last.x, y=last.y)
            last = solver.solve(raise_error=False)
            points[t] = last.x
        return points

    return solve


def moreau_solver(programs: Programs) -> Solve:
    """Moreau's interior-point method on the CPU, its own batch, from no guess."""
    import moreau
    from scipy import sparse

    length, n = programs.q.shape
    rows = [stacked_rows(*each, slack=_ROOM) for each in zip(programs.C, programs.low, programs.high, strict=True)]
    m = rows[0][0].shape[0]
    square, wide = sparse.csr_matrix(np.ones((n, n))), sparse.csr_matrix(np.ones((m, n)))
    solver = moreau.CompiledSolver(
        n=n,
        m=m,
        P_row_offsets=square.indptr,
        P_col_indices=square.indices,
        A_row_offsets=wide.indptr,
        A_col_indices=wide.indices,
        cones=moreau.Cones(num_nonneg_cones=m),
        settings=moreau.Settings(device="cpu", batch_size=length),
    )
    costs = programs.P.reshape(length, -1)
    matrices = np.stack([-G for G, _, _ in rows]).reshape(length, -1)
    bounds = np.stack([-h for _, h, _ in rows])

    def solve() -> np.ndarray:
        solver.setup(costs, matrices)
        return np.asarray(solver.solve(programs.q, bounds).x)

    return solve


def qpax_solver(programs: Programs) -> Solve:
    """qpax's interior-point method in JAX, in double precision, all programs in one batch."""
    import qpax

    rows = [stacked_rows(*each, slack=_ROOM) for each in zip(programs.C, programs.low, programs.high, strict=True)]
    with jax.enable_x64(True):
        no_rows, no_bounds = jnp.zeros((0, programs.q.shape[1])), jnp.zeros(0)
        arguments = (
            jnp.asarray(programs.P),
            jnp.asarray(programs.q),
            jnp.asarray(np.stack([-G for G, _, _ in rows])),
            jnp.asarray(np.stack([-h for _, h, _ in rows])),
        )
        one = jax.jit(jax.vmap(lambda P, q, G, h: qpax.solve_qp(P, q, no_rows, no_bounds, G, h)[0]))
    return partial(_in_double, one, arguments)


def mpax_solver(programs: Programs) -> Solve:
    """MPAX's first-order method (PDHG) in JAX at 1e-6, one program after the other."""
    import mpax

    rows = [stacked_rows(*each, slack=_ROOM) for each in zip(programs.C, programs.low, programs.high, strict=True)]
    n = programs.q.shape[1]
    with jax.enable_x64(True):
        free = jnp.full(n, jnp.inf)
        none = jnp.zeros((0, n)), jnp.zeros(0)
        made = [
            mpax.create_qp(*map(jnp.asarray, (P, q)), *none, *map(jnp.asarray, (G, h)), -free, free, False)
            for P, q, (G, h, _) in zip(programs.P, programs.q, rows, strict=True)
        ]
        method = mpax.raPDHG(eps_abs=1e-6, eps_rel=1e-6, iteration_limit=50000)
        solve = jax.jit(lambda program: method.optimize(program).primal_solution)
    return lambda: np.stack([_in_double(solve, (program,)) for program in made])


def _in_double(program: Callable, arguments: tuple) -> np.ndarray:
    with jax.enable_x64(True):
        return np.asarray(program(*arguments))


class Peer(NamedTuple):
    """Where a solver comes from, what makes it ready for a sequence, and what is special about it.

    Attributes:
        module, package: to import, and to install.
        make: ready for a sequence.
        compiles: whether its first call compiles.
        most: programs that it is given, because it would take minutes for all; 0 for all.
    """

    module: str
    package: str
    make: Callable[[Programs], Solve]
    compiles: bool = False
    most: int = 0


ONE_BY_ONE: dict[str, Peer] = {
    "quadprog": Peer("quadprog", "quadprog", quadprog_solver),
    "DAQP": Peer("daqp", "daqp", daqp_solver),
    "ProxQP 1e-6": Peer("proxsuite", "proxsuite", proxqp_solver),
    "OSQP 1e-5": Peer("osqp", "osqp", osqp_solver),
}
"""Peers that are given one program at a time, as a control loop does."""

IN_BATCHES: dict[str, Peer] = {
    "DAQP, one by one": ONE_BY_ONE["DAQP"],
    "ProxQP 1e-6, 2 threads": Peer("proxsuite", "proxsuite", partial(proxqp_in_parallel, threads=2)),
    "qpax, double": Peer("qpax", "qpax", qpax_solver, compiles=True),
    "Moreau on the CPU": Peer("moreau", "moreau", moreau_solver),
    "MPAX 1e-6": Peer("mpax", "mpax", mpax_solver, compiles=True, most=4),
}
"""Peers that take many programs at once, and the fastest of those that do not."""

PACKAGES = {peer.module: peer.package for peer in (*ONE_BY_ONE.values(), *IN_BATCHES.values())}

"""Derivatives of a quadratic program's solution: through its optimality conditions, or through ADMM's iterations."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.optimization.qp.admm import Splitting, admm
from iwalker_jax.optimization.qp.factor import Factor, factorise
from iwalker_jax.optimization.qp.settings import QpSettings
from iwalker_jax.optimization.qp.verdicts import QpIterate
from iwalker_jax.optimization.solution import Status
from iwalker_jax.promotion import usual_promotion

Data = tuple[Array, ...]
_REFINEMENTS = 3


def _conditions(P: Array, C: Array, active: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """The symmetric KKT operator with the active set held; inactive rows say y = 0."""
    y_active = jnp.where(active, y, 0)
    return P @ x + C.T @ y_active, jnp.where(active, C @ x, -y)


def _solver(P: Array, C: Array, active: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Solve with the KKT operator by a factorisation of its equilibrated, slightly regularised self, refined."""
    n = P.shape[0]
    dtype = P.dtype
    noise = 10 * jnp.finfo(dtype).eps
    diagonal = jnp.diagonal(P)
    d = jax.lax.rsqrt(jnp.where(diagonal > noise * jnp.max(diagonal), diagonal, jnp.maximum(jnp.max(diagonal), noise)))
    rows = jnp.where(active[:, None], C * d, 0)
    length = jnp.linalg.norm(rows, axis=1)
    e = jnp.where(length > 0, 1 / jnp.where(length > 0, length, 1), 1)
    corner = jnp.where(active, -noise, -1.0).astype(dtype)
    upper = jnp.concatenate([P * d[:, None] * d + noise * jnp.eye(n, dtype=dtype), (rows * e[:, None]).T], axis=1)
    lower = jnp.concatenate([rows * e[:, None], jnp.diag(corner)], axis=1)
    factor = jax.scipy.linalg.lu_factor(jnp.concatenate([upper, lower]))
    inactive = jnp.where(active, e, 1)

    def once(force: Array, miss: Array) -> tuple[Array, Array]:
        step = jax.scipy.linalg.lu_solve(factor, jnp.concatenate([force * d, miss * inactive]))
        return step[:n] * d, step[n:] * inactive

    def solve(force: Array, miss: Array) -> tuple[Array, Array]:
        x, y = once(force, miss)
        for _ in range(_REFINEMENTS):
            left, gap = _conditions(P, C, active, x, y)
            dx, dy = once(force - left, miss - gap)
            x, y = x + dx, y + dy
        finite = jnp.all(jnp.isfinite(x)) & jnp.all(jnp.isfinite(y))
        return jnp.where(finite, x, 0), jnp.where(finite, y, 0)

    return solve


@jax.custom_jvp
def differentiable(
    data: Data, x: Float[Array, " n"], y: Float[Array, " m"], sides: Int[Array, " m"], meaningful: Bool[Array, ""]
) -> tuple[Float[Array, " n"], Float[Array, " m"]]:
    """The solution (x, y) unchanged, with its derivatives by the implicit function theorem.

    Args:
        data: P, q, C, low, high.
        x, y, sides: as found; without derivatives of their own.
        meaningful: whether there is an optimum; where not, derivatives are zero.
    """
    return x, y


@differentiable.defjvp
@usual_promotion
def _differentiate(primals: tuple, tangents: tuple) -> tuple:
    (P, _, C, _, _), x, y, sides, meaningful = primals
    dP, dq, dC, dlow, dhigh = tangents[0]
    active = (sides != 0) & meaningful
    point, held = jnp.where(meaningful, x, 0), jnp.where(active, y, 0)
    force = jnp.where(meaningful, -(dP @ point + dq + dC.T @ held), 0)
    bound = jnp.where(sides > 0, dhigh, dlow)
    miss = jnp.where(active, bound - dC @ point, 0)
    solve = _solver(P, C, active)
    n = x.shape[0]
    # One vector, for the solve transposes only if all of its right-hand side depends on the tangents.
    change = jax.lax.custom_linear_solve(
        lambda v: jnp.concatenate(_conditions(P, C, active, v[:n], v[n:])),
        jnp.concatenate([force, miss]),
        lambda _, b: jnp.concatenate(solve(b[:n], b[n:])),
        symmetric=True,
    )
    return (x, y), (change[:n], change[n:])


def unrolled(
    data: Data, guess: tuple[Array, Array], settings: QpSettings
) -> tuple[tuple[Float[Array, " n"], Float[Array, " m"]], QpIterate]:
    """ADMM alone for a fixed number of iterations, differentiable through all of them; and how good it is."""
    P, q, C, low, high = data
    factor = factorise(P, C)
    empty = factor.lengths == 0
    finite_low, finite_high = jnp.isfinite(low) & ~empty, jnp.isfinite(high) & ~empty
    scaled_low = jnp.where(finite_low, jnp.where(finite_low, low, 0) * factor.lengths, -jnp.inf)
    scaled_high = jnp.where(finite_high, jnp.where(finite_high, high, 0) * factor.lengths, jnp.inf)
    shift = factor.root @ q
    start = Splitting(
        (C @ guess[0]) * factor.lengths, jnp.where(empty, 0, guess[1] / jnp.where(empty, 1, factor.lengths))
    )
    penalty = jnp.asarray(settings.penalty, q.dtype)
    state, _ = admm(
        factor.gram,
        -factor.rows.T @ shift,
        scaled_low,
        scaled_high,
        start,
        penalty,
        settings.relaxation,
        settings.admm_iterations,
    )
    x = -factor.root.T @ (shift + factor.rows @ state.y)
    return (x, state.y * factor.lengths), _rate(data, factor, x, state, settings)


def _rate(data: Data, factor: Factor, x: Array, state: Splitting, settings: QpSettings) -> QpIterate:
    """Judge ADMM's point; a proximal term it did not re-centre counts as an error."""
    P, q, C, low, high = jax.lax.stop_gradient(data)
    factor, x, state = jax.lax.stop_gradient((factor, x, state))
    sides = jnp.where(state.y > 0, 1, jnp.where(state.y < 0, -1, 0)).astype(jnp.int32)
    value = C @ x
    miss = (value - jnp.clip(value, low, high)) * factor.lengths
    bound = jnp.where(sides > 0, high, low)
    gap = jnp.where(sides != 0, (value - bound) * factor.lengths, 0)
    force = factor.root @ (P @ x + q + C.T @ (state.y * factor.lengths))
    scale = jnp.maximum(jnp.linalg.norm(factor.root @ (P @ x + factor.excess * x)), jnp.finfo(x.dtype).tiny)
    residual = jnp.max(jnp.abs(jnp.concatenate([miss, gap, force]))) / scale
    finite = jnp.isfinite(residual)
    residual = jnp.where(finite, residual, jnp.inf)
    tolerance = settings.tolerance_for(x.dtype)
    status = jnp.where(residual <= tolerance, Status.CONVERGED, Status.MAX_ITERATIONS).astype(jnp.int32)
    # ADMM holds no active set: its derivatives are those of its iterations, whatever the optimum is like.
    iterations, always = jnp.asarray(settings.admm_iterations, jnp.int32), jnp.full_like(residual, jnp.inf)
    return QpIterate(x, state.y, sides, status, residual, finite, always, iterations)

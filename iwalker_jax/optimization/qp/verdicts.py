"""Verdicts of the solver: how good a point is, and proofs that a program has no solution.

Arrays carry their batch as the last axis (see `factor`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.optimization.qp.active_set import ActiveSet, RowBounds
from iwalker_jax.optimization.qp.factor import Factor, apply, apply_transposed, largest
from iwalker_jax.optimization.solution import Status

DEPENDENT = {4: 2e-5, 8: 1e-10}
"""Schur complement that counts as zero, by the bytes of a number."""
_CERTIFICATE = {4: 1e-3, 8: 1e-6}  # largest relative error of a proof that there is no solution


class ScaledProgram(NamedTuple):
    """A program with its factorisation and the bounds of its scaled rows.

    Attributes:
        P, q, C: as in `QuadraticProgram`.
        bounds: of the scaled rows.
        factor: of P and C.
    """

    P: Float[Array, "n n *b"]
    q: Float[Array, " n *b"]
    C: Float[Array, "m n *b"]
    bounds: RowBounds
    factor: Factor


class QpIterate(NamedTuple):
    """A primal-dual point and how good it is; shapes as in `factor`.

    Attributes:
        x, y: (n, *b), (m, *b) variables and multipliers.
        sides: (m, *b) int, independent active rows: +1 at high, -1 at low.
        status, residual: (*b,), (*b,).
        regular: (*b,) bool, no row is about to become active or inactive.
        pivots: () pivots of the longest search, all rounds together.
    """

    x: Float[Array, " n *b"]
    y: Float[Array, " m *b"]
    sides: Int[Array, " m *b"]
    status: Int[Array, "*b"]
    residual: Float[Array, "*b"]
    regular: Bool[Array, "*b"]
    pivots: Int[Array, ""]


def admissible_multipliers(bounds: RowBounds, y: Float[Array, " m *b"]) -> Float[Array, " m *b"]:
    """Multipliers with those of absent bounds, and those that are not finite, set to zero."""
    above, below = jnp.where(jnp.isfinite(bounds.high), y, 0), jnp.where(jnp.isfinite(bounds.low), y, 0)
    y = jnp.where(y > 0, above, below)
    return jnp.where(jnp.isfinite(y), y, 0)


def optimality_residual(
    program: ScaledProgram, x: Float[Array, " n *b"], y: Float[Array, " m *b"]
) -> tuple[Float[Array, "*b"], Float[Array, " m *b"], Float[Array, "*b"]]:
    """Largest of stationarity, violation and complementarity in the metric of the cost, relative to their scale.

    Args:
        x: variables.
        y: scaled multipliers, which must have their signs already.

    Returns:
        The residual, the scaled constraint values w and the scale.
    """
    factor, low, high = program.factor, program.bounds.low, program.bounds.high
    values = apply(program.C, x) * factor.lengths
    image = apply(program.P, x)
    stationarity = apply(factor.root, image + program.q + apply_transposed(program.C, y * factor.lengths))
    violation = jnp.maximum(jnp.maximum(values - high, low - values), 0)
    bound = jnp.where(y > 0, high, low)
    complementarity = jnp.where(y != 0, jnp.abs(values - bound), 0)
    energy = jnp.sqrt(jnp.maximum(jnp.sum(x * (image + factor.excess * x), axis=0), 0))
    cost = apply(factor.root, program.q)
    eps = jnp.finfo(x.dtype).eps
    floor = jnp.sqrt(eps) * jnp.sqrt(jnp.sum(cost * cost, axis=0))
    scale = jnp.maximum(energy, jnp.maximum(floor, largest(jnp.where(y != 0, bound, 0))))
    scale = jnp.maximum(scale, jnp.finfo(x.dtype).tiny)
    worst = jnp.maximum(largest(stationarity), jnp.maximum(largest(violation), largest(complementarity)))
    return worst / scale, values, scale


def assess(
    program: ScaledProgram, found: ActiveSet, x: Float[Array, " n *b"], y: Float[Array, " m *b"], tolerance: float
) -> tuple[QpIterate, Float[Array, " m *b"], Float[Array, "*b"]]:
    """The point of an active set with its residual, CONVERGED or MAX_ITERATIONS, and whether the set is stable.

    Returns:
        The iterate (y still scaled), the scaled constraint values w and the scale of the residual.
    """
    bounds, m = program.bounds, y.shape[0]
    y = admissible_multipliers(bounds, jnp.where(found.sides * y < 0, jnp.where(bounds.equality, y, 0), y))
    residual, values, scale = optimality_residual(program, x, y)
    residual = jnp.where(jnp.isfinite(residual), residual, jnp.inf)
    diagonal = jnp.stack([found.matrix[i, i] for i in range(m)])
    edge = jnp.maximum(4 * residual, tolerance / 100) * scale
    slope = jnp.abs(1 / jnp.minimum(diagonal, -1e-30))
    weak = (found.sides != 0) & ~bounds.equality & (jnp.abs(y) * slope < edge)
    room = jnp.minimum(bounds.high - values, values - bounds.low)
    near = (found.sides == 0) & (room < edge) & (diagonal > DEPENDENT[x.dtype.itemsize])
    regular = ~jnp.any(weak | near, axis=0)
    status = jnp.where(residual <= tolerance, Status.CONVERGED, Status.MAX_ITERATIONS).astype(jnp.int32)
    sides = found.sides.astype(jnp.int32)
    return QpIterate(x, y, sides, status, residual, regular, found.pivots), values, scale


def proves_infeasible(
    program: ScaledProgram, values: Float[Array, " m *b"], scale: Float[Array, "*b"], tolerance: float
) -> Bool[Array, "*b"]:
    """Farkas' certificate: the rows' violations, as multipliers, leave no direction that lessens them all."""
    violation = values - jnp.clip(values, program.bounds.low, program.bounds.high)
    length = jnp.sqrt(jnp.sum(violation * violation, axis=0))
    slope = apply(program.factor.rows, violation)
    steep = jnp.sqrt(jnp.sum(slope * slope, axis=0))
    return (length > tolerance * scale) & (steep <= _CERTIFICATE[values.dtype.itemsize] * length)


def proves_unbounded(
    program: ScaledProgram, direction: Float[Array, " n *b"], x: Float[Array, " n *b"]
) -> Bool[Array, "*b"]:
    """Whether the cost falls along a direction in which it does not bend and no bound is met."""
    bounds, factor, dtype = program.bounds, program.factor, x.dtype
    weights = jnp.stack([program.P[k, k] for k in range(x.shape[0])]) + factor.excess
    length = jnp.sqrt(jnp.maximum(jnp.sum(weights * direction * direction, axis=0), jnp.finfo(dtype).tiny))
    direction = direction / length
    bent = jnp.sqrt(jnp.maximum(jnp.sum(direction * apply(program.P, direction), axis=0), 0))
    values = apply(program.C, direction) * factor.lengths
    above, below = jnp.where(jnp.isfinite(bounds.high), values, 0), jnp.where(jnp.isfinite(bounds.low), -values, 0)
    leaves = jnp.maximum(above, below)
    slope, total = jnp.sum(program.q * direction, axis=0), jnp.sum(jnp.abs(program.q * direction), axis=0)
    small = _CERTIFICATE[dtype.itemsize]
    far = length > 0.1 * jnp.sqrt(jnp.sum(weights * x * x, axis=0))
    return far & (bent <= small) & (largest(leaves) <= small) & (slope < -small * total) & (total > 0)


def prove_failure(
    program: ScaledProgram,
    iterate: QpIterate,
    values: Float[Array, " m *b"],
    scale: Float[Array, "*b"],
    step: Float[Array, " n *b"],
    blocked: Bool[Array, "*b"],
    tolerance: float,
) -> tuple[QpIterate, Bool[Array, "*b"]]:
    """Look for a proof that there is no solution; the iterate gets its status if there is one.

    Args:
        iterate, values, scale: as `assess` returns them.
        step: what the round moved x by, the direction along which the cost may fall for ever.
        blocked: problems whose search ended at contradicting constraints.
        tolerance: residual of a solution.
    """
    # Proofs of failure are rare and not looked for where no problem of the chunk gives cause.
    never = jnp.zeros(blocked.shape, bool)
    infeasible = blocked & jax.lax.cond(
        jnp.any(blocked), lambda: proves_infeasible(program, values, scale, tolerance), lambda: never
    )
    status = jnp.where(infeasible, Status.INFEASIBLE, iterate.status)
    unbounded = ~blocked & (jnp.max(program.factor.excess, axis=0) > 0)
    unbounded &= jax.lax.cond(jnp.any(unbounded), lambda: proves_unbounded(program, step, iterate.x), lambda: never)
    unbounded &= iterate.residual > tolerance
    status = jnp.where(unbounded, Status.UNBOUNDED, status)
    return iterate._replace(status=status.astype(jnp.int32)), infeasible | unbounded


def keep_better(new: QpIterate, old: QpIterate, improved: Bool[Array, "*b"]) -> QpIterate:
    """The new iterate where it is an improvement; pivots add up."""
    kept = jax.tree.map(
        lambda a, b: jnp.where(improved, a, b), new._replace(pivots=old.status), old._replace(pivots=old.status)
    )
    return kept._replace(pivots=old.pivots + new.pivots)

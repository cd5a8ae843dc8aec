"""How good a point is, in the metric of the cost and row by row, and how far its active set is from changing.

Arrays carry their batch as the last axis (see `factor`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.optimization.qp.active_set import ActiveSet, RowBounds
from iwalker_jax.optimization.qp.factor import Factor, apply, apply_transposed, fold, largest
from iwalker_jax.optimization.solution import Status

_NOISE = 64  # roundings that a sum of products is granted, relative to the sum of its terms' sizes
DEPENDENT = {4: 2e-5, 8: 1e-10}
"""Schur complement that counts as zero, by the bytes of a number."""
_ROW_SHARE = 1 / 128  # of the tolerance: rows that miss each other by a tolerance are not to look met
_ROW_NOISE = 16  # roundings that a row's value is granted: refinement reaches that
_LEAST_CURVATURE = {4: 1e-3, 8: 1e-6}  # reduced curvature of a unique minimiser, by the bytes of a number


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
        regular: (*b,) bool, whether the point has derivatives that can be trusted.
        margin: (*b,) how far it is from losing them (see `regularity`).
        pivots: () pivots of the longest search, all rounds together.
    """

    x: Float[Array, " n *b"]
    y: Float[Array, " m *b"]
    sides: Int[Array, " m *b"]
    status: Int[Array, "*b"]
    residual: Float[Array, "*b"]
    regular: Bool[Array, "*b"]
    margin: Float[Array, "*b"]
    pivots: Int[Array, ""]


class Assessment(NamedTuple):
    """A judged point.

    Attributes:
        y: (m, *b) scaled multipliers with their signs right.
        values: (m, *b) scaled constraint values w.
        residual: (*b,) see `optimality_residual`.
        scale: (*b,) size of the solution in the metric of the cost.
    """

    y: Float[Array, " m *b"]
    values: Float[Array, " m *b"]
    residual: Float[Array, "*b"]
    scale: Float[Array, "*b"]


def noise(dtype: jnp.dtype) -> float:
    """Relative size of what may be rounding of a sum of products."""
    return _NOISE * float(jnp.finfo(dtype).eps)


def speck(dtype: jnp.dtype) -> float:
    """Relative size of what corrections leave where nothing should be: more than a rounding of a rounding."""
    return float(jnp.finfo(dtype).eps) ** 1.5


def relative(error: Array, allowed: Array) -> Array:
    """The error over what is allowed; nothing is no error, and what overflows allows none."""
    allowed = jnp.where(jnp.isfinite(allowed), jnp.maximum(allowed, jnp.finfo(error.dtype).tiny), 0)
    return jnp.where(error == 0, 0, error / allowed)


def admissible_multipliers(bounds: RowBounds, y: Float[Array, " m *b"]) -> Float[Array, " m *b"]:
    """Multipliers with those of absent bounds, and those that are not finite, set to zero."""
    above, below = jnp.where(jnp.isfinite(bounds.high), y, 0), jnp.where(jnp.isfinite(bounds.low), y, 0)
    y = jnp.where(y > 0, above, below)
    return jnp.where(jnp.isfinite(y), y, 0)


def optimality_residual(
    program: ScaledProgram, x: Float[Array, " n *b"], y: Float[Array, " m *b"], tolerance: float, well_posed: bool
) -> Assessment:
    """Judge a point whose multipliers have their signs.

    Stationarity counts in the metric of the cost relative to the solution's size in it, or, where rounding alone makes
    that too much to ask, variable by variable relative to the rounding of its own terms. The latter alone counts where
    the cost is singular and its metric in part made up. Violation and complementarity count row by row, relative to
    the row's own bound but for the rounding of its own terms: in one scale for all, large rows would hide small ones.
    In programs that are known to be well posed all count in the metric of the cost alone.
    """
    factor, low, high = program.factor, program.bounds.low, program.bounds.high
    values = apply(program.C, x) * factor.lengths
    image, pushed = apply(program.P, x), y * factor.lengths
    force = image + program.q + apply_transposed(program.C, pushed)
    stationarity = apply(factor.root, force)
    violation = jnp.maximum(jnp.maximum(values - high, low - values), 0)
    bound = jnp.where(y > 0, high, low)
    complementarity = jnp.where(y != 0, jnp.abs(values - bound), 0)
    energy = jnp.sqrt(jnp.maximum(jnp.sum(x * (image + factor.excess * x), axis=0), 0))
    cost = apply(factor.root, program.q)
    free = jnp.sqrt(jnp.sum(cost * cost, axis=0))
    floor = jnp.sqrt(jnp.finfo(x.dtype).eps) * free
    scale = jnp.maximum(energy, jnp.maximum(floor, largest(jnp.where(y != 0, bound, 0))))
    scale = jnp.maximum(scale, jnp.finfo(x.dtype).tiny)
    miss = jnp.maximum(violation, complementarity)
    if well_posed:
        residual = jnp.maximum(largest(stationarity), largest(miss)) / scale
        residual = jnp.where(jnp.isfinite(residual) & jnp.isfinite(scale), residual, jnp.inf)
        return Assessment(y, values, residual, scale)

    metric = relative(largest(stationarity), energy)
    rounding, size, nothing = noise(x.dtype), jnp.abs(x), speck(x.dtype) * jnp.maximum(energy, free)
    terms = apply(jnp.abs(program.C), size) * factor.lengths
    nearest = jnp.abs(jnp.clip(values, low, high))
    eps = float(jnp.finfo(x.dtype).eps)
    allowed = _ROW_SHARE * tolerance * nearest + _ROW_NOISE * eps * terms + eps / 4 * energy
    row = largest(relative(miss, allowed))
    singular = jnp.max(factor.excess, axis=0) > 0

    def by_variable() -> Array:
        pulls = apply(jnp.abs(program.P), size) + jnp.abs(program.q)
        pulls += apply_transposed(jnp.abs(program.C), jnp.abs(pushed))
        exact = tolerance * largest(relative(jnp.abs(force), rounding * pulls + nothing))
        return jnp.where(singular, exact, jnp.minimum(metric, exact))

    dual = jax.lax.cond(jnp.any(singular | ~(metric <= tolerance)), by_variable, lambda: metric)
    residual = jnp.maximum(dual, tolerance * row)
    residual = jnp.where(jnp.isfinite(residual) & jnp.isfinite(scale), residual, jnp.inf)
    return Assessment(y, values, residual, scale)


def nearly_feasible(
    program: ScaledProgram, assessment: Assessment, x: Float[Array, " n *b"], tolerance: float
) -> Bool[Array, "*b"]:
    """Whether all rows hold but for the square root of the tolerance, relative to their terms."""
    values, bounds = assessment.values, program.bounds
    violation = jnp.maximum(jnp.maximum(values - bounds.high, bounds.low - values), 0)
    terms = apply(jnp.abs(program.C), jnp.abs(x)) * program.factor.lengths
    nothing = speck(x.dtype) * assessment.scale
    return largest(relative(violation, tolerance**0.5 * terms + nothing)) <= 1


def assess(
    program: ScaledProgram,
    found: ActiveSet,
    x: Float[Array, " n *b"],
    y: Float[Array, " m *b"],
    tolerance: float,
    well_posed: bool,
) -> Assessment:
    """Judge the point of an active set."""
    bounds = program.bounds
    y = admissible_multipliers(bounds, jnp.where(found.sides * y < 0, jnp.where(bounds.equality, y, 0), y))
    return optimality_residual(program, x, y, tolerance, well_posed)


def rate(
    program: ScaledProgram,
    found: ActiveSet,
    x: Float[Array, " n *b"],
    assessment: Assessment,
    tolerance: float,
    well_posed: bool,
) -> QpIterate:
    """The point of an active set with its verdict, CONVERGED or MAX_ITERATIONS, and what its derivatives are worth."""
    residual = assessment.residual
    status = jnp.where(residual <= tolerance, Status.CONVERGED, Status.MAX_ITERATIONS).astype(jnp.int32)
    regular, margin = regularity(program, found, assessment, tolerance, well_posed)
    return QpIterate(x, assessment.y, found.sides.astype(jnp.int32), status, residual, regular, margin, found.pivots)


def regularity(
    program: ScaledProgram, found: ActiveSet, assessment: Assessment, tolerance: float, well_posed: bool
) -> tuple[Bool[Array, "*b"], Float[Array, "*b"]]:
    """Whether the solution may be differentiated by every entry of the program, and by what margin.

    The margin is the least of three: how far an inactive row is from its bounds, how far an active inequality would
    move if it were released, both in the metric of the cost relative to the solution's size, and the least curvature
    of the cost in the directions that the active rows leave free, relative to the metric. A row at its bound that
    depends on the active ones counts: moving its bound moves the solution on one side only. In programs that are known
    to be well posed it does not count, and the curvature is not looked at.
    """
    bounds, factor, values, y = program.bounds, program.factor, assessment.values, assessment.y
    active = found.sides != 0
    diagonal = jnp.stack([found.matrix[i, i] for i in range(y.shape[0])])
    push = jnp.abs(y) / jnp.maximum(-diagonal, 1e-30)
    room = jnp.maximum(jnp.minimum(bounds.high - values, values - bounds.low), 0)
    if well_posed:
        room = jnp.where(diagonal > DEPENDENT[y.dtype.itemsize], room, jnp.inf)
    distance = jnp.where(active, jnp.where(bounds.equality, jnp.inf, push), room)
    nearest = fold(jnp.minimum, distance) / assessment.scale
    cost = apply(factor.root, program.q)
    rounding = noise(y.dtype) * jnp.sqrt(jnp.sum(cost * cost, axis=0)) / assessment.scale
    least = jnp.maximum(jnp.maximum(4 * assessment.residual, tolerance / 10), rounding)
    if well_posed:
        return (nearest > least) & ~(jnp.max(factor.excess, axis=0) > 0), nearest
    curvature = jax.lax.cond(
        jnp.any(factor.excess > 0), lambda: reduced_curvature(factor, found), lambda: jnp.ones_like(nearest)
    )
    return (nearest > least) & (curvature > _LEAST_CURVATURE[y.dtype.itemsize]), jnp.minimum(nearest, curvature)


def reduced_curvature(factor: Factor, found: ActiveSet) -> Float[Array, "*b"]:
    """Least z'P z over z'H z of all directions z that the active rows leave free: 0 where a minimiser is not unique.

    H = P + E, and N = V'(1 - W_A' S_AA^-1 W_A) V is H's inverse on those directions, so that it is one less the
    largest eigenvalue of E^1/2 N E^1/2.
    """
    active = jnp.where(found.sides != 0, 1, 0).astype(factor.root.dtype)
    held = found.matrix * active[:, None] * active[None]
    root, rows, held = (jnp.moveaxis(a, (0, 1), (-2, -1)) for a in (factor.root, factor.rows, held))
    sunk = root * jnp.moveaxis(jnp.sqrt(factor.excess), 0, -1)[..., None, :]
    image = jnp.swapaxes(rows, -1, -2) @ sunk
    inverse = jnp.swapaxes(sunk, -1, -2) @ sunk + jnp.swapaxes(image, -1, -2) @ held @ image
    return 1 - jnp.linalg.eigvalsh((inverse + jnp.swapaxes(inverse, -1, -2)) / 2)[..., -1]


def keep_better(new: QpIterate, old: QpIterate, improved: Bool[Array, "*b"]) -> QpIterate:
    """The new iterate where it is an improvement; pivots add up."""
    kept = jax.tree.map(
        lambda a, b: jnp.where(improved, a, b), new._replace(pivots=old.status), old._replace(pivots=old.status)
    )
    return kept._replace(pivots=old.pivots + new.pivots)

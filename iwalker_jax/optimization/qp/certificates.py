"""Proofs that a program has no solution, each checked within the rounding of its own terms.

What a proof claims must hold for the program itself, or for one whose entries differ from it by roundings: then no
badly scaled variable, loose tolerance or unlucky search can make it false. Arrays carry their batch as the last axis.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.optimization.qp.active_set import ActiveSet
from iwalker_jax.optimization.qp.factor import Factor, apply, apply_transposed, largest
from iwalker_jax.optimization.qp.verdicts import (
    Assessment,
    ScaledProgram,
    admissible_multipliers,
    noise,
    relative,
    speck,
)

_POLISHES = 3  # corrections of a proof by its own error
_STILL = {4: 1e-3, 8: 1e-6}  # slope of the violation over the violation where no step lessens it further


def newton_step(
    factor: Factor, found: ActiveSet, force: Float[Array, " n *b"], gap: Float[Array, " m *b"]
) -> tuple[Float[Array, " n *b"], Float[Array, " m *b"]]:
    """Changes of x and of the scaled multipliers that take away a force and the active rows' gaps."""
    active = found.sides != 0
    step = -apply(factor.root, force)
    gap = jnp.where(active, gap + apply_transposed(factor.rows, step), 0)
    change = jnp.where(active, -apply(found.matrix, gap), 0)
    return apply_transposed(factor.root, step - apply(factor.rows, change)), change


def cancelling(program: ScaledProgram, found: ActiveSet, y: Float[Array, " m *b"]) -> Float[Array, " m *b"]:
    """Scaled multipliers with those of the active rows corrected so that C'y vanishes as nearly as it can."""
    factor, active = program.factor, found.sides != 0
    for _ in range(_POLISHES):
        left = apply(factor.root, apply_transposed(program.C, y * factor.lengths))
        toward = jnp.where(active, apply_transposed(factor.rows, left), 0)
        y = y + jnp.where(active, apply(found.matrix, toward), 0)
    return y


def proves_infeasible(program: ScaledProgram, y: Float[Array, " m *b"], x: Float[Array, " n *b"]) -> Bool[Array, "*b"]:
    """Farkas' lemma: multipliers y with C'y = 0 and sup over the bounds of y'w negative.

    Args:
        program: the program.
        y: scaled multipliers.
        x: a point of about the size that a feasible one would have.
    """
    factor, bounds, rounding = program.factor, program.bounds, noise(x.dtype)
    y = admissible_multipliers(bounds, y)
    y = y / jnp.maximum(largest(y), jnp.finfo(y.dtype).tiny)
    weights = y * factor.lengths
    left = jnp.abs(apply_transposed(program.C, weights))
    terms = apply_transposed(jnp.abs(program.C), jnp.abs(weights))
    bound = jnp.where(y > 0, bounds.high, jnp.where(y < 0, bounds.low, 0))
    reach = apply(jnp.abs(program.C), jnp.abs(x)) * factor.lengths
    least = rounding * jnp.sum(jnp.abs(y) * (jnp.abs(bound) + reach), axis=0)
    cancels = largest(relative(left, rounding * terms + speck(x.dtype) * largest(terms))) <= 1
    return cancels & (-jnp.sum(y * bound, axis=0) > least)


def violates_least(program: ScaledProgram, assessment: Assessment) -> tuple[Bool[Array, "*b"], Float[Array, " m *b"]]:
    """Whether no step lessens the violations' sum of squares any more; and the violations, upwards positive."""
    violation = assessment.values - jnp.clip(assessment.values, program.bounds.low, program.bounds.high)
    length = jnp.sqrt(jnp.sum(violation * violation, axis=0))
    slope = apply(program.factor.rows, violation)
    steep = jnp.sqrt(jnp.sum(slope * slope, axis=0))
    return steep <= _STILL[violation.dtype.itemsize] * length, violation


def proves_unbounded(program: ScaledProgram, found: ActiveSet, direction: Float[Array, " n *b"]) -> Bool[Array, "*b"]:
    """Whether the cost falls along a direction in which it does not bend and no bound is met."""
    bounds, factor, dtype = program.bounds, program.factor, direction.dtype
    for _ in range(_POLISHES):
        gap = apply(program.C, direction) * factor.lengths
        direction = direction + newton_step(factor, found, apply(program.P, direction), gap)[0]
        direction = direction / jnp.maximum(largest(direction), jnp.finfo(dtype).tiny)
    size, rounding, nothing = jnp.abs(direction), noise(dtype), speck(dtype)
    bent = relative(jnp.abs(apply(program.P, direction)), rounding * apply(jnp.abs(program.P), size) + nothing)
    values = apply(program.C, direction)
    leaving = jnp.maximum(
        jnp.where(jnp.isfinite(bounds.high), values, 0), jnp.where(jnp.isfinite(bounds.low), -values, 0)
    )
    leaves = relative(leaving, rounding * apply(jnp.abs(program.C), size) + nothing)
    slope, terms = jnp.sum(program.q * direction, axis=0), jnp.sum(jnp.abs(program.q) * size, axis=0)
    return (largest(bent) <= 1) & (largest(leaves) <= 1) & (slope < -rounding * terms)


def proves_not_convex(P: Float[Array, "n n *b"], factor: Factor) -> Bool[Array, "*b"]:
    """Whether the cost curves downwards along the direction of its least curvature, or in a plane of two variables."""

    def look() -> Array:
        matrix = jnp.moveaxis(P, (0, 1), (-2, -1))
        n, eps = matrix.shape[-1], float(jnp.finfo(P.dtype).eps)
        diagonal = jnp.diagonal(matrix, axis1=-2, axis2=-1)
        below = jnp.any(diagonal < 0, axis=-1)
        highest = jnp.sqrt(jnp.maximum(diagonal, 0))
        # Entries of a semidefinite matrix are at most the geometric mean of their diagonal ones.
        planes = jnp.any(jnp.abs(matrix) > (1 + 16 * eps) * highest[..., None] * highest[..., None, :], axis=(-1, -2))
        lowest = jnp.linalg.eigh(matrix)[1][..., 0]
        size = jnp.abs(lowest)
        curvature = jnp.sum(lowest * (matrix @ lowest[..., None])[..., 0], axis=-1)
        terms = jnp.sum(size * (jnp.abs(matrix) @ size[..., None])[..., 0], axis=-1)
        return below | planes | (curvature < -(n + 8) * eps * terms)

    singular = jnp.any(factor.excess > 0)
    return jax.lax.cond(singular, look, lambda: jnp.zeros(factor.pivot.shape, bool))

"""Newton's method with an exact line search for the contact problem (contact_solver.py), written for batches.

Everything carries the batch as the last axes and keeps the limb pattern of the mass matrix (limbs.py); a contact
touches one limb, so its rows keep the pattern. Sums that many consumers share are accumulated in loops, because XLA
would otherwise recompute them inside each consumer.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.robot.batching import batch_last
from iwalker_jax.robot.limbs import (
    BASE,
    LimbMatrix,
    Limbs,
    LimbVector,
    join_vector,
    multiply,
    pad,
    solve,
    split_matrix,
    split_vector,
)


class _Rows(NamedTuple):
    """One-sided rows by limb; c limbs can touch something, with at most r rows each.

    Attributes:
        base: (c, r, 6, *b) and limb: (c, r, width, *b) Jacobians of the contact rows.
        stiffness, reference: (c, r, *b).
        limit_signs, limit_stiffness, limit_reference: (limbs, width, *b).
    """

    base: Array
    limb: Array
    stiffness: Array
    reference: Array
    limit_signs: Array
    limit_stiffness: Array
    limit_reference: Array


class _State(NamedTuple):
    """An iterate: acceleration, its inertial force, the rows' J q - a, the cost's gradient, and whether to go on."""

    acceleration: LimbVector
    inertial: LimbVector
    contact_slack: Float[Array, "c r *b"]
    limit_slack: Float[Array, "limbs width *b"]
    gradient: LimbVector
    residual: Float[Array, "*b"]
    iterations: Int[Array, "*b"]
    running: Bool[Array, "*b"]


def minimise(limbs: Limbs, max_iterations: int, tolerance: float) -> Callable[..., tuple[Array, Array, Array]]:
    """The solver as a function of a `ContactProblem`'s fields and a first guess; it is not differentiable.

    Returns acceleration (n,), relative residual () and iterations (). A batch runs until its last entry is done;
    entries that are done stay as they are.
    """

    def run(
        mass: Array,
        force: Array,
        limit_signs: Array,
        limit_stiffness: Array,
        limit_reference: Array,
        rows: Array,
        stiffness: Array,
        reference: Array,
        start: Array,
    ) -> tuple[Array, Array, Array]:
        inertia, smooth = split_matrix(limbs, mass), split_vector(limbs, force)
        split_limits = [
            split_vector(limbs, jnp.pad(x, [(BASE, 0)] + [(0, 0)] * (x.ndim - 1))).limbs
            for x in (limit_signs, limit_stiffness, limit_reference)
        ]
        sided = _Rows(*_split_rows(limbs, rows, stiffness, reference), *split_limits)
        small = tolerance or 8 * float(jnp.finfo(mass.dtype).eps)
        state = _begin(limbs, inertia, smooth, sided, split_vector(limbs, jnp.where(jnp.isfinite(start), start, 0)))
        state = jax.lax.while_loop(
            lambda s: jnp.any(s.running & (s.iterations < max_iterations)),
            lambda s: _advance(limbs, inertia, smooth, sided, small, s),
            state,
        )
        acceleration = join_vector(limbs, state.acceleration)
        return jnp.where(jnp.isfinite(state.residual), acceleration, jnp.nan), state.residual, state.iterations

    return batch_last(run)


def _begin(limbs: Limbs, inertia: LimbMatrix, smooth: LimbVector, rows: _Rows, acceleration: LimbVector) -> _State:
    """The first iterate."""
    inertial = multiply(inertia, acceleration)
    contact, limit = _along(limbs, rows, acceleration)
    contact, limit = contact - rows.reference, limit - rows.limit_reference
    gradient, residual = _gradient(limbs, smooth, rows, inertial, contact, limit)
    running = jnp.isfinite(residual)
    return _State(
        acceleration, inertial, contact, limit, gradient, residual, jnp.zeros_like(running, jnp.int32), running
    )


def _advance(limbs: Limbs, inertia: LimbMatrix, smooth: LimbVector, rows: _Rows, small: float, state: _State) -> _State:
    """One Newton step, for the batch entries that are not done."""
    contact_active, limit_active = _pressing(rows, state.contact_slack, state.limit_slack)
    hessian = _hessian(
        limbs,
        inertia,
        rows,
        jnp.where(contact_active, rows.stiffness, 0),
        jnp.where(limit_active, rows.limit_stiffness, 0),
    )
    step = jax.tree.map(jnp.negative, solve(hessian, state.gradient))
    step_inertial = multiply(inertia, step)
    contact_change, limit_change = _along(limbs, rows, step)
    length = _line_search(
        _dot(step, state.inertial) - _dot(step, smooth),
        _dot(step, step_inertial),
        _flat(state.contact_slack, state.limit_slack),
        _flat(contact_change, limit_change),
        _flat(rows.stiffness, rows.limit_stiffness),
    )

    def move(x: Array, change: Array) -> Array:
        return x + length * change

    acceleration = jax.tree.map(move, state.acceleration, step)
    inertial = jax.tree.map(move, state.inertial, step_inertial)
    contact, limit = move(state.contact_slack, contact_change), move(state.limit_slack, limit_change)
    gradient, residual = _gradient(limbs, smooth, rows, inertial, contact, limit)
    contact_now, limit_now = _pressing(rows, contact, limit)
    same = jnp.all(contact_now == contact_active, (0, 1)) & jnp.all(limit_now == limit_active, (0, 1))
    running = ~same & (residual > small) & jnp.isfinite(residual)
    new = _State(acceleration, inertial, contact, limit, gradient, residual, state.iterations + 1, running)
    return jax.tree.map(lambda a, b: jnp.where(state.running, a, b), new, state)


def _split_rows(limbs: Limbs, rows: Array, stiffness: Array, reference: Array) -> tuple[Array, Array, Array, Array]:
    """Contact rows by the limb they touch; limbs with fewer rows get idle ones."""
    most = 4 * max(limbs.contacts.count(limb) for limb in limbs.touching)
    parts = []
    for limb in limbs.touching:
        chosen = [k for k, touched in enumerate(limbs.contacts) if touched == limb]

        def gather(array: Array, chosen: list[int] = chosen) -> Array:
            return pad(jnp.concatenate([array[4 * k : 4 * k + 4] for k in chosen]), most - 4 * len(chosen), 1)

        first, size = limbs.starts[limb], limbs.sizes[limb]
        own = jnp.swapaxes(pad(jnp.swapaxes(gather(rows[:, first : first + size]), 0, 1), limbs.width - size, 1), 0, 1)
        parts.append((gather(rows[:, :BASE]), own, gather(stiffness), gather(reference)))
    base, own, stiff, wanted = (jnp.stack(part) for part in zip(*parts, strict=True))
    return base, own, stiff, wanted


def _pressing(rows: _Rows, contact_slack: Array, limit_slack: Array) -> tuple[Array, Array]:
    """Which contact rows and limits press."""
    return (contact_slack < 0) & (rows.stiffness > 0), (limit_slack < 0) & (rows.limit_stiffness > 0)


def _along(limbs: Limbs, rows: _Rows, vector: LimbVector) -> tuple[Array, Array]:
    """Jacobian times a vector: contact rows and limits."""
    own = jnp.stack([vector.limbs[limb] for limb in limbs.touching])
    contact = jnp.zeros_like(rows.reference)
    for k in range(BASE):
        contact = contact + rows.base[:, :, k] * vector.base[k]
    for k in range(limbs.width):
        contact = contact + rows.limb[:, :, k] * own[:, k, None]
    return contact, rows.limit_signs * vector.limbs


def _gradient(
    limbs: Limbs, smooth: LimbVector, rows: _Rows, inertial: LimbVector, contact: Array, limit: Array
) -> tuple[LimbVector, Array]:
    """Gradient of the cost, and its largest entry relative to the largest inertial or smooth force."""
    push = rows.stiffness * jnp.minimum(contact, 0)
    base = inertial.base - smooth.base
    own = jnp.zeros_like(rows.limb[:, 0])
    for r in range(push.shape[1]):
        own = own + rows.limb[:, r] * push[:, r, None]
        for c in range(push.shape[0]):
            base = base + rows.base[c, r] * push[c, r]
    joint = inertial.limbs - smooth.limbs + rows.limit_signs * rows.limit_stiffness * jnp.minimum(limit, 0)
    gradient = LimbVector(base, _add_touching(limbs, joint, own))
    return gradient, _largest(gradient) / jnp.maximum(_largest(inertial), _largest(smooth))


def _hessian(limbs: Limbs, inertia: LimbMatrix, rows: _Rows, stiffness: Array, limit_stiffness: Array) -> LimbMatrix:
    """Inertia and the pressing rows' stiffness."""

    def add_row(r: Array, total: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        base, own = (jax.lax.dynamic_index_in_dim(x, r, 1, keepdims=False) for x in (rows.base, rows.limb))
        weight = jax.lax.dynamic_index_in_dim(stiffness, r, 1, keepdims=False)[:, None]
        both = sum((weight * base)[c][:, None] * base[c][None] for c in range(base.shape[0]))
        return (
            total[0] + both,
            total[1] + (weight * own)[:, :, None] * base[:, None],
            total[2] + (weight * own)[:, :, None] * own[:, None],
        )

    start = (
        inertia.base,
        jnp.stack([inertia.coupling[limb] for limb in limbs.touching]),
        jnp.stack([inertia.limbs[limb] for limb in limbs.touching]),
    )
    base, coupling, own = jax.lax.fori_loop(0, rows.stiffness.shape[1], add_row, start)
    diagonal = jnp.eye(limbs.width, dtype=base.dtype).reshape(limbs.width, limbs.width, *(1,) * (base.ndim - 2))
    blocks = _replace_touching(limbs, inertia.limbs, own) + limit_stiffness[:, :, None] * diagonal
    return LimbMatrix(base, _replace_touching(limbs, inertia.coupling, coupling), blocks)


def _line_search(slope: Array, curvature: Array, slack: Array, change: Array, stiffness: Array) -> Array:
    """Exact minimiser along a direction of the piecewise quadratic cost.

    The derivative grows linearly between the kinks, the lengths where a row starts or stops pressing: it is evaluated
    at all of them, and its zero lies in the interval where it changes sign.

    Args:
        slope, curvature: (*b) derivatives at 0 of the cost without rows.
        slack, change, stiffness: (m, *b) of the rows, slack at 0 and its rate.
    """
    kinks = jnp.where(slack * change < 0, -slack / jnp.where(change == 0, 1, change), 0)

    def add_row(k: Array, total: Array) -> Array:
        here, rate, stiff = (jax.lax.dynamic_index_in_dim(x, k, 0) for x in (slack, change, stiffness))
        return total + stiff * rate * jnp.minimum(here + kinks * rate, 0)

    derivative = jax.lax.fori_loop(0, slack.shape[0], add_row, slope + curvature * kinks)
    low = jnp.max(jnp.where(derivative < 0, kinks, 0), 0)
    high = jnp.min(jnp.where((kinks > 0) & (derivative >= 0), kinks, jnp.inf), 0)
    middle = jnp.where(jnp.isfinite(high), (low + high) / 2, low + 1)
    pressing = jnp.where(slack + middle * change < 0, stiffness * change, 0)
    return -(slope + jnp.sum(pressing * slack, 0)) / (curvature + jnp.sum(pressing * change, 0))


def _add_touching(limbs: Limbs, all_limbs: Array, touching: Array) -> Array:
    """Add what the touching limbs contribute to an array over all limbs."""
    return _replace_touching(limbs, all_limbs, touching + jnp.stack([all_limbs[limb] for limb in limbs.touching]))


def _replace_touching(limbs: Limbs, all_limbs: Array, touching: Array) -> Array:
    """Replace the touching limbs in an array over all limbs."""
    parts = [all_limbs[limb] for limb in range(all_limbs.shape[0])]
    for k, limb in enumerate(limbs.touching):
        parts[limb] = touching[k]
    return jnp.stack(parts)


def _flat(contact: Array, limit: Array) -> Array:
    """Contact rows and limits as one leading axis."""
    return jnp.concatenate([x.reshape(-1, *x.shape[2:]) for x in (contact, limit)])


def _dot(a: LimbVector, b: LimbVector) -> Array:
    """Inner product."""
    return jnp.sum(a.base * b.base, 0) + jnp.sum(a.limbs * b.limbs, (0, 1))


def _largest(vector: LimbVector) -> Array:
    """Largest magnitude of an entry."""
    return jnp.maximum(jnp.max(jnp.abs(vector.base), 0), jnp.max(jnp.abs(vector.limbs), (0, 1)))

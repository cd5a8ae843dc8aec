"""A quadratic program in the metric of its own cost: one factorisation, after which everything is a small product.

Notation of the qp_* modules: min x'P x / 2 + q'x with low <= C x <= high; H = P + diag(excess) is positive definite,
H^-1 = V'V, W = C V' with its rows scaled to length one (the scaling by sqrt(c'H^-1 c)), S = W W'. Constraint values
and multipliers in scaled rows are w and y. Arrays carry their batch, if any, as the LAST axis (shown as *b): the small
loops then vectorise over problems, which is several times faster on a CPU than a batch in front.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

# Pivots of the scaled P lost in rounding become this: a proximal term that leaves S well conditioned.
LIFTED = 0.1


class Factor(NamedTuple):
    """The program in its own metric.

    Attributes:
        root: (n, n, *b) V.
        excess: (n, *b) what was added to the diagonal of P where it is singular: the metric of a proximal term.
        rows: (n, m, *b) W', columns of length one; zero where a row of C is zero.
        lengths: (m, *b) factor from a row of C to the scaled one.
        gram: (m, m, *b) S.
        pivot: (*b,) smallest pivot of P with its diagonal scaled to one; negative means P is not convex.
    """

    root: Float[Array, "n n *b"]
    excess: Float[Array, "n *b"]
    rows: Float[Array, "n m *b"]
    lengths: Float[Array, "m *b"]
    gram: Float[Array, "m m *b"]
    pivot: Float[Array, "*b"]


def apply(matrix: Float[Array, "r c *b"], vector: Float[Array, "c *b"]) -> Float[Array, "r *b"]:
    """Matrix times vector."""
    if vector.ndim == 1:
        return matrix @ vector
    begin = jnp.zeros((matrix.shape[0], *vector.shape[1:]), vector.dtype)
    take = jax.lax.dynamic_index_in_dim

    def add(k: Array, total: Array) -> Array:
        return total + take(matrix, k, 1, keepdims=False) * take(vector, k, keepdims=False)

    return jax.lax.fori_loop(0, vector.shape[0], add, begin)


def apply_transposed(matrix: Float[Array, "r c *b"], vector: Float[Array, "r *b"]) -> Float[Array, "c *b"]:
    """Matrix' times vector."""
    if vector.ndim == 1:
        return vector @ matrix
    begin = jnp.zeros((matrix.shape[1], *vector.shape[1:]), vector.dtype)
    take = jax.lax.dynamic_index_in_dim

    def add(k: Array, total: Array) -> Array:
        return total + take(matrix, k, keepdims=False) * take(vector, k, keepdims=False)

    return jax.lax.fori_loop(0, vector.shape[0], add, begin)


def fold(operation: Callable[[Array, Array], Array], values: Float[Array, "m *b"]) -> Float[Array, "*b"]:
    """Reduce along the first axis by an idempotent operation (maximum, minimum), as a tree of elementwise ones."""
    while values.shape[0] > 1:
        half = (values.shape[0] + 1) // 2
        values = operation(values[:half], values[values.shape[0] - half :])
    return values[0]


def largest(values: Float[Array, "m *b"]) -> Float[Array, "*b"]:
    """Largest magnitude."""
    return fold(jnp.maximum, jnp.abs(values))


def factorise(P: Float[Array, "n n *b"], C: Float[Array, "m n *b"]) -> Factor:
    """Cholesky factorisation that carries C and the identity along and gathers S on the way.

    A pivot that is not safely positive is lifted to a small one (Gill and Murray's modified Cholesky).
    """
    n, m, dtype = P.shape[0], C.shape[0], P.dtype
    tiny = jnp.finfo(dtype).tiny
    least = 50 * float(jnp.finfo(dtype).eps)
    diagonal = jnp.stack([P[k, k] for k in range(n)])
    # A variable without a cost of its own is scaled like the dearest one.
    largest = jnp.max(diagonal, axis=0)
    reference = jnp.where(diagonal > 1e-3 * least * largest, diagonal, jnp.where(largest > 0, largest, 1))
    scale = jax.lax.rsqrt(jnp.maximum(reference, tiny))
    batch = P.shape[2:]
    identity = jnp.broadcast_to(jnp.eye(n, dtype=dtype).reshape((n, n) + (1,) * len(batch)), P.shape)
    start = jnp.concatenate(
        [P * scale[:, None] * scale[None], jnp.swapaxes(C, 0, 1) * scale[:, None], identity], axis=1
    )
    index = jnp.arange(n).reshape((n,) + (1,) * len(batch))

    def eliminate(k: Array, carry: tuple) -> tuple:
        stack, gram, excess, smallest = carry
        line = jax.lax.dynamic_index_in_dim(stack, k, keepdims=False)
        own = jax.lax.dynamic_index_in_dim(line, k, keepdims=False)
        lifted = jnp.where(own < least, LIFTED, own)
        column = line[:n] + jnp.where(index == k, lifted - own, 0)
        root = jnp.sqrt(lifted)
        line = jnp.concatenate([column, line[n:]]) / root
        away = jnp.where(index > k, line[:n], jnp.where(index == k, root - 1, 0))
        stack = stack - away[:, None] * line[None]
        row = line[n : n + m]
        return (
            stack,
            gram + row[:, None] * row[None],
            jnp.where(index == k, lifted - own, excess),
            jnp.minimum(smallest, own),
        )

    carry = (
        start,
        jnp.zeros((m, m, *batch), dtype),
        jnp.zeros((n, *batch), dtype),
        jnp.full(batch, jnp.inf, dtype),
    )
    stack, gram, excess, smallest = jax.lax.fori_loop(0, n, eliminate, carry)
    square = jnp.stack([gram[i, i] for i in range(m)])
    lengths = jnp.where(square > tiny, jax.lax.rsqrt(jnp.maximum(square, tiny)), 0)
    return Factor(
        root=stack[:, n + m :] * scale[None],
        excess=excess / (scale * scale),
        rows=stack[:, n : n + m] * lengths[None],
        lengths=lengths,
        gram=gram * lengths[:, None] * lengths[None],
        pivot=smallest,
    )

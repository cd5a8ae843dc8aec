"""A quadratic program in the metric of its own cost: one factorisation, after which everything is a small product.

Notation of the qp_* modules: min x'P x / 2 + q'x with low <= C x <= high; H = P + diag(excess) is positive definite,
H^-1 = V'V, W = C V' with its rows scaled to length one (the scaling by sqrt(c'H^-1 c)), S = W W'. Constraint values
and multipliers in scaled rows are w and y. Arrays carry their batch, if any, as the LAST axis (shown as *b): the small
loops then vectorise over problems, which is several times faster on a CPU than a batch in front.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Num

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
    excess: Float[Array, " n *b"]
    rows: Float[Array, "n m *b"]
    lengths: Float[Array, " m *b"]
    gram: Float[Array, "m m *b"]
    pivot: Float[Array, "*b"]


def apply(matrix: Float[Array, "r c *b"], vector: Float[Array, " c *b"]) -> Float[Array, " r *b"]:
    """Matrix times vector."""
    return matrix @ vector if vector.ndim == 1 else _sum_of_products(matrix, vector, 1, vector.shape[0] // 2)


def apply_transposed(matrix: Float[Array, "r c *b"], vector: Float[Array, " r *b"]) -> Float[Array, " c *b"]:
    """Matrix' times vector."""
    return vector @ matrix if vector.ndim == 1 else _sum_of_products(matrix, vector, 0, vector.shape[0] // 2)


def _sum_of_products(matrix: Array, vector: Array, axis: int, pairs: int | Int[Array, ""]) -> Array:
    """Sum over an axis of the matrix, the first so many pairs of terms and the last one of an odd number.

    Two terms at a time: the sum goes through the cache half as often.
    """
    take = partial(jax.lax.dynamic_index_in_dim, keepdims=False)

    def term(k: Array | int) -> Array:
        return take(matrix, k, axis) * take(vector, k)

    begin = jnp.zeros((matrix.shape[1 - axis], *vector.shape[1:]), vector.dtype)
    total = jax.lax.fori_loop(0, pairs, lambda k, total: total + term(2 * k) + term(2 * k + 1), begin)
    return total + term(vector.shape[0] - 1) if vector.shape[0] % 2 else total


def fold(operation: Callable[[Array, Array], Array], values: Num[Array, " m *b"]) -> Num[Array, "*b"]:
    """Reduce along the first axis by an idempotent operation (maximum, minimum), as a tree of elementwise ones."""
    while values.shape[0] > 1:
        half = (values.shape[0] + 1) // 2
        values = operation(values[:half], values[values.shape[0] - half :])
    return values[0]


def largest(values: Float[Array, " m *b"]) -> Float[Array, "*b"]:
    """Largest magnitude."""
    return fold(jnp.maximum, jnp.abs(values))


def factorise(P: Float[Array, "n n *b"], C: Float[Array, "m n *b"]) -> Factor:
    """Cholesky factorisation that carries C and the identity along.

    A pivot that is not safely positive is lifted to a small one (Gill and Murray's modified Cholesky).
    """
    n, m, dtype = P.shape[0], C.shape[0], P.dtype
    tiny = jnp.finfo(dtype).tiny
    least = _least(dtype)
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
    # One problem fits into the first-level cache whole; of a batch only what is being written does.
    done, excess, smallest = _eliminate_all(start) if P.ndim == 2 else _row_by_row(start)
    rows = done[:, n : n + m]
    square = jax.lax.fori_loop(1, n, lambda k, total: total + rows[k] * rows[k], rows[0] * rows[0])
    lengths = jnp.where(square > tiny, jax.lax.rsqrt(jnp.maximum(square, tiny)), 0)
    rows = rows * lengths[None]
    return Factor(
        root=done[:, n + m :] * scale[None],
        excess=excess / (scale * scale),
        rows=rows,
        lengths=lengths,
        gram=_gram(rows),
        pivot=smallest,
    )


def _least(dtype: jnp.dtype) -> float:
    """Pivots below this, of a matrix with unit diagonal, are rounding."""
    return 50 * float(jnp.finfo(dtype).eps)


def _scale_row(
    line: Float[Array, " c *b"], k: Array, n: int
) -> tuple[Float[Array, " c *b"], Float[Array, "*b"], Float[Array, " n *b"]]:
    """Row k of the factor from the row with its predecessors' shares taken off, its pivot, and what lifted that."""
    own = jax.lax.dynamic_index_in_dim(line, k, keepdims=False)
    lifted = jnp.where(own < _least(line.dtype), LIFTED, own)
    at = jnp.arange(line.shape[0]).reshape((-1,) + (1,) * own.ndim)
    line = jnp.where(at < k, 0, jnp.where(at == k, lifted, line)) / jnp.sqrt(lifted)
    return line, own, jnp.where(at[:n] == k, lifted - own, 0)


def _eliminate_all(stack: Float[Array, "n c"]) -> tuple[Float[Array, "n c"], Float[Array, " n"], Float[Array, ""]]:
    """Rows of the factor, what was added to the diagonal and the least pivot; each row leaves all others at once."""
    n = stack.shape[0]
    index = jnp.arange(n)

    def eliminate(k: Array, carry: tuple) -> tuple:
        stack, excess, smallest = carry
        line, own, lifting = _scale_row(stack[k], k, n)
        stack = stack - jnp.where(index > k, line[:n], 0)[:, None] * line
        return stack.at[k].set(line), excess + lifting, jnp.minimum(smallest, own)

    return jax.lax.fori_loop(0, n, eliminate, (stack, jnp.zeros(n, stack.dtype), jnp.asarray(jnp.inf, stack.dtype)))


def _row_by_row(
    stack: Float[Array, "n c *b"],
) -> tuple[Float[Array, "n c *b"], Float[Array, " n *b"], Float[Array, "*b"]]:
    """The same, row after row from those before it."""
    n, batch, dtype = stack.shape[0], stack.shape[2:], stack.dtype
    take = jax.lax.dynamic_index_in_dim

    def add_row(k: Array, carry: tuple) -> tuple:
        done, excess, smallest = carry  # rows from k on are still zero
        above = take(done, k, 1, keepdims=False)
        line = take(stack, k, keepdims=False) - _sum_of_products(done, above, 0, (k + 1) // 2)
        line, own, lifting = _scale_row(line, k, n)
        done = jax.lax.dynamic_update_index_in_dim(done, line, k, 0)
        return done, excess + lifting, jnp.minimum(smallest, own)

    begin = (jnp.zeros_like(stack), jnp.zeros((n, *batch), dtype), jnp.full(batch, jnp.inf, dtype))
    return jax.lax.fori_loop(0, n, add_row, begin)


def _gram(rows: Float[Array, "n m *b"]) -> Float[Array, "m m *b"]:
    """rows' rows, summed where it stays in the cache: all of it for one problem, line by line for a batch."""
    n, m, batch = rows.shape[0], rows.shape[1], rows.shape[2:]
    begin = jnp.zeros((m, m, *batch), rows.dtype)
    if not batch:
        return jax.lax.fori_loop(0, n, lambda k, gram: gram + rows[k][:, None] * rows[k], begin)

    def add_line(i: Array, gram: Array) -> Array:
        line = apply_transposed(rows, jax.lax.dynamic_index_in_dim(rows, i, 1, keepdims=False))
        return jax.lax.dynamic_update_index_in_dim(gram, line, i, 0)

    return jax.lax.fori_loop(0, m, add_line, begin)

"""ADMM (OSQP's splitting) on the dual of a factored quadratic program.

With w the constraint values, z their copy within the bounds and y the multipliers (all in scaled rows, notation of
`qp_factor`), one iteration is one product with (S + 1/rho)^-1:
    u = (S + 1/rho)^-1 (w0 - z + y / rho),  w = z + (u - y) / rho,
    v = a w + (1 - a) z,  z = clip(v + y / rho),  y = y + rho (v - z).
It needs no luck with the active set: slow to be exact, it is always on its way.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.optimization.qp.factor import apply, largest

STIFF = 1000.0  # penalty of an equality over that of an inequality
# Least and largest penalty by the bytes of a number: beyond, inverting loses all.
_PENALTIES = {4: (1e-3, 1e3), 8: (1e-6, 1e6)}


class Splitting(NamedTuple):
    """State: z and y, (m, *b) each."""

    z: Float[Array, " m *b"]
    y: Float[Array, " m *b"]


def invert(matrix: Float[Array, "m m *b"]) -> Float[Array, "m m *b"]:
    """Inverse of positive definite matrices by sweeping every row; a pivot lost to rounding is replaced."""
    m, batch = matrix.shape[0], matrix.shape[2:]
    index = jnp.arange(m).reshape((m,) + (1,) * len(batch))
    least = jnp.finfo(matrix.dtype).eps

    def sweep(k: Array, swept: Array) -> Array:
        column = jax.lax.dynamic_index_in_dim(swept, k, keepdims=False)
        at = jnp.where(index == k, 1, 0).astype(matrix.dtype)
        inverse = 1 / jnp.maximum(jax.lax.dynamic_index_in_dim(column, k, keepdims=False), least)
        edge = inverse * jnp.where(index == k, -0.5, column)
        flux = jnp.where(index == k, 1, inverse * column)
        swept = (swept - flux[:, None] * column[None]) * (1 - at[None])
        return swept + at[:, None] * edge[None] + edge[:, None] * at[None]

    return -jax.lax.fori_loop(0, m, sweep, matrix)


def admm(
    gram: Float[Array, "m m *b"],
    free: Float[Array, " m *b"],
    low: Float[Array, " m *b"],
    high: Float[Array, " m *b"],
    start: Splitting,
    penalty: Float[Array, "*b"],
    relaxation: float,
    iterations: int,
) -> tuple[Splitting, Float[Array, "*b"]]:
    """Run a fixed number of iterations and propose the next penalty from the balance of the residuals (OSQP, 5.2)."""
    dtype = free.dtype
    rho = penalty * jnp.where(low == high, STIFF, 1).astype(dtype)
    rho = jnp.where(jnp.isinf(low) & jnp.isinf(high), penalty * 1e-3, rho)
    m, batch = free.shape[0], free.shape[1:]
    identity = jnp.eye(m, dtype=dtype).reshape((m, m) + (1,) * len(batch))
    inverse = invert(gram + identity / rho[None])

    def iterate(state: Splitting, _: None) -> tuple[Splitting, None]:
        z, y = state
        u = apply(inverse, free - z + y / rho)
        w = z + (u - y) / rho
        v = relaxation * w + (1 - relaxation) * z
        after = jnp.clip(v + y / rho, low, high)
        return Splitting(after, y + rho * (v - after)), None

    begin = Splitting(jnp.clip(start.z, low, high), start.y)
    state, _ = jax.lax.scan(iterate, begin, None, length=iterations)
    image = apply(gram, state.y)
    w = free - image
    tiny = jnp.finfo(dtype).tiny
    primal = largest(w - state.z) / jnp.maximum(jnp.maximum(largest(w), largest(state.z)), tiny)
    moved, _ = iterate(state, None)
    dual = largest(rho * (moved.z - state.z)) / jnp.maximum(largest(moved.y), tiny)
    ratio = jnp.sqrt(jnp.maximum(primal, tiny) / jnp.maximum(dual, tiny))
    return state, jnp.clip(penalty * jnp.clip(ratio, 0.1, 10), *_PENALTIES[dtype.itemsize])

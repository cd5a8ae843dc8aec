"""Equilibration: a program in units in which its variables, its rows and its solution are all of about size one.

With x = t D x^ and y = t E y^, D and E diagonal, the program reads P^ = D P D, q^ = D q / t, C^ = E C D and bounds
E b / t. All factors are powers of two, so that scaling rounds nothing: it changes what overflows and what counts as
small, not the answer. Arrays carry their batch as the last axis (see `factor`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.optimization.qp.factor import fold, largest

_SWEEPS = 3  # over the rows and the variables without a cost of their own


class Scaling(NamedTuple):
    """Powers of two.

    Attributes:
        variables: (n, *b) D.
        rows: (m, *b) E.
        size: (*b,) t.
    """

    variables: Float[Array, " n *b"]
    rows: Float[Array, " m *b"]
    size: Float[Array, "*b"]


class ProgramArrays(NamedTuple):
    """P, q, C, low and high of a `QuadraticProgram`, batch last."""

    P: Float[Array, "n n *b"]
    q: Float[Array, " n *b"]
    C: Float[Array, "m n *b"]
    low: Float[Array, " m *b"]
    high: Float[Array, " m *b"]


def _power(values: Array, root: bool = False) -> Array:
    """The power of two next below 1 / values, or 1 / sqrt(values); 1 for what is not positive and finite."""
    exponent = jnp.frexp(values)[1]
    exponent = (exponent + 1) // 2 if root else exponent
    # Squares of the factors and their products with each other are to stay within the range of a float.
    most = -(int(jnp.finfo(values.dtype).minexp) + 4)
    usable = (values > 0) & jnp.isfinite(values)
    return jnp.where(usable, jnp.ldexp(jnp.ones_like(values), jnp.clip(-exponent, -most, most)), 1)


def equilibrate(program: ProgramArrays) -> Scaling:
    """Variables by the diagonal of P, or by their rows where they have no cost; then rows; then the solution's size."""
    P, q, C, low, high = program
    diagonal, size = jnp.stack([P[k, k] for k in range(P.shape[0])]), jnp.abs(C)
    costly = diagonal > 0
    variables = _power(diagonal, root=True)

    def row_factors(variables: Array) -> Array:
        return _power(fold(jnp.maximum, jnp.swapaxes(size * variables[None], 0, 1)))

    def sweep(_: Array, variables: Array) -> Array:
        reach = _power(fold(jnp.maximum, size * row_factors(variables)[:, None]))
        return jnp.where(costly, variables, reach)

    def by_rows() -> Array:
        begin = jnp.where(costly, variables, 0)
        # Rows without any variable of known size take the others as they are.
        known = fold(jnp.maximum, jnp.swapaxes(size * begin[None], 0, 1)) > 0
        begin = jnp.where(costly, variables, _power(fold(jnp.maximum, jnp.where(known[:, None], size, 0))))
        return jax.lax.fori_loop(0, _SWEEPS, sweep, begin)

    variables = jax.lax.cond(jnp.all(costly), lambda: variables, by_rows)
    rows = row_factors(variables)
    away = jnp.maximum(jnp.where(low > 0, low, 0), jnp.where(high < 0, -high, 0)) * rows
    return Scaling(variables, rows, 1 / _power(jnp.maximum(largest(q * variables), largest(away))))


def scale_program(program: ProgramArrays, scaling: Scaling) -> ProgramArrays:
    """The program in its own units."""
    P, q, C, low, high = program
    variables, rows, shrink = scaling.variables, scaling.rows, 1 / scaling.size
    return ProgramArrays(
        P * variables[:, None] * variables[None],
        q * variables * shrink,
        C * rows[:, None] * variables[None],
        low * rows * shrink,
        high * rows * shrink,
    )


def scale_point(scaling: Scaling, x: Array, y: Array) -> tuple[Array, Array]:
    """Variables and multipliers in the program's own units."""
    shrink = 1 / scaling.size
    return x / scaling.variables * shrink, y / scaling.rows * shrink


def unscale_point(scaling: Scaling, x: Array, y: Array) -> tuple[Array, Array]:
    """Variables and multipliers in the user's units."""
    return x * scaling.variables * scaling.size, y * scaling.rows * scaling.size

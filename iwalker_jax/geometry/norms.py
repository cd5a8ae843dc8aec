"""Lengths whose gradient is zero, not NaN, at zero."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def safe_sqrt(squared: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Square root of numbers that are not negative; its infinite gradient at zero is taken as zero."""
    positive = squared > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, squared, 1.0)), 0.0)


def safe_norm(vectors: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
    """Euclidean length along the last axis."""
    return safe_sqrt(jnp.sum(vectors**2, axis=-1))

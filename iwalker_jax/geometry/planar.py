"""Rotations and frames in the plane; a pose is (x [m], y [m], yaw [rad])."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def turn(angle: Float[Array, ""], vectors: Float[Array, "*n 2"]) -> Float[Array, "*n 2"]:
    """Rotate planar vectors by an angle [rad]."""
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    x, y = vectors[..., 0], vectors[..., 1]
    return jnp.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def to_base(pose: Float[Array, "3"], points: Float[Array, "*n 2"]) -> Float[Array, "*n 2"]:
    """World points [m] in the frame of a pose."""
    return turn(-pose[2], points - pose[:2])


def to_world(pose: Float[Array, "3"], points: Float[Array, "*n 2"]) -> Float[Array, "*n 2"]:
    """Points [m] of a pose's frame in the world."""
    return turn(pose[2], points) + pose[:2]

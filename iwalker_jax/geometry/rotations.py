"""Rotations in space and differences of angles. Quaternions are wxyz, body to world."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def quaternion_product(left: Float[Array, "4"], right: Float[Array, "4"]) -> Float[Array, "4"]:
    """Hamilton product."""
    a, b, c, d = left
    w, x, y, z = right
    return jnp.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ]
    )


def rotation_matrix(quaternion: Float[Array, "4"]) -> Float[Array, "3 3"]:
    """R_world_base of a unit quaternion."""
    w, x, y, z = quaternion
    return jnp.stack(
        [
            jnp.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)]),
            jnp.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)]),
            jnp.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]),
        ]
    )


def yaw_of(quaternion: Float[Array, "4"]) -> Float[Array, ""]:
    """Heading of the body's x axis [rad], in (-pi, pi]."""
    w, x, y, z = quaternion
    return jnp.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))


def wrap_angle(angle: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """The same angle in [-pi, pi] [rad]."""
    return angle - 2 * jnp.pi * jnp.round(angle / (2 * jnp.pi))


def angle_between(to: Float[Array, "*n"], start: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """to - start [rad], wrapped into (-pi, pi]."""
    return jnp.arctan2(jnp.sin(to - start), jnp.cos(to - start))


def turn_in_body(quaternion: Float[Array, "4"], rotation: Float[Array, "3"]) -> Float[Array, "4"]:
    """Turn by a small rotation vector in the body frame [rad]: q * exp(rotation / 2), to third order, normalised."""
    square = jnp.sum(rotation * rotation)
    # sin(a/2)/a and cos(a/2) as series: exact to 1e-9 at 0.1 rad, and smooth at zero.
    step = jnp.concatenate([(1 - square / 8 + square**2 / 384)[None], rotation * (0.5 - square / 48)])
    return _unit(quaternion_product(quaternion, step))


def turn_about_vertical(quaternion: Float[Array, "4"], angle: Float[Array, ""]) -> Float[Array, "4"]:
    """Turn by an angle about the world's z axis [rad]."""
    zero = jnp.zeros_like(angle)
    return _unit(quaternion_product(jnp.stack([jnp.cos(angle / 2), zero, zero, jnp.sin(angle / 2)]), quaternion))


def tilt_error(
    vertical: Float[Array, "3"],
    specific_force: Float[Array, "3"],
    gravity: float | Float[Array, ""],
    gate: float | Float[Array, ""],
) -> Float[Array, "3"]:
    """Rotation in the body frame that would lay the believed vertical on the accelerometer's [rad], gated.

    It is worth less the more the accelerometer's magnitude departs from gravity, and does not touch the heading.

    Args:
        vertical: (3,) the world's z axis in the body frame.
        specific_force: (3,) [m/s^2] in the body frame.
        gravity: [m/s^2].
        gate: [m/s^2] departure at which the trust falls to 1/e.
    """
    size = jnp.sqrt(jnp.sum(specific_force * specific_force) + 1e-6)
    trust = jnp.exp(-(((size - gravity) / gate) ** 2))
    return trust / size * jnp.cross(specific_force, vertical)


def _unit(quaternion: Float[Array, "4"]) -> Float[Array, "4"]:
    """Scaled to unit length."""
    return quaternion / jnp.sqrt(jnp.sum(quaternion * quaternion))

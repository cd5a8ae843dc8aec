"""Linear Kalman filter of base and feet, one small covariance for all axes.

Notation, for each world axis: x = [p, v, b, r, l, c, d] with p, v the base position [m] and velocity [m/s], b the
error of the measured acceleration [m/s^2], r and l the right and left foot minus the base [m], c the accelerometer's
own share of b [m/s^2], and d what visual odometry has drifted [m]. Feet relative to the base keep the covariance well
conditioned in single precision however far the robot has walked: leg kinematics then measures a state itself, not a
small difference of two large ones. With isotropic noise the axes decouple, and x and y share one covariance; z has its
own, since only z hears of the floor.

Horizontally, b is a tilt error times gravity plus the accelerometer's bias c, which nothing tells from tilt: c is
considered, that is, what it adds to all uncertainty is kept, and it is never estimated (Schmidt 1966). Leg kinematics
feels the tilt: a foot at depth h below the base is seen h (b - c) / g too far along. Vertically, b is the
accelerometer's bias, and c and d are all but zero. Source: Bloesch et al., "State estimation for legged robots"
(2012), linearised about standing upright.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.checks import Scalar

POSITION, VELOCITY, BIAS, RIGHT_FOOT, LEFT_FOOT, CONSIDERED, DRIFT = range(7)
STATES = 7

# Transition x' = (I + dt FIRST + dt^2/2 SECOND) x + (dt, dt^2/2 parts of INPUT) acceleration.
_FIRST, _SECOND = np.zeros((STATES, STATES)), np.zeros((STATES, STATES))
_FIRST[POSITION, VELOCITY], _FIRST[VELOCITY, BIAS] = 1, -1
_FIRST[[RIGHT_FOOT, LEFT_FOOT], VELOCITY] = -1
_SECOND[POSITION, BIAS], _SECOND[[RIGHT_FOOT, LEFT_FOOT], BIAS] = -1, 1

_ESTIMATED = (np.arange(STATES) != CONSIDERED).astype(float)
_SHRINKS = np.maximum(_ESTIMATED[:, None], _ESTIMATED[None, :])
"""Entries of the covariance that a measurement changes: all but what is considered keeps of itself."""


class Belief(NamedTuple):
    """Gaussian belief about base and feet.

    Attributes:
        mean: (7, 3) rows p, v, b, r, l, c, d; columns world x, y, z.
        covariance: (2, 7, 7) of one horizontal axis (x and y alike) and of the vertical axis.
    """

    mean: Float[Array, "7 3"]
    covariance: Float[Array, "2 7 7"]


def measures(*states: int) -> np.ndarray:
    """(2, 7) row of a measurement of the sum of some states, alike on all axes."""
    return np.tile(np.isin(np.arange(STATES), states).astype(np.float32), (2, 1))


def measures_foot(foot: int, depth: Float[Array, ""], gravity: Scalar) -> Float[Array, "2 7"]:
    """Row of leg kinematics: the foot's state and, horizontally, how far tilt swings a foot at this depth [m]."""
    swing = np.zeros((2, STATES), np.float32)
    swing[0, BIAS], swing[0, CONSIDERED] = -1, 1
    return jnp.asarray(swing) * (depth / gravity) + measures(foot)


def predict(
    belief: Belief,
    acceleration: Float[Array, "3"],
    period: Scalar,
    acceleration_variance: Scalar,
    drift: Float[Array, "*axes 7"],
) -> Belief:
    """Belief one period later.

    Args:
        acceleration: (3,) [m/s^2] measured acceleration in world axes, gravity taken off, the error b still in it.
        period: [s].
        acceleration_variance: () [m^2/s^4] of the sample.
        drift: (7,) or (2, 7) variance that each state gains otherwise in this period, horizontally and vertically.
    """
    dtype = belief.mean.dtype
    transition = jnp.asarray(np.eye(STATES), dtype) + period * jnp.asarray(_FIRST, dtype)
    transition += period**2 / 2 * jnp.asarray(_SECOND, dtype)
    # The acceleration enters as its error leaves.
    column = -transition[:, BIAS] + jnp.asarray(np.eye(STATES)[BIAS], dtype)
    mean = transition @ belief.mean + column[:, None] * acceleration
    covariance = transition @ belief.covariance @ transition.T
    noise = acceleration_variance * column[:, None] * column + jnp.asarray(np.eye(STATES), dtype) * drift[..., None, :]
    covariance += noise
    return Belief(mean, (covariance + jnp.swapaxes(covariance, 1, 2)) / 2)


def update(
    belief: Belief,
    row: Float[Array, "2 7"] | np.ndarray,
    innovation: Float[Array, "3"],
    variance: Scalar,
    weight: Float[Array, "2"],
    gate: Scalar,
) -> tuple[Belief, Float[Array, ""]]:
    """Take in one measurement, a weighted sum of the states on each axis; return its residual as well.

    Args:
        row: (2, 7) weights of the states, for the horizontal axes and the vertical one.
        innovation: (3,) measurement minus the same sum of the mean.
        variance: () of the measurement on each axis.
        weight: (2,) 1 to use it, 0 not to, between to trust it less; for the horizontal axes and the vertical one.
        gate: [standard deviations] beyond which the weight falls as one over the residual (Huber).

    Returns:
        The belief, and the innovation's root mean square in standard deviations over the axes in use.
    """
    cross = jnp.sum(belief.covariance * row[:, None, :], axis=2)
    spread = jnp.sum(cross * row, axis=1)
    squares = jnp.stack([(innovation[0] ** 2 + innovation[1] ** 2) / 2, innovation[2] ** 2]) / (spread + variance)
    trust = weight * gate / jnp.maximum(jnp.sqrt(squares + 1e-12), gate)
    scale = trust / (trust * spread + variance)
    gain = scale[:, None] * cross * jnp.asarray(_ESTIMATED, cross.dtype)
    mean = belief.mean + jnp.stack([gain[0], gain[0], gain[1]], axis=1) * innovation
    # The outer product comes first: it is symmetric to the last bit, and so the covariance stays.
    shrinks = jnp.asarray(_SHRINKS, cross.dtype)
    covariance = belief.covariance - scale[:, None, None] * (cross[:, :, None] * cross[:, None, :]) * shrinks
    axes = jnp.asarray([2.0, 1.0], squares.dtype) * (weight > 0)
    mean_square = jnp.sum(axes * squares) / jnp.maximum(jnp.sum(axes), 1)
    return Belief(mean, covariance), jnp.sqrt(mean_square + 1e-12)

"""Linear Kalman filter of base and feet, one small covariance for all axes.

Notation, for each world axis: x = [p, v, b, r, l] with p, v the base position [m] and velocity [m/s], b the error of
the measured acceleration [m/s^2], r and l the right and left foot minus the base [m]. Feet relative to the
base keep the covariance well conditioned in single precision however far the robot has walked: leg kinematics then
measures a state itself, not a small difference of two large ones. With isotropic noise the axes decouple, and x and
y share one covariance; z has its own, since only z hears of the floor.
Source: Bloesch et al., "State estimation for legged robots" (2012), whose attitude error enters here through b alone.
"""

import functools
import operator
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

POSITION, VELOCITY, BIAS, RIGHT_FOOT, LEFT_FOOT = range(5)

# Transition x' = (I + dt FIRST + dt^2/2 SECOND) x + (dt, dt^2/2 parts of INPUT) acceleration.
_FIRST, _SECOND = np.zeros((5, 5)), np.zeros((5, 5))
_FIRST[POSITION, VELOCITY], _FIRST[VELOCITY, BIAS] = 1, -1
_FIRST[[RIGHT_FOOT, LEFT_FOOT], VELOCITY] = -1
_SECOND[POSITION, BIAS], _SECOND[[RIGHT_FOOT, LEFT_FOOT], BIAS] = -1, 1


class Belief(NamedTuple):
    """Gaussian belief about base and feet.

    Attributes:
        mean: (5, 3) rows p, v, b, r, l; columns world x, y, z.
        covariance: (2, 5, 5) of one horizontal axis (x and y alike) and of the vertical axis.
    """

    mean: Float[Array, "5 3"]
    covariance: Float[Array, "2 5 5"]


def predict(
    belief: Belief,
    acceleration: Float[Array, "3"],
    period: float,
    acceleration_variance: Float[Array, ""],
    drift: Float[Array, "5"],
) -> Belief:
    """Belief one period later.

    Args:
        acceleration: (3,) [m/s^2] measured acceleration in world axes, gravity taken off, the error b still in it.
        period: [s].
        acceleration_variance: () [m^2/s^4] of the sample.
        drift: (5,) variance that each state gains otherwise in this period.
    """
    dtype = belief.mean.dtype
    transition = jnp.asarray(np.eye(5), dtype) + period * jnp.asarray(_FIRST, dtype)
    transition += period**2 / 2 * jnp.asarray(_SECOND, dtype)
    # The acceleration enters as its error leaves.
    column = -transition[:, BIAS] + jnp.asarray(np.eye(5)[BIAS], dtype)
    mean = transition @ belief.mean + column[:, None] * acceleration
    covariance = transition @ belief.covariance @ transition.T
    noise = acceleration_variance * column[:, None] * column + jnp.diag(drift)
    covariance += noise
    return Belief(mean, (covariance + jnp.swapaxes(covariance, 1, 2)) / 2)


def update(
    belief: Belief,
    rows: tuple[int, ...],
    innovation: Float[Array, "3"],
    variance: Float[Array, ""],
    weight: Float[Array, "2"],
    gate: float,
) -> tuple[Belief, Float[Array, ""]]:
    """Take in one measurement of the sum of some states, on all three axes; return its residual as well.

    Args:
        rows: which states are summed (static).
        innovation: (3,) measurement minus the mean.
        variance: () of the measurement on each axis.
        weight: (2,) 1 to use it, 0 not to, between to trust it less; for the horizontal axes and the vertical one.
        gate: [standard deviations] beyond which the weight falls as one over the residual (Huber).

    Returns:
        The belief, and the innovation's root mean square in standard deviations over the axes in use.
    """
    cross = functools.reduce(operator.add, [belief.covariance[:, :, row] for row in rows])
    spread = functools.reduce(operator.add, [cross[:, row] for row in rows])
    squares = jnp.stack([(innovation[0] ** 2 + innovation[1] ** 2) / 2, innovation[2] ** 2]) / (spread + variance)
    trust = weight * gate / jnp.maximum(jnp.sqrt(squares + 1e-12), gate)
    scale = trust / (trust * spread + variance)
    gain = scale[:, None] * cross
    mean = belief.mean + jnp.stack([gain[0], gain[0], gain[1]], axis=1) * innovation
    # The outer product comes first: it is symmetric to the last bit, and so the covariance stays.
    covariance = belief.covariance - scale[:, None, None] * (cross[:, :, None] * cross[:, None, :])
    axes = jnp.asarray([2.0, 1.0], squares.dtype) * (weight > 0)
    mean_square = jnp.sum(axes * squares) / jnp.maximum(jnp.sum(axes), 1)
    return Belief(mean, covariance), jnp.sqrt(mean_square + 1e-12)

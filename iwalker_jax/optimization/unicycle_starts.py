"""Where the unicycle solver starts: a coarse time grid, and on it a straight drive and two smoothed references.

The best motion is smooth over several points whatever the reference, so its shape, and which of the local
optima it belongs to, is found cheaply on every fourth point.
"""

from functools import lru_cache

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# Points of the reference for each point of the coarse grid, and the fewest coarse points worth having.
_RATIO = 4
_FEWEST = 16
# Stiffness of the smoothed starts over the acceleration weight: a shape with its main bends, and a hint of one.
_SMOOTHING = (200.0, 2000.0)
STARTS = 1 + len(_SMOOTHING)


@lru_cache(maxsize=32)
def coarse_grid(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices between a path of N points and its coarse grid of M + 1 points.

    Returns:
        (M + 1, N) averages of the path around the coarse points (the first one is exact), and (N, M + 1)
        interpolation of speeds and headings, which belong to the middle of the steps they drive (the first one,
        the initial state, belongs to the first point).
    """
    steps = max(-(-(points - 1) // _RATIO), min(_FEWEST, points - 1))
    width = (points - 1) / steps
    times = np.arange(points)
    centres = np.arange(steps + 1) * width
    averaging = np.maximum(1 - np.abs(times[None] - centres[:, None]) / width, 0.0)
    averaging /= averaging.sum(axis=1, keepdims=True)
    averaging[0] = times == 0
    middles = centres + (width - 1) / 2
    middles[0] = 0.0
    interpolation = np.stack([np.interp(times, middles, row) for row in np.eye(steps + 1)], axis=1)
    return averaging, interpolation


@lru_cache(maxsize=32)
def _smoother(points: int, stiffness: float) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (A, b) of p = A ref + b p_1, the minimiser of |p - ref|^2 + stiffness |second difference|^2, p_0 = 0."""
    second = np.zeros((points - 2, points))
    for k in range(points - 2):
        second[k, k : k + 3] = 1.0, -2.0, 1.0
    hessian = np.eye(points) + stiffness * second.T @ second
    solution = np.linalg.inv(hessian[2:, 2:])
    from_reference = np.zeros((points, points))
    from_reference[2:, 2:] = solution
    return from_reference, np.concatenate([[0.0, 1.0], -solution @ hessian[2:, 1]])[:, None]


def starting_motions(
    x: Float[Array, "n lanes"],
    y: Float[Array, "n lanes"],
    speed: Float[Array, " lanes"],
    theta: Float[Array, " lanes"],
    stiffness: float,
    dt: float,
) -> tuple[Float[Array, "n starts lanes"], Float[Array, "n starts lanes"]]:
    """Speeds and headings to start from; the problem has local optima, and these find different ones.

    Args:
        x, y: (N, lanes) reference relative to the initial position [m], N >= 3.
        speed: (lanes,) initial speed [m/sample].
        theta: (lanes,) initial heading [rad].
        stiffness: w_acc / (w_pos dt^4), what the cost holds against a bend of the path.
        dt: time between points [samples].

    Returns:
        Speeds and headings (N, starts, lanes): straight ahead with the best speeds, then smoothed references. A
        smoothed reference that turns by more than a right angle between points is followed in reverse: it is cheaper.
    """

    def smooth(signal: Array, second_point: Array, factor: float) -> Array:
        matrix, pinned = _smoother(signal.shape[0], factor * stiffness)
        return jnp.asarray(matrix, signal.dtype) @ signal + jnp.asarray(pinned, signal.dtype) * second_point

    def hold_last(values: Array) -> Array:
        return jnp.concatenate([values, values[-1:]])

    c, s = jnp.cos(theta), jnp.sin(theta)
    ahead = smooth(x * c + y * s, dt * speed, 1.0)
    speeds, headings = [hold_last(jnp.diff(ahead, axis=0) / dt)], [jnp.broadcast_to(theta, ahead.shape)]
    for factor in _SMOOTHING:
        dx = jnp.diff(smooth(x, dt * speed * c, factor), axis=0)
        dy = jnp.diff(smooth(y, dt * speed * s, factor), axis=0)
        turns = jnp.diff(jnp.concatenate([theta[None], jnp.arctan2(dy, dx)[1:]]), axis=0)
        turns = turns - jnp.pi * jnp.round(turns / jnp.pi)
        heading = theta + jnp.concatenate([jnp.zeros_like(turns[:1]), jnp.cumsum(turns, axis=0)])
        speeds.append(hold_last((dx * jnp.cos(heading) + dy * jnp.sin(heading)) / dt))
        headings.append(hold_last(heading))
    return jnp.stack(speeds, axis=1), jnp.stack(headings, axis=1)

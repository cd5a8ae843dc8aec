"""Where the unicycle solver starts: a coarse time grid, and on it a straight drive and three smoothed references.

The best motion is smooth over several points whatever the reference, so its shape, and which of the local
optima it belongs to, is found cheaply on a third of the points.
"""

from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# Length of the coarse grid's steps in points: fine at first, where a fast start has to turn at once, then this.
_FIRST_STEPS = (1, 1, 1, 1, 2, 2, 2)
_STEP = 4
# Stiffness of the smoothed starts over the acceleration weight: close to the path, its main bends, a hint of its shape.
_SMOOTHING = (1.0, 200.0, 2000.0)
STARTS = 1 + len(_SMOOTHING)


class CoarseGrid(NamedTuple):
    """How N points are seen through M + 1 of them.

    Attributes:
        steps: (M,) length of each step in points.
        averaging: (M + 1, N) averages of a path around the coarse points.
        mass: (M + 1,) how many points each coarse point stands for.
        nearest: (M + 1,) the point whose speed and heading are closest to a coarse step's.
        interpolation: (N, M + 1) speeds and headings of all points; those of a step belong to its middle.
    """

    steps: np.ndarray
    averaging: np.ndarray
    mass: np.ndarray
    nearest: np.ndarray
    interpolation: np.ndarray


@lru_cache(maxsize=32)
def coarse_grid(points: int) -> CoarseGrid:
    """The coarse grid of a path of N points."""
    nodes = [0]
    for step in (*_FIRST_STEPS, *[_STEP] * points):
        if nodes[-1] < points - 1:
            nodes.append(min(nodes[-1] + step, points - 1))
    centres = np.array(nodes, float)
    times = np.arange(points)
    hats = np.stack([np.interp(times, centres, row) for row in np.eye(len(nodes))])
    mass = hats.sum(axis=1)
    steps = np.diff(centres)
    middles = centres + np.append((steps - 1) / 2, 0.0)
    interpolation = np.stack([np.interp(times, middles, row) for row in np.eye(len(nodes))], axis=1)
    return CoarseGrid(steps, hats / mass[:, None], mass, np.floor(middles).astype(int), interpolation)


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
) -> tuple[Float[Array, "m starts lanes"], Float[Array, "m starts lanes"]]:
    """Speeds and headings on the coarse grid to start from; the problem has several optima, these find different ones.

    Args:
        x, y: (N, lanes) reference relative to the initial position [m], N >= 3.
        speed: (lanes,) initial speed [m/sample].
        theta: (lanes,) initial heading [rad].
        stiffness: w_acc / (w_pos dt^4), what the cost holds against a bend of the path.
        dt: time between points [samples].

    Returns:
        Speeds and headings (M + 1, starts, lanes): straight ahead with the best speeds, then smoothed references. A
        smoothed reference that turns by more than a right angle between points is followed in reverse: it is cheaper.
    """
    nearest = np.minimum(coarse_grid(x.shape[0]).nearest, x.shape[0] - 2)

    def velocity(signal: Array, start: Array, factor: float) -> Array:
        smooth, pinned = (
            jnp.asarray(m[nearest + 1] - m[nearest], signal.dtype) for m in _smoother(x.shape[0], factor * stiffness)
        )
        return smooth @ signal / dt + pinned * start

    c, s = jnp.cos(theta), jnp.sin(theta)
    ahead = velocity(x * c + y * s, speed, 1.0)
    speeds, headings = [ahead], [jnp.broadcast_to(theta, ahead.shape)]
    for factor in _SMOOTHING:
        vx, vy = velocity(x, speed * c, factor), velocity(y, speed * s, factor)
        turns = jnp.diff(jnp.concatenate([theta[None], jnp.arctan2(vy, vx)[1:]]), axis=0)
        turns = turns - jnp.pi * jnp.round(turns / jnp.pi)
        heading = theta + jnp.concatenate([jnp.zeros_like(turns[:1]), jnp.cumsum(turns, axis=0)])
        speeds.append(vx * jnp.cos(heading) + vy * jnp.sin(heading))
        headings.append(heading)
    return jnp.stack(speeds, axis=1), jnp.stack(headings, axis=1)

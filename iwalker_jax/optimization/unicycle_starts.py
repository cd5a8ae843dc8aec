"""Where the unicycle solver starts: smoothed references driven forwards or backwards, and a straight drive."""

from functools import lru_cache

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.optimization.unicycle import UnicycleParameters

# Stiffness of the smoothed starts relative to the acceleration weight: a shape with its main bends, and a hint of one.
_SMOOTHING = (200.0, 2000.0)


@lru_cache(maxsize=32)
def _smoother(points: int, stiffness: float) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (M, E) of p = M ref + E [p_0, p_1], the minimiser of |p - ref|^2 + stiffness |second difference|^2."""
    second = np.zeros((points - 2, points))
    for k in range(points - 2):
        second[k, k : k + 3] = 1.0, -2.0, 1.0
    hessian = np.eye(points) + stiffness * second.T @ second
    solution = np.linalg.inv(hessian[2:, 2:])
    from_reference, from_start = np.zeros((points, points)), np.zeros((points, 2))
    from_reference[2:, 2:] = solution
    from_start[:2] = np.eye(2)
    from_start[2:] = -solution @ hessian[2:, :2]
    return from_reference, from_start


def _smooth(signal: Array, second_point: Array, stiffness: float) -> Array:
    """Smooth a signal (N, ...) that starts at 0 and whose second point is given."""
    from_reference, from_start = _smoother(signal.shape[0], stiffness)
    pinned = jnp.asarray(from_start[:, 1:], signal.dtype) @ second_point[None]
    return jnp.asarray(from_reference, signal.dtype) @ signal + pinned


def _controls(speed: Array, theta: Array, dt: float) -> Float[Array, "m 2"]:
    changes = jnp.stack([jnp.diff(theta), jnp.diff(speed)], axis=-1) / dt
    # The last point has no successor to read a speed and a heading from.
    return jnp.concatenate([changes, jnp.zeros_like(changes[:1])])


def starting_controls(
    reference: Float[Array, "n 2"], speed: Float[Array, ""], theta: Float[Array, ""], parameters: UnicycleParameters
) -> Float[Array, "starts m 2"]:
    """Controls to start from; the problem has several local optima, and these find different ones.

    Args:
        reference: (N, 2) positions relative to the initial position [m], N >= 3.
        speed: () initial speed [m/sample].
        theta: () initial heading [rad].
        parameters: weights and dt.

    Returns:
        (3, N-1, 2) controls: straight ahead with the best speeds, then two smoothed references. A smoothed
        reference that turns by more than a right angle between points is followed in reverse, as that is cheaper.
    """
    dt = parameters.dt
    stiffness = parameters.acceleration_weight / (parameters.position_weight * dt**4)
    direction = jnp.stack([jnp.cos(theta), jnp.sin(theta)])

    ahead = _smooth((reference @ direction)[:, None], (dt * speed)[None], stiffness)[:, 0]
    starts = [_controls(jnp.diff(ahead) / dt, jnp.full_like(ahead[1:], theta), dt)]
    for factor in _SMOOTHING:
        segments = jnp.diff(_smooth(reference, dt * speed * direction, factor * stiffness), axis=0)
        moves = jnp.any(segments != 0, axis=-1)
        raw = jnp.arctan2(segments[:, 1], jnp.where(moves, segments[:, 0], 1.0))
        turns = jnp.diff(jnp.concatenate([theta[None], raw[1:]]))
        turns = turns - jnp.pi * jnp.round(turns / jnp.pi)
        heading = theta + jnp.concatenate([jnp.zeros_like(turns[:1]), jnp.cumsum(turns)])
        along = (segments[:, 0] * jnp.cos(heading) + segments[:, 1] * jnp.sin(heading)) / dt
        starts.append(_controls(along, heading, dt))
    return jnp.stack(starts)

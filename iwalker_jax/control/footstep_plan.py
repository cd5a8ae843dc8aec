"""Footstep plans: a fixed-size table of alternating footsteps, and the walks that fill it."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import Side, arc_length, host, interpolate_along, side_of_step, side_sign


class FootstepPlan(NamedTuple):
    """Footsteps to take one after the other, left and right in turn; positions are of the middle of the sole.

    Attributes:
        positions: (K, 2) [m] in the world frame; rows from `count` on are ignored.
        yaws: (K,) [rad] heading of each foot.
        first_swing: () int32, the `Side` that row 0 places; the others alternate.
        count: () int32, number of footsteps; 0 stands.
    """

    positions: Float[Array, "*batch k 2"]
    yaws: Float[Array, "*batch k"]
    first_swing: Int[Array, "*batch"]
    count: Int[Array, "*batch"]  # type: ignore[assignment]  # hides tuple.count, which nobody needs here


def make_plan(positions: np.ndarray, yaws: np.ndarray, first_swing: int, rows: int | None = None) -> FootstepPlan:
    """Plan of the given footsteps, padded to `rows` by repeating the last two (so that plans of a batch match)."""
    positions, yaws = np.asarray(positions, np.float64), np.asarray(yaws, np.float64)
    count = len(positions)
    if positions.ndim != 2 or positions.shape[1:] != (2,) or yaws.shape != (count,):
        raise InputError(
            f"Footsteps have shapes {positions.shape} and {yaws.shape}; "
            "give positions (K, 2) in metres and yaws (K,) in radians."
        )
    if not (np.isfinite(positions).all() and np.isfinite(yaws).all()):
        raise InputError("Footsteps hold NaN or infinite values; give finite metres and radians.")
    if first_swing not in tuple(Side):
        raise InputError(f"first_swing is {first_swing!r}; give 0 (the right foot steps first) or 1 (the left).")
    if count == 1:
        raise InputError("A walk of one footstep cannot end standing; give at least two, or none to stand.")
    rows = max(count, 2) if rows is None else rows
    if rows < count:
        raise InputError(f"The plan has {count} footsteps but only {rows} rows were allowed; allow more.")
    if count == 0:
        positions, yaws = np.zeros((rows, 2)), np.zeros(rows)
    else:
        extra = count - 2 + np.arange(rows - count) % 2
        index = np.concatenate([np.arange(count), extra]).astype(int)
        positions, yaws = positions[index], yaws[index]
    return FootstepPlan(
        jnp.asarray(positions, jnp.float32),
        jnp.asarray(yaws, jnp.float32),
        jnp.asarray(first_swing, jnp.int32),
        jnp.asarray(count, jnp.int32),
    )


def footsteps_along(
    path: np.ndarray, advance: np.ndarray, width: float, first_swing: int
) -> tuple[np.ndarray, np.ndarray]:
    """Footsteps beside a path at given advances: positions (K, 2) [m] and yaws (K,) [rad], along the path's tangent.

    Args:
        path: (n, 2) [m] polyline.
        advance: (K,) [m] distance along it of each footstep, possibly beyond its end, where the last one repeats.
        width: [m] between the two tracks.
        first_swing: the `Side` that steps first.
    """
    points = jnp.asarray(path, jnp.float32)
    lengths = arc_length(points)
    advance = np.minimum(np.asarray(advance, np.float64), float(lengths[-1]))
    centres = np.asarray(interpolate_along(lengths, points, jnp.asarray(advance, jnp.float32)), np.float64)
    ahead = np.asarray(interpolate_along(lengths, points, jnp.asarray(advance + 1e-2, jnp.float32)), np.float64)
    behind = np.asarray(interpolate_along(lengths, points, jnp.asarray(advance - 1e-2, jnp.float32)), np.float64)
    tangents = ahead - behind
    yaws = np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0]))
    signs = side_sign(side_of_step(first_swing, np.arange(len(advance))))[:, None]
    normals = host.leftward(yaws)
    return centres + signs * width / 2 * normals, yaws


def velocity_footsteps(
    forward: float,
    sideways: float,
    turn: float,
    steps: int,
    step_time: float,
    width: float,
    first_swing: int,
    ramp: int = 4,
) -> tuple[np.ndarray, np.ndarray]:
    """Footsteps of a constant velocity command from the origin: positions (K, 2) [m] and yaws (K,) [rad].

    The speed rises over the first `ramp` steps and falls over as many before the last two, which are taken on the spot,
    so that the body starts and comes to rest within its means.

    Args:
        forward, sideways: [m/s] in the heading frame (left positive).
        turn: [rad/s], left positive.
        steps: footsteps, the closing ones included.
        step_time, width: [s] and [m].
        first_swing: the `Side` that steps first.
        ramp: steps over which the speed changes; 0 starts and stops at once.
    """
    share = ramp_shares(steps, ramp)
    centre, heading = np.zeros(2), 0.0
    centres, headings = [], []
    for part in share:
        middle = heading + part * turn * step_time / 2
        centre = centre + part * host.planar_rotation(middle) @ np.array([forward, sideways]) * step_time
        heading += part * turn * step_time
        centres.append(centre)
        headings.append(heading)
    yaws = np.asarray(headings)
    signs = side_sign(side_of_step(first_swing, np.arange(steps)))[:, None]
    normals = host.leftward(yaws)
    return np.asarray(centres).reshape(-1, 2) + signs * width / 2 * normals, yaws


def ramp_shares(steps: int, ramp: int) -> np.ndarray:
    """(steps,) share of the full step length that each step takes: rising, full, falling, and two of zero."""
    moving = max(steps - 2, 0)
    up = np.arange(1, moving + 1) / (ramp + 1)
    return np.concatenate([np.minimum(np.minimum(up, up[::-1]), 1.0), np.zeros(steps - moving)])

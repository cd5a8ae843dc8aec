"""Swing-foot trajectory: quintics in the plane that are solved anew at every tick, a fixed rise and fall above it."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.checks import Scalar

_SHORTEST = 0.01  # s; the last stretch is followed as if this much time were left, which bounds the acceleration


class TrajectoryPoint(NamedTuple):
    """Position, velocity and acceleration of one or several coordinates."""

    position: Float[Array, "*n"]
    velocity: Float[Array, "*n"]
    acceleration: Float[Array, "*n"]


def advance_towards(
    motion: TrajectoryPoint,
    target: Float[Array, "*n"],
    remaining: Float[Array, ""],
    time_step: float | Float[Array, ""],
) -> TrajectoryPoint:
    """One tick along the quintic that reaches `target` at rest after `remaining` [s].

    Solving from the present reference state at each tick lets the target move at will; while it rests, the ticks stay
    on one quintic.
    """
    span = jnp.maximum(remaining, _SHORTEST)
    way = target - motion.position
    speed, bend = motion.velocity * span, motion.acceleration * span**2
    c3 = 10 * way - 6 * speed - 1.5 * bend
    c4 = -15 * way + 8 * speed + 1.5 * bend
    c5 = 6 * way - 3 * speed - 0.5 * bend
    s = jnp.minimum(time_step / span, 1.0)
    position = motion.position + s * (speed + s * (bend / 2 + s * (c3 + s * (c4 + s * c5))))
    velocity = speed + s * (bend + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))
    acceleration = bend + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))
    return TrajectoryPoint(position, velocity / span, acceleration / span**2)


def rise_and_fall(
    phase: Float[Array, ""],
    phase_rate: Float[Array, ""],
    start: Float[Array, ""],
    height: Scalar,
    landing_speed: Scalar,
    step_time: Scalar,
) -> TrajectoryPoint:
    """Vertical motion of the swing foot: `start` at phase 0, `height` at 1/2, 0 with `landing_speed` downward at 1.

    Two quintics that agree in all derivatives up to the second at the apex.

    Args:
        phase: 0..1 through the swing; phase_rate: its time derivative [1/s].
        start, height: [m] above the stance foot.
        landing_speed: [m/s] at the nominal step time [s].
    """
    apex_bend = -16.0 * height / 4
    upward = phase < 0.5
    s = jnp.where(upward, 2 * phase, 2 * phase - 1)
    # Each half spans one unit of s. Boundary values (position, slope, curvature) at its ends:
    first = jnp.where(upward, start, height)
    last = jnp.where(upward, height, 0.0)
    last_slope = jnp.where(upward, 0.0, -landing_speed * step_time / 2)
    first_bend = jnp.where(upward, 0.0, apex_bend)
    last_bend = jnp.where(upward, apex_bend, 0.0)
    way = last - first - first_bend / 2
    slope = last_slope - first_bend
    bend = last_bend - first_bend
    c3 = 10 * way - 4 * slope + bend / 2
    c4 = -15 * way + 7 * slope - bend
    c5 = 6 * way - 3 * slope + bend / 2
    rate = 2 * phase_rate
    position = first + s**2 * (first_bend / 2 + s * (c3 + s * (c4 + s * c5)))
    velocity = s * (first_bend + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))
    acceleration = first_bend + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))
    return TrajectoryPoint(position, velocity * rate, acceleration * rate**2)

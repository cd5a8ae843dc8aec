"""The robot state that iStepper and the step MPC see, and how to sample plausible ones."""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import Side, side_sign
from iwalker_jax.optimization import HlipParameters, pendulum_flow

MOST_FOOTSTEPS = 200
"""Planned at a time."""


@dataclass(frozen=True)
class StepGeometry:
    """How BRUCE's feet are placed about a path.

    Attributes:
        length: [m] desired advance along the path from one footstep to the next.
        width: [m] desired distance between the two feet's tracks; the left track lies at +width/2.
        count: footsteps planned at a time.
    """

    length: float = 0.08
    width: float = 0.10
    count: int = 20

    def __post_init__(self) -> None:
        if not (0 < self.length <= 0.2 and 0.03 <= self.width <= 0.2):
            raise InputError(
                f"Step length must lie in (0, 0.20] m and width in [0.03, 0.20] m, got {self.length} and {self.width}."
            )
        if not 1 <= self.count <= MOST_FOOTSTEPS:
            raise InputError(f"The step count must lie in 1..{MOST_FOOTSTEPS}.")

    @classmethod
    def published(cls) -> "StepGeometry":
        """The paper's 150 footsteps of 1 cm; it names no width between the feet."""
        return cls(length=0.01, count=150)


class RobotState(NamedTuple):
    """What iStepper knows of the robot, in the base frame whose origin lies below the COM.

    Attributes:
        com_from_stance: (2,) [m] COM position minus stance foot (x forward, y left).
        com_velocity: (2,) [m/s].
        stance_sign: () `side_sign` of the stance foot: +1 for the left one, so that the next footstep is a right one.
        time_in_step: () [s] since the last touchdown.
    """

    com_from_stance: Float[Array, "*batch 2"]
    com_velocity: Float[Array, "*batch 2"]
    stance_sign: Float[Array, "*batch"]
    time_in_step: Float[Array, "*batch"]

    def mirrored(self) -> "RobotState":
        """The state of the mirror-image robot (left and right exchanged)."""
        flip = jnp.asarray([1.0, -1.0], self.com_from_stance.dtype)
        return RobotState(self.com_from_stance * flip, self.com_velocity * flip, -self.stance_sign, self.time_in_step)


def standing_state(geometry: StepGeometry) -> RobotState:
    """A robot that stands still with its COM midway between its feet; the right foot is the stance foot, so that the
    left one steps first."""
    from_stance = jnp.asarray([0.0, -side_sign(Side.RIGHT) * geometry.width / 2])
    return RobotState(from_stance, jnp.zeros(2), jnp.asarray(float(side_sign(Side.RIGHT))), jnp.asarray(0.0))


def next_foot(state: RobotState) -> Int[Array, "*batch"]:
    """The foot that steps next, a `Side`."""
    return jnp.where(state.stance_sign > 0, Side.RIGHT, Side.LEFT).astype(jnp.int32)


def pre_impact_planes(state: RobotState, hlip: HlipParameters) -> Float[Array, "2 3"]:
    """Pre-impact H-LIP states [c, p, v] of the x and the y plane, reached by the pendulum at this step's end."""
    remaining = jnp.clip(hlip.single_support_time - state.time_in_step, 0.0, hlip.single_support_time)
    position, velocity = pendulum_flow(hlip.rate, state.com_from_stance, state.com_velocity, remaining)
    return jnp.stack([position - state.com_from_stance, position, velocity], axis=-1)


def sample_robot_state(key: Array, geometry: StepGeometry, hlip: HlipParameters) -> RobotState:
    """A random disturbed state near the walking orbits: any phase, either side, speed 0 to 0.3 m/s."""
    k_side, k_speed, k_time, k_position, k_velocity = jax.random.split(key, 5)
    rate = hlip.rate
    period = hlip.single_support_time
    sign = side_sign(jax.random.bernoulli(k_side).astype(float))
    speed = jax.random.uniform(k_speed, minval=0.0, maxval=0.3)
    time = jax.random.uniform(k_time, minval=0.0, maxval=period)
    # Both orbits are symmetric about mid-stance: sinh in the direction of travel, cosh sideways.
    phase = rate * (time - period / 2)
    half = rate * period / 2
    x = speed * period / 2 * jnp.sinh(phase) / jnp.sinh(half)
    vx = speed * period / 2 * rate * jnp.cosh(phase) / jnp.sinh(half)
    y = -sign * geometry.width / 2 * jnp.cosh(phase) / jnp.cosh(half)
    vy = -sign * geometry.width / 2 * rate * jnp.sinh(phase) / jnp.cosh(half)
    position = jnp.stack([x, y]) + 0.01 * jax.random.normal(k_position, (2,))
    velocity = jnp.stack([vx, vy]) + 0.03 * jax.random.normal(k_velocity, (2,))
    return RobotState(position, velocity, sign, time)

"""Where the next foot lands and when: step MPC feedback about a plan, reach, and step timing.

The step MPC is linear in its wanted footsteps and its initial state, and its pendulum never changes during a walk, so
its first step is a constant gain, taken once from `solve_step_mpc` in double precision.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from iwalker_jax.control.parameters import GaitParameters
from iwalker_jax.geometry import turn
from iwalker_jax.optimization import pendulum_flow, solve_step_mpc, step_matrices

_SHARES = 9  # candidate durations of the rest of a step


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SteppingGains:
    """Constants of the stepping feedback, in one plane; both planes share them.

    Attributes:
        rate: pendulum rate lambda [1/s].
        wanted: (N,) gain of the next footstep on the wanted footsteps, all relative to the stance foot.
        state: (2,) gain on the pre-impact COM position [m] and velocity [m/s] relative to the stance foot.
        orbit_own, orbit_other: (2, 2) map learned prediction errors of the present and of the other stance side to the
            shift of the period-two orbit's pre-impact state that they cause.
    """

    rate: Float[Array, ""]
    wanted: Float[Array, " n"]
    state: Float[Array, "2"]
    orbit_own: Float[Array, "2 2"]
    orbit_other: Float[Array, "2 2"]


def stepping_gains(gait: GaitParameters, dtype: DTypeLike = np.float32) -> SteppingGains:
    """Gains of the step MPC's first step. A host-side computation, once per set of parameters."""
    with jax.enable_x64(True):

        def first_step(wanted: Array, position: Array, velocity: Array) -> Array:
            plane = jnp.stack([position, position, velocity])
            both = jnp.stack([plane, plane])
            return solve_step_mpc(jnp.stack([wanted, wanted], axis=1), both, gait.hlip, gait.mpc).value.footsteps[0, 0]

        zero = jnp.zeros((), jnp.float64)
        gains = jax.jacfwd(first_step, argnums=(0, 1, 2))(jnp.zeros(gait.horizon, jnp.float64), zero, zero)
        transition = np.asarray(step_matrices(gait.hlip)[0][1:, 1:], np.float64)
        rate = float(gait.hlip.rate)
    # Fixed point of x_own = A x_other + w_own, x_other = A x_own + w_other.
    inverse = np.linalg.inv(np.eye(2) - transition @ transition)
    return SteppingGains(
        rate=jnp.asarray(rate, dtype),
        wanted=jnp.asarray(gains[0], dtype),
        state=jnp.asarray([float(gains[1]), float(gains[2])], dtype),
        orbit_own=jnp.asarray(inverse, dtype),
        orbit_other=jnp.asarray(inverse @ transition, dtype),
    )


class StepChoice(NamedTuple):
    """The next footstep and when it touches down.

    Attributes:
        footstep: (2,) [m] in the frame of the wanted footsteps, within reach.
        unbounded: (2,) [m] what the step MPC asked for.
        remaining: () [s] until touchdown.
    """

    footstep: Float[Array, "2"]
    unbounded: Float[Array, "2"]
    remaining: Float[Array, ""]


def choose_step(
    gait: GaitParameters,
    gains: SteppingGains,
    wanted: Float[Array, "n 2"],
    com: tuple[Float[Array, "2"], Float[Array, "2"]],
    expected: Float[Array, "2 2"],
    heading: Float[Array, ""],
    swing_sign: Float[Array, ""],
    swing: Float[Array, "2"],
    remaining: Float[Array, ""],
) -> StepChoice:
    """Footstep and remaining time that keep the pendulum walking, within the leg's reach and the swing foot's speed.

    If the step MPC's footstep at the nominal time is out of reach, shorter or longer times are compared on a grid: the
    divergent component grows exponentially, so a quick step needs less reach than a wide one.

    Args:
        wanted: next footsteps [m] relative to the stance foot, world axes, as all positions here.
        com: position [m] and velocity [m/s].
        expected: (2, 2) known deviation of the pre-impact state from the pendulum's prediction and orbit (sagittal and
            lateral; position [m] and velocity [m/s]).
        heading: of the step's frame [rad].
        swing_sign: `side_sign` of the swing foot.
        swing: present swing-foot position [m].
        remaining: nominal time to touchdown [s].
    """
    grid = jnp.concatenate([jnp.ones(1), jnp.linspace(gait.fastest, gait.slowest, _SHARES)]).astype(remaining.dtype)
    times = jnp.maximum(grid * remaining, 1e-3)
    position, velocity = (turn(-heading, x) for x in com)
    ahead_position, ahead_velocity = pendulum_flow(gains.rate, position[None], velocity[None], times[:, None])
    ahead_position = ahead_position + expected[:, 0]
    ahead_velocity = ahead_velocity + expected[:, 1]
    local = turn(-heading, wanted)
    if not gait.feedback:
        return StepChoice(wanted[0], wanted[0], times[0])
    steps = gains.wanted @ local + gains.state[0] * ahead_position + gains.state[1] * ahead_velocity
    # Governor: far off the plan, the plan comes along. Moving it by o leaves (steps - local) - stiffness o; the rest of
    # the correction is then plain placement at the divergent component, which does not overshoot.
    stiffness = 1 - jnp.sum(gains.wanted)
    error = steps - local[0]
    size = jnp.sqrt(jnp.sum(error**2, axis=1, keepdims=True) + 1e-12)
    excess = error * jnp.maximum(1 - gait.governor / size, 0)
    steps = steps - (1 - 1 / stiffness) * excess
    lateral = jnp.clip(swing_sign * steps[:, 1], gait.reach.lateral_min, gait.reach.lateral_max) * swing_sign
    back = jnp.maximum(ahead_position[:, 0] - gait.behind, -gait.reach.sagittal)
    front = jnp.minimum(ahead_position[:, 0] + gait.ahead, gait.reach.sagittal)
    bounded = jnp.stack([jnp.clip(steps[:, 0], back, jnp.maximum(front, back)), lateral], axis=1)
    beyond = jnp.sum((steps - bounded) ** 2, axis=1)
    trailing = jnp.maximum(ahead_position[:, 0] - gait.behind, 0) ** 2
    way = jnp.sqrt(jnp.sum((bounded - turn(-heading, swing)) ** 2, axis=1) + 1e-12)
    late = jnp.maximum(way - gait.swing_speed * times, 0) ** 2
    price = beyond + late + trailing + gait.timing_weight * (grid - 1) ** 2
    best = jnp.argmin(price)
    return StepChoice(turn(heading, bounded[best]), turn(heading, steps[best]), times[best])

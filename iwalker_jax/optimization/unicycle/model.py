"""The unicycle tracking problem: its parameters, motion, cost and a start taken from a reference path.

    min over (omega, a) of  sum_k w_pos |p_k - ref_k|^2 + sum_k (w_turn omega_k^2 + w_acc a_k^2)
    x+ = x + dt v cos(theta),  y+ = y + dt v sin(theta),  v+ = v + dt a,  theta+ = theta + dt omega

(iWalker, eqs. 5-7.) The heading is never wrapped, so paths may turn any number of times.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.checks import require_plain_numbers
from iwalker_jax.errors import InputError

UnicycleMethod = Literal["ddp", "ilqr"]
"""The curvature that iterations see: with the motion's second derivatives (differential dynamic programming), or with
the cost's alone (Gauss-Newton, the iterative linear-quadratic regulator)."""


@dataclass(frozen=True)
class UnicycleParameters:
    """Weights, bounds and solver settings of the unicycle tracking problem.

    Attributes:
        position_weight: w_pos [1/m^2].
        turn_weight: w_turn [(sample/rad)^2].
        acceleration_weight: w_acc [(sample^2/m)^2].
        dt: time between points [samples]; the published problem folds it to 1.
        turn_bound: largest |omega| [rad/sample], None = free.
        acceleration_bound: largest |a| [m/sample^2], None = free.
        speed_bound: largest |v| [m/sample], None = free; the given initial speed is not counted.
        method: of the iterations; `ddp` is quicker, `ilqr` the usual one to compare with. Implicit derivatives of the
            optimum take the motion's second derivatives with either.
        max_iterations: iterations at most, on the coarse grid of the search and again on the full one.
        unrolled_iterations: iterations on the full grid that the `unrolled` gradient mode makes and differentiates.
        tolerance: residual (relative length of the next Newton step, see `solve_unicycle`) that counts as solved.
        position_floor: position error [m] below which accuracy no longer matters; it keeps the residual of a
            perfectly tracked reference meaningful.
    """

    position_weight: float = 1.0
    turn_weight: float = 1000.0
    acceleration_weight: float = 5000.0
    dt: float = 1.0
    turn_bound: float | None = None
    acceleration_bound: float | None = None
    speed_bound: float | None = None
    method: UnicycleMethod = "ddp"
    max_iterations: int = 40
    unrolled_iterations: int = 10
    tolerance: float = 1e-3
    position_floor: float = 1e-3

    def __post_init__(self) -> None:
        require_plain_numbers(self)
        for name in ("position_weight", "turn_weight", "acceleration_weight", "dt", "tolerance", "position_floor"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"UnicycleParameters.{name} must be positive and finite, got {value}.")
        for name in ("turn_bound", "acceleration_bound", "speed_bound"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(f"UnicycleParameters.{name} must be positive and finite or None, got {value}.")
        if self.method not in get_args(UnicycleMethod):
            raise InputError(
                f"UnicycleParameters.method is {self.method!r}; choose one of {', '.join(get_args(UnicycleMethod))}."
            )
        if not (1 <= self.max_iterations <= 100_000 and 1 <= self.unrolled_iterations <= 10_000):
            raise InputError(
                f"UnicycleParameters.max_iterations and unrolled_iterations are {self.max_iterations} and "
                f"{self.unrolled_iterations}; give 1 to 100000 and 1 to 10000."
            )

    @classmethod
    def published(cls) -> "UnicycleParameters":
        """The paper's weights together with the tight control bounds it was trained with."""
        return cls(turn_bound=1e-3, acceleration_bound=1e-2)

    @property
    def bounded(self) -> bool:
        """Whether any bound is present."""
        return any(b is not None for b in (self.turn_bound, self.acceleration_bound, self.speed_bound))

    def weights(self) -> Float[Array, "3"]:
        """The three weights as an array, in the order position, turn, acceleration."""
        return jnp.array([self.position_weight, self.turn_weight, self.acceleration_weight])


class UnicyclePlan(NamedTuple):
    """A planned motion.

    Attributes:
        path: (N, 2) positions [m].
        states: (N, 4) states [x, y, v, theta] [m, m, m/sample, rad]; theta is unwrapped.
        controls: (N-1, 2) controls [omega, a] [rad/sample, m/sample^2].
        cost: () value of the objective.
    """

    path: Float[Array, "n 2"]
    states: Float[Array, "n 4"]
    controls: Float[Array, "m 2"]
    cost: Float[Array, ""]


def _running_sum(increments: Float[Array, " m"]) -> Float[Array, " n"]:
    return jnp.concatenate([jnp.zeros_like(increments[:1]), jnp.cumsum(increments)])


def unicycle_rollout(
    initial_state: Float[Array, "4"], controls: Float[Array, "m 2"], dt: float = 1.0
) -> Float[Array, "n 4"]:
    """Motion that follows from the controls (iWalker, eqs. 5-7).

    Args:
        initial_state: (4,) [x, y, v, theta] [m, m, m/sample, rad].
        controls: (N-1, 2) [omega, a] [rad/sample, m/sample^2].
        dt: time between points [samples].

    Returns:
        (N, 4) states, of the initial state's units; every component is a running sum, so no step waits for another.
    """
    theta = initial_state[3] + _running_sum(dt * controls[:, 0])
    speed = initial_state[2] + _running_sum(dt * controls[:, 1])
    x = initial_state[0] + _running_sum(dt * (speed * jnp.cos(theta))[:-1])
    y = initial_state[1] + _running_sum(dt * (speed * jnp.sin(theta))[:-1])
    return jnp.stack([x, y, speed, theta], axis=-1)


def tracking_cost(
    states: Float[Array, "n 4"],
    controls: Float[Array, "m 2"],
    reference: Float[Array, "n 2"],
    weights: Float[Array, "3"],
) -> Float[Array, ""]:
    """The objective of the problem for a motion.

    Args:
        states: (N, 4) [x, y, v, theta].
        controls: (N-1, 2) [omega, a].
        reference: (N, 2) positions to follow [m].
        weights: (3,) position, turn and acceleration weight.

    Returns:
        () cost.
    """
    return (
        weights[0] * jnp.sum((states[:, :2] - reference) ** 2)
        + weights[1] * jnp.sum(controls[:, 0] ** 2)
        + weights[2] * jnp.sum(controls[:, 1] ** 2)
    )


def initial_state_from_reference(reference: Float[Array, "n 2"], dt: float = 1.0) -> Float[Array, "4"]:
    """State at the start of a reference: its first point, its mean speed and its first direction.

    Args:
        reference: (N, 2) positions [m]; points may repeat.
        dt: time between points [samples].

    Returns:
        (4,) [x, y, v, theta]. The heading points from the first point to the first one that differs from it, and is
        0 with a zero derivative for a reference that never moves; repeated points add no speed and no derivative.
    """
    segments = jnp.diff(reference, axis=0)
    squared = jnp.sum(segments**2, axis=-1)
    moves = squared > 0
    lengths = jnp.where(moves, jnp.sqrt(jnp.where(moves, squared, 1.0)), 0.0)
    speed = jnp.sum(lengths) / (dt * lengths.shape[0])
    first = segments[jnp.argmax(moves)]
    still = ~jnp.any(moves)
    heading = jnp.where(still, 0.0, jnp.arctan2(first[1], jnp.where(still, 1.0, first[0])))
    return jnp.stack([reference[0, 0], reference[0, 1], speed, heading])

"""Hybrid linear inverted pendulum (H-LIP): step-to-step dynamics, periodic orbits, feedback gains, modes.

Notation: one plane at a time; pre-impact state [c, p, v] with c the COM position [m], p the COM minus the
stance foot [m], v the COM velocity [m/s]; input u the step size [m]. The footstep is s = c - p, and s' = s + u
holds exactly.
Source: Xiong and Ames, "3-D underactuated bipedal walking via H-LIP based gait synthesis and stepping
stabilization" (2022); the iWalker paper, eq. 11. Every function accepts traced fields in `HlipParameters`.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from iwalker_jax.checks import Scalar, require_range
from iwalker_jax.constants import GRAVITY

_DOUBLING_STEPS = 12  # the doubling recursion squares its error: 12 steps equal 4096 Riccati steps


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class HlipParameters:
    """Constants of the pendulum; a pytree, so that any of them may be traced and differentiated.

    Attributes:
        com_height: constant height z0 of the COM above the floor [m].
        single_support_time: duration T_SSP of single support [s].
        double_support_time: duration T_DSP of double support [s].
        gravity: [m/s^2].
    """

    com_height: Scalar = 0.365
    single_support_time: Scalar = 0.24
    double_support_time: Scalar = 0.0
    gravity: Scalar = GRAVITY

    def __post_init__(self) -> None:
        require_range(self, "com_height", 0.01, 10.0, "m")
        require_range(self, "single_support_time", 0.01, 5.0, "s")
        require_range(self, "double_support_time", 0.0, 5.0, "s")
        require_range(self, "gravity", 0.1, 100.0, "m/s^2")

    @property
    def step_time(self) -> Scalar:
        """Duration T of one step, T_SSP + T_DSP [s]."""
        return self.single_support_time + self.double_support_time

    @property
    def rate(self) -> Scalar:
        """The pendulum's rate lambda = sqrt(g / z0) [1/s]."""
        return jnp.sqrt(self.gravity / self.com_height)


class Modes(NamedTuple):
    """Modal form of the (p, v) dynamics: q = p + lead v obeys q' = pole (q - u) in each of two modes.

    Attributes:
        pole: () the unstable pole, > 1; the stable one is its inverse (the step map has determinant 1).
        divergent_lead: () lead time of the divergent component xi = p + lead v [s]; 1/lambda if T_DSP = 0.
        convergent_lead: () lead time of the convergent component zeta [s]; negative.
    """

    pole: Float[Array, ""]
    divergent_lead: Float[Array, ""]
    convergent_lead: Float[Array, ""]


def step_matrices(parameters: HlipParameters) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
    """Step-to-step map x' = A x + B u of the pre-impact state [c, p, v] [m, m, m/s] (iWalker, eq. 11): A and B."""
    rate, double = parameters.rate, parameters.double_support_time
    cosh = jnp.cosh(rate * parameters.single_support_time)
    sinh = jnp.sinh(rate * parameters.single_support_time)
    drift = double * cosh + sinh / rate
    one, zero = jnp.ones_like(cosh), jnp.zeros_like(cosh)
    state = jnp.stack(
        [
            jnp.stack([one, cosh - 1, drift]),
            jnp.stack([zero, cosh, drift]),
            jnp.stack([zero, rate * sinh, cosh + rate * double * sinh]),
        ]
    )
    return state, jnp.stack([1 - cosh, -cosh, -rate * sinh])


def modes(parameters: HlipParameters) -> Modes:
    """Eigenvalues and left eigenvectors of the (p, v) block, in forms that do not cancel for short steps."""
    rate, double = parameters.rate, parameters.double_support_time
    angle = rate * parameters.single_support_time
    sinh = jnp.sinh(angle)
    sway = rate * double * sinh
    # trace - 2 and trace + 2 of the block, whose trace is 2 cosh + sway.
    below, above = 4 * jnp.sinh(angle / 2) ** 2 + sway, 4 * jnp.cosh(angle / 2) ** 2 + sway
    root = jnp.sqrt(below * above)
    pole = 1 + (below + root) / 2
    return Modes(pole, (sway + root) / (2 * rate * sinh), (sway - root) / (2 * rate * sinh))


def divergent_component(
    parameters: HlipParameters, position: Float[ArrayLike, "*#n"], velocity: Float[ArrayLike, "*#n"]
) -> Float[Array, "*n"]:
    """Divergent component xi = p + lead v [m] relative to the stance foot; xi' = pole (xi - u).

    The COM stays bounded if and only if xi_k = sum_j pole^-j u_{k+j}: the steps to come fix xi, not the past.

    Args:
        parameters: pendulum constants.
        position: pre-impact p [m].
        velocity: pre-impact v [m/s].
    """
    return jnp.asarray(position) + modes(parameters).divergent_lead * velocity


def pendulum_flow(
    rate: Float[Array, ""], position: Float[Array, "*#n"], velocity: Float[Array, "*#n"], time: Float[Array, "*#n"]
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """State of the linear inverted pendulum p'' = lambda^2 p after `time` without a change of foot.

    Args:
        rate: lambda [1/s].
        position: COM minus stance foot [m].
        velocity: [m/s].
        time: [s].

    Returns:
        Position p cosh(lambda t) + v sinh(lambda t) / lambda [m] and velocity [m/s].
    """
    cosh, sinh = jnp.cosh(rate * time), jnp.sinh(rate * time)
    return position * cosh + velocity * sinh / rate, position * rate * sinh + velocity * cosh


def orbit_p1(
    parameters: HlipParameters, velocity: Float[ArrayLike, "*n"]
) -> tuple[Float[Array, "*n"], Float[Array, "*n"], Float[Array, "*n"]]:
    """Period-one (P1) orbit: the walk of equal steps, one plane (Xiong and Ames; usually the sagittal one).

    With sigma1 = lambda coth(lambda T_SSP / 2):  u = v_d T,  p = u / (2 + T_DSP sigma1),  v = sigma1 p.

    Args:
        parameters: pendulum constants.
        velocity: mean velocity v_d [m/s].

    Returns:
        Pre-impact position p [m], velocity v [m/s], and step size u [m].
    """
    sigma = parameters.rate / jnp.tanh(parameters.rate * parameters.single_support_time / 2)
    step = velocity * parameters.step_time
    position = step / (2 + parameters.double_support_time * sigma)
    return position, sigma * position, step


def orbit_p2(
    parameters: HlipParameters, step: Float[ArrayLike, "*#n"], next_step: Float[ArrayLike, "*#n"]
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Period-two (P2) orbit: the walk of two alternating steps, one plane (Xiong and Ames; usually the lateral one).

    With sigma2 = lambda tanh(lambda T_SSP / 2) and the mean velocity v_d = (step + next_step) / (2 T):
    d2 = lambda^2 sech^2(lambda T_SSP / 2) T v_d / (lambda^2 T_DSP + 2 sigma2),
    p = (step - T_DSP d2) / (2 + T_DSP sigma2),  v = sigma2 p + d2. Equal steps give the period-one orbit.

    Args:
        parameters: pendulum constants.
        step: the step about to be taken [m].
        next_step: the one after it [m].

    Returns:
        Pre-impact position p [m] and velocity v [m/s] just before `step` is taken.
    """
    rate, double = parameters.rate, parameters.double_support_time
    half = rate * parameters.single_support_time / 2
    sigma = rate * jnp.tanh(half)
    offset = (rate / jnp.cosh(half)) ** 2 * (step + next_step) / 2 / (rate**2 * double + 2 * sigma)
    position = (step - double * offset) / (2 + double * sigma)
    return position, sigma * position + offset


def deadbeat_gain(parameters: HlipParameters) -> Float[Array, "2"]:
    """Gain K of u = u* + K (x - x*) on x = [p, v] that cancels any deviation in two steps (Xiong and Ames).

    K = [1, T_DSP + coth(lambda T_SSP) / lambda], with x* and u* of a P1 or P2 orbit.

    Returns:
        (2,) gain on p [m/m] and v [s].
    """
    rate = parameters.rate
    lead = parameters.double_support_time + 1 / (rate * jnp.tanh(rate * parameters.single_support_time))
    return jnp.stack([jnp.ones_like(lead), lead])


def lqr_gain(
    parameters: HlipParameters, state_weights: Float[ArrayLike, "2"], input_weight: Scalar
) -> Float[Array, "2"]:
    """Gain K of u = u* + K (x - x*) on x = [p, v] that minimises sum x'diag(w)x + r u^2 for ever.

    The discrete Riccati equation is solved by structure-preserving doubling (Chu, Fan, Lin 2005).

    Args:
        parameters: pendulum constants.
        state_weights: (2,) weights of p [1/m^2] and v [s^2/m^2], not both zero.
        input_weight: weight r > 0 of the step size [1/m^2].

    Returns:
        (2,) gain on p [m/m] and v [s].
    """
    full_state, full_input = step_matrices(parameters)
    state, column = full_state[1:, 1:], full_input[1:]
    eye = jnp.eye(2, dtype=state.dtype)

    def double(carry: tuple[Array, Array, Array], _: None) -> tuple[tuple[Array, Array, Array], None]:
        a, g, h = carry
        w = jnp.linalg.inv(eye + g @ h)
        return (a @ w @ a, g + a @ w @ g @ a.T, h + a.T @ h @ w @ a), None

    weights = jnp.diag(jnp.asarray(state_weights, state.dtype))
    start = (state, jnp.outer(column, column) / input_weight, weights)
    (_, _, cost), _ = jax.lax.scan(double, start, None, length=_DOUBLING_STEPS)
    return -(column @ cost @ state) / (input_weight + column @ cost @ column)

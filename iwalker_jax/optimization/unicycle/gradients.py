"""Exact derivatives of an optimal unicycle plan by the implicit function theorem.

At an optimum a small change of the inputs moves the plan by the solution of a linear-quadratic problem: the same
second-order model the solver factors in its last sweep, driven by the changes of the cost's linear terms. It is
linear in the changes, so JAX runs it forwards (jvp) and transposed (vjp).
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from iwalker_jax.optimization.unicycle.ddp import Trajectory, backward_sweep, uniform_grid
from iwalker_jax.optimization.unicycle.model import UnicycleParameters
from iwalker_jax.optimization.unicycle.stage import ControlLaw, StageInverse
from iwalker_jax.promotion import usual_promotion

# An optimum flatter than this (control Hessian over control weights) has no trustworthy derivative.
MINIMUM_CURVATURE = 1e-4


class TrackingInputs(NamedTuple):
    """Everything an optimal plan depends on, seen from the initial position.

    Attributes:
        x, y: (N,) reference relative to the initial position [m].
        speed: () initial speed [m/sample].
        theta: () initial heading [rad].
        weights: (3,) position, turn, acceleration.
    """

    x: Float[Array, " n"]
    y: Float[Array, " n"]
    speed: Float[Array, ""]
    theta: Float[Array, ""]
    weights: Float[Array, "3"]


@partial(jax.custom_jvp, nondiff_argnums=(2,))
def attach_derivatives(inputs: TrackingInputs, optimum: Trajectory, parameters: UnicycleParameters) -> Trajectory:
    """Return the optimum unchanged, with the derivatives an optimum of these inputs has.

    Args:
        inputs: the problem; derivatives are taken with respect to all of it.
        optimum: its solution, a constant. Controls at a bound stay there.
        parameters: bounds and dt.
    """
    del inputs, parameters
    return optimum


@attach_derivatives.defjvp
@usual_promotion
def _attach_jvp(
    parameters: UnicycleParameters, primals: tuple[TrackingInputs, Trajectory], tangents: tuple[TrackingInputs, Any]
) -> tuple[Trajectory, Trajectory]:
    inputs, optimum = primals
    undamped = jnp.zeros_like(inputs.speed)
    reference = (inputs.x, inputs.y)
    grid = uniform_grid(inputs.x, parameters.dt)
    law, inverse, _ = backward_sweep(optimum, reference, inputs.weights, undamped, MINIMUM_CURVATURE, grid, parameters)
    return optimum, _sensitivity(inputs, optimum, law, inverse, tangents[0], parameters.dt)


def _sensitivity(
    inputs: TrackingInputs,
    optimum: Trajectory,
    law: ControlLaw,
    inverse: StageInverse,
    change: TrackingInputs,
    dt: float,
) -> Trajectory:
    """Change of the optimum for a change of the inputs: one backward and one forward linear recursion."""
    wp, dwp, dwt, dwa = inputs.weights[0], change.weights[0], change.weights[1], change.weights[2]
    lx = 2 * (dwp * (optimum.x - inputs.x) - wp * change.x)
    ly = 2 * (dwp * (optimum.y - inputs.y) - wp * change.y)
    lw, la = 2 * dwt * optimum.omega, 2 * dwa * optimum.acceleration
    c, s = dt * jnp.cos(optimum.theta[:-1]), dt * jnp.sin(optimum.theta[:-1])
    d, e = -optimum.speed[:-1] * s, optimum.speed[:-1] * c

    def back(costate: tuple, stage: tuple) -> tuple[tuple, tuple]:
        px, py, pv, pt = costate
        lx, ly, lw, la, c, s, d, e, gain, inv = stage
        gw, ga = lw + dt * pt, la + dt * pv
        before = (
            px + lx + gain.Kwx * gw + gain.Kax * ga,
            py + ly + gain.Kwy * gw + gain.Kay * ga,
            c * px + s * py + pv + gain.Kwv * gw + gain.Kav * ga,
            d * px + e * py + pt + gain.Kwt * gw + gain.Kat * ga,
        )
        return before, (-(inv.ww * gw + inv.wa * ga), -(inv.wa * gw + inv.aa * ga))

    def forth(state: tuple, stage: tuple) -> tuple[tuple, tuple]:
        x, y, v, t = state
        kw, ka, c, s, d, e, gain = stage
        w = kw + gain.Kwx * x + gain.Kwy * y + gain.Kwv * v + gain.Kwt * t
        a = ka + gain.Kax * x + gain.Kay * y + gain.Kav * v + gain.Kat * t
        return (x + c * v + d * t, y + s * v + e * t, v + dt * a, t + dt * w), (*state, w, a)

    zero = jnp.zeros_like(change.speed)
    along = (lx[:-1], ly[:-1], lw, la, c, s, d, e, law, inverse)
    _, (kw, ka) = lax.scan(back, (lx[-1], ly[-1], zero, zero), along, reverse=True)
    last, passed = lax.scan(forth, (zero, zero, change.speed, change.theta), (kw, ka, c, s, d, e, law))
    states = (jnp.concatenate([values, end[None]]) for values, end in zip(passed[:4], last))
    return Trajectory(*states, *passed[4:])

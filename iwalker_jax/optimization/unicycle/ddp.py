"""One second-order sweep of differential dynamic programming for the unicycle: back over all stages, then forward."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from iwalker_jax.optimization.unicycle.model import UnicycleParameters
from iwalker_jax.optimization.unicycle.stage import (
    ControlLaw,
    CostToGo,
    Stage,
    StageInverse,
    best_controls,
    control_law,
    control_limits,
    convexified,
    cost_before,
    expand,
    follow_speed_bound,
    gradient_before,
)


class Trajectory(NamedTuple):
    """A motion as separate components; any trailing axes are independent motions.

    Attributes:
        x, y: (N, ...) position [m].
        speed: (N, ...) [m/sample].
        theta: (N, ...) heading [rad], unwrapped.
        omega: (N-1, ...) turn rate [rad/sample].
        acceleration: (N-1, ...) [m/sample^2].
    """

    x: Float[Array, " n *b"]
    y: Float[Array, " n *b"]
    speed: Float[Array, " n *b"]
    theta: Float[Array, " n *b"]
    omega: Float[Array, " m *b"]
    acceleration: Float[Array, " m *b"]


class TimeGrid(NamedTuple):
    """Time steps of a motion; arrays broadcast against a batch on a trailing axis.

    Attributes:
        dt: (N-1, ...) length of each step [samples].
        mass: (N, ...) points of the reference that each point stands for.
        span: (N-1, ...) controls that each step's controls stand for.
    """

    dt: Float[Array, " m *g"]
    mass: Float[Array, " n *g"]
    span: Float[Array, " m *g"]


def uniform_grid(like: Float[Array, " n *b"], dt: float) -> TimeGrid:
    """Equal steps of `dt` [samples] for a motion of as many points as `like`."""
    return TimeGrid(jnp.full_like(like[1:], dt), jnp.ones_like(like), jnp.ones_like(like[1:]))


def backward_sweep(
    trajectory: Trajectory,
    reference: tuple[Float[Array, " n *b"], Float[Array, " n *b"]],
    weights: Float[Array, " 3 *b"],
    damping: Float[Array, "*b"],
    curvature_floor: float,
    grid: TimeGrid,
    parameters: UnicycleParameters,
    second_order: bool = True,
) -> tuple[ControlLaw, StageInverse, Float[Array, "*b"]]:
    """Quadratic model of the cost to go from the last stage to the first.

    Args:
        trajectory: nominal motion.
        reference: x and y of the reference, (N, ...) each [m].
        weights: (3, ...) position, turn, acceleration.
        damping: (...) Levenberg-Marquardt damping, relative to the control weights.
        curvature_floor: stages whose control Hessian has a smaller eigenvalue, relative to the control weights, are
            convexified up to it.
        grid: time steps.
        parameters: bounds.
        second_order: whether the model has the motion's second derivatives; without, it is Gauss and Newton's.

    Returns:
        The control law, the stage inverses, and the decrease of the cost that the quadratic model promises.
    """
    x, y, speed, theta, omega, acceleration = trajectory
    mass = 2 * weights[0] * grid.mass
    turn_cost, acceleration_cost = 2 * weights[1] * grid.span, 2 * weights[2] * grid.span
    ex, ey = mass * (x - reference[0]), mass * (y - reference[1])

    def sweep(after: CostToGo, stage: Stage) -> tuple[CostToGo, tuple[ControlLaw, StageInverse]]:
        q, curvature, shift = convexified(expand(after, stage, second_order), stage, damping, curvature_floor)
        controls, inverse = best_controls(q, curvature, shift, stage, parameters)
        law = control_law(q, controls, inverse)
        gradient = gradient_before(q, law)
        if parameters.speed_bound is not None:
            ride = -controls.on_speed_bound / stage.dt
            q, law, gradient = follow_speed_bound(q, law, gradient, inverse, ride)
        return cost_before(q, law, gradient, after.promised), (law, inverse)

    zero = jnp.zeros_like(ex[-1])
    hessian = (zero + mass[-1], zero, zero + mass[-1], zero, zero, zero, zero, zero, zero, zero)
    terminal = CostToGo(*hessian, ex[-1], ey[-1], zero, zero, zero)
    c, s = grid.dt * jnp.cos(theta[:-1]), grid.dt * jnp.sin(theta[:-1])
    costs = (mass[:-1], turn_cost, acceleration_cost, grid.dt)
    stages = Stage(ex[:-1], ey[:-1], speed[:-1], c, s, omega, acceleration, *costs)
    first, (law, inverse) = lax.scan(sweep, terminal, stages, reverse=True)
    return law, inverse, first.promised


def forward_sweep(
    trajectory: Trajectory,
    law: ControlLaw,
    step: Float[Array, "*b"],
    reference: tuple[Float[Array, " n *b"], Float[Array, " n *b"]],
    weights: Float[Array, " 3 *b"],
    grid: TimeGrid,
    parameters: UnicycleParameters,
) -> tuple[Trajectory, Float[Array, "*b"]]:
    """Follow a control law from the trajectory's initial state with the true motion; controls are kept in their bounds.

    Args:
        trajectory: the motion the law was made around.
        law: affine control law around it.
        step: (...) fraction of the law's open-loop change to take.
        reference: x and y of the reference, (N, ...) each [m].
        weights: (3, ...) position, turn, acceleration.
        grid: time steps.
        parameters: bounds.

    Returns:
        The new motion and its cost.
    """

    def stage(state: tuple, nominal: tuple) -> tuple[tuple, tuple]:
        x, y, v, t, cost = state
        x0, y0, v0, t0, w0, a0, rx, ry, gain, dt, mass, span = nominal
        dx, dy, dv, dth = x - x0, y - y0, v - v0, t - t0
        w = w0 + step * gain.kw + gain.Kwx * dx + gain.Kwy * dy + gain.Kwv * dv + gain.Kwt * dth
        a = a0 + step * gain.ka + gain.Kax * dx + gain.Kay * dy + gain.Kav * dv + gain.Kat * dth
        if parameters.bounded:
            w_low, w_high, a_low, a_high = control_limits(v, dt, parameters)
            w, a = jnp.clip(w, w_low, w_high), jnp.clip(a, a_low, a_high)
        cost = cost + mass * weights[0] * ((x - rx) ** 2 + (y - ry) ** 2)
        cost = cost + span * (weights[1] * w * w + weights[2] * a * a)
        moved = (x + dt * v * jnp.cos(t), y + dt * v * jnp.sin(t), v + dt * a, t + dt * w, cost)
        return moved, (x, y, v, t, w, a)

    start = (*(component[0] for component in trajectory[:4]), jnp.zeros_like(trajectory.x[0]))
    along = (
        *(c[:-1] for c in trajectory[:4]),
        *trajectory[4:],
        reference[0][:-1],
        reference[1][:-1],
        law,
        grid.dt,
        grid.mass[:-1],
        grid.span,
    )
    last, passed = lax.scan(stage, start, along)
    states = (jnp.concatenate([values, end[None]]) for values, end in zip(passed[:4], last[:4]))
    miss = (last[0] - reference[0][-1]) ** 2 + (last[1] - reference[1][-1]) ** 2
    return Trajectory(*states, *passed[4:]), last[4] + grid.mass[-1] * weights[0] * miss

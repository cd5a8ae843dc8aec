"""Newton or Gauss-Newton iterations of the unicycle problem for many paths at once.

The batch ("lanes") is the last axis. `UnicycleParameters.method` chooses the curvature that steps are made of; how near
the optimum is, and how curved, is told by the problem's own curvature with both.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from iwalker_jax.optimization.unicycle.ddp import (
    TimeGrid,
    Trajectory,
    backward_sweep,
    forward_sweep,
    uniform_grid,
)
from iwalker_jax.optimization.unicycle.gradients import TrackingInputs
from iwalker_jax.optimization.unicycle.model import UnicycleParameters
from iwalker_jax.optimization.unicycle.stage import ControlLaw
from iwalker_jax.optimization.unicycle.starts import STARTS, coarse_grid, starting_motions
from iwalker_jax.promotion import usual_promotion

# Step lengths tried side by side.
_STEPS = (1.0, 0.3)
# Less convex stages (relative to the control weights) make the quadratic model explode on its way back.
_CURVATURE_FLOOR = 0.1
# A start is given up when even this many times the promised decrease would leave it behind the best one. Promises far
# from an optimum say little about the end: smaller factors miss it more often.
_OPTIMISM = 100.0
# A model that promises the cost to rise by more than this share of it has exploded on its way back.
_BROKEN_PROMISE = 1e-3
# The coarse grid's answer is only a start, so it need not be better than this.
_COARSE_TOLERANCE = 0.03
_COARSE_ITERATIONS = 16


class Iterate(NamedTuple):
    """Progress of each lane.

    Attributes:
        trajectory: the motion, (N, lanes) each.
        cost: (lanes,) its cost.
        law: the control law around it.
        promised: (lanes,) decrease of the cost that the method's quadratic model promises.
        curvature: (lanes,) smallest curvature of any stage.
        margin: (lanes,) smallest distance of any stage from a change of its active bounds, relative.
        damping: (lanes,) Levenberg-Marquardt damping.
        iterations: (lanes,) iterations so far.
    """

    trajectory: Trajectory
    cost: Float[Array, " lanes"]
    law: ControlLaw
    promised: Float[Array, " lanes"]
    curvature: Float[Array, " lanes"]
    margin: Float[Array, " lanes"]
    damping: Float[Array, " lanes"]
    iterations: Int[Array, " lanes"]


def residual(iterate: Iterate, inputs: TrackingInputs, parameters: UnicycleParameters) -> Float[Array, " lanes"]:
    """Length of the next Newton step relative to the plan, both measured by the cost (see `solve_unicycle`)."""
    floor = inputs.weights[0] * inputs.x.shape[0] * parameters.position_floor**2
    # A damped step promises less than a full one.
    promised = jnp.maximum(iterate.promised, 0.0) * (1 + iterate.damping)
    return jnp.sqrt(2 * promised / (iterate.cost + floor))


def _credible(promised: Float[Array, " lanes"], cost: Float[Array, " lanes"]) -> Float[Array, " lanes"]:
    """The promised decreases, NaN where the model broke down: such a lane is neither finished nor hopeless."""
    return jnp.where(promised < -_BROKEN_PROMISE * cost, jnp.nan, promised)


def second_order_view(
    iterate: Iterate, inputs: TrackingInputs, grid: TimeGrid, parameters: UnicycleParameters
) -> Iterate:
    """The iterate with promise, curvature and margin of the second-order model at its motion, whatever the method.

    A Gauss-Newton model is convex where the problem is not, and its steps are shorter than the way to the optimum.
    """
    if parameters.method == "ddp":
        return iterate
    undamped = jnp.zeros_like(iterate.damping)
    reference = (inputs.x, inputs.y)
    _, inverse, promised = backward_sweep(
        iterate.trajectory, reference, inputs.weights, undamped, _CURVATURE_FLOOR, grid, parameters
    )
    promised = _credible(promised, iterate.cost)
    # Far from an optimum this model may break down where the method's own does not: that is no non-finite plan.
    far = ~jnp.isfinite(promised) & ~(residual(iterate, inputs, parameters) <= parameters.tolerance)
    return iterate._replace(
        promised=jnp.where(far, iterate.promised, promised),
        damping=jnp.where(far, iterate.damping, undamped),
        curvature=jnp.min(inverse.curvature, axis=0),
        margin=jnp.min(inverse.margin, axis=0),
    )


def begin(
    inputs: TrackingInputs,
    speed: Float[Array, "n lanes"],
    theta: Float[Array, "n lanes"],
    grid: TimeGrid,
    parameters: UnicycleParameters,
) -> Iterate:
    """First iterate from speeds and headings over time."""
    zero = jnp.zeros_like(inputs.speed)
    still = jnp.zeros_like(speed[:-1])
    speed, theta = speed.at[0].set(inputs.speed), theta.at[0].set(inputs.theta)
    nowhere = jnp.zeros_like(speed)
    guess = Trajectory(
        nowhere, nowhere, speed, theta, jnp.diff(theta, axis=0) / grid.dt, jnp.diff(speed, axis=0) / grid.dt
    )
    hold = ControlLaw(*(still for _ in ControlLaw._fields))
    reference = (inputs.x, inputs.y)
    trajectory, cost = forward_sweep(guess, hold, zero, reference, inputs.weights, grid, parameters)
    law, inverse, promised = backward_sweep(
        trajectory, reference, inputs.weights, zero, _CURVATURE_FLOOR, grid, parameters, parameters.method == "ddp"
    )
    count = jnp.zeros(zero.shape, jnp.int32)
    curvature, margin = jnp.min(inverse.curvature, axis=0), jnp.min(inverse.margin, axis=0)
    return Iterate(trajectory, cost, law, _credible(promised, cost), curvature, margin, zero, count)


def advance(
    iterate: Iterate, inputs: TrackingInputs, grid: TimeGrid, active: Array, parameters: UnicycleParameters
) -> Iterate:
    """Try several step lengths, keep the best one where it is an improvement, and sweep backwards from there."""
    reference = (inputs.x, inputs.y)
    old = iterate.trajectory

    lanes = iterate.cost.shape[0]
    repeat = partial(jax.tree.map, lambda leaf: jnp.tile(leaf, len(_STEPS)))
    tried = jnp.repeat(jnp.asarray(_STEPS, iterate.cost.dtype), lanes)
    moved, costs = forward_sweep(
        repeat(old), repeat(iterate.law), tried, repeat(reference), repeat(inputs.weights), grid, parameters
    )
    moved = Trajectory(*(leaf.reshape(leaf.shape[0], len(_STEPS), lanes) for leaf in moved))
    best, least, new = (
        jnp.full_like(iterate.cost, _STEPS[0]),
        costs[:lanes],
        Trajectory(*(leaf[:, 0] for leaf in moved)),
    )
    for k in range(1, len(_STEPS)):
        cost = costs[k * lanes : (k + 1) * lanes]
        better = ~(least <= cost)
        best, least = jnp.where(better, _STEPS[k], best), jnp.where(better, cost, least)
        new = Trajectory(*(jnp.where(better, leaf[:, k], kept) for leaf, kept in zip(moved, new)))
    # Near the optimum the change of the cost drowns in rounding; such steps still improve the plan.
    rounding = 4 * jnp.finfo(least.dtype).eps * iterate.cost
    accepted = active & (least <= iterate.cost + rounding)
    trajectory = Trajectory(*(jnp.where(accepted, a, b) for a, b in zip(new, old)))
    raised = jnp.where(iterate.damping < 1e-2, 1e-1, 8 * iterate.damping)
    lowered = jnp.where(iterate.damping < 5e-3, 0.0, 0.2 * iterate.damping)
    damping = jnp.where(accepted, jnp.where(best == 1.0, lowered, iterate.damping), raised)
    damping = jnp.where(active, damping, iterate.damping)
    law, inverse, promised = backward_sweep(
        trajectory, reference, inputs.weights, damping, _CURVATURE_FLOOR, grid, parameters, parameters.method == "ddp"
    )
    curvature, margin = jnp.min(inverse.curvature, axis=0), jnp.min(inverse.margin, axis=0)
    cost, iterations = jnp.where(accepted, least, iterate.cost), iterate.iterations + active
    return Iterate(trajectory, cost, law, _credible(promised, cost), curvature, margin, damping, iterations)


def _improve(
    first: Iterate,
    inputs: TrackingInputs,
    grid: TimeGrid,
    rivals: int,
    tolerance: float,
    limit: int,
    parameters: UnicycleParameters,
) -> Iterate:
    """Advance all lanes until none is unfinished; `rivals` starts of each problem compete and losers are given up.

    Rivals are only starts, so that the method's own model is good enough to tell how far they are.
    """

    def active(iterate: Iterate) -> Array:
        # Comparisons are arranged so that a lane whose model overflowed (NaN) counts as unfinished.
        leader = jnp.tile(jnp.min(iterate.cost.reshape(rivals, -1), axis=0), rivals)
        hopeless = iterate.cost - _OPTIMISM * iterate.promised > leader
        seen = iterate if rivals > 1 else second_order_view(iterate, inputs, grid, parameters)
        unfinished = ~(residual(seen, inputs, parameters) <= tolerance)
        return unfinished & ~hopeless & (iterate.iterations < limit)

    def body(carry: tuple[Iterate, Array]) -> tuple[Iterate, Array]:
        iterate, mask = carry
        iterate = advance(iterate, inputs, grid, mask, parameters)
        return iterate, active(iterate)

    return lax.while_loop(lambda carry: jnp.any(carry[1]), body, (first, active(first)))[0]


@usual_promotion
def solve_lanes(
    inputs: TrackingInputs, parameters: UnicycleParameters
) -> tuple[Iterate, Float[Array, "n lanes"], Float[Array, "n lanes"]]:
    """Solve on the coarse grid from several starts, then on the given one from the best.

    Args:
        inputs: the problems, lanes last: (N, lanes), (lanes,), (3, lanes).
        parameters: bounds, dt and solver settings.

    Returns:
        The last iterate, and the speeds and headings that the given grid was started from.
    """
    coarse = coarse_grid(inputs.x.shape[0])
    dtype = inputs.x.dtype
    steps, mass = (jnp.asarray(column, dtype)[:, None] for column in (coarse.steps, coarse.mass))
    averaging, interpolation = jnp.asarray(coarse.averaging, dtype), jnp.asarray(coarse.interpolation, dtype)
    stiffness = parameters.acceleration_weight / (parameters.position_weight * parameters.dt**4)
    speed, theta = starting_motions(inputs.x, inputs.y, inputs.speed, inputs.theta, stiffness, parameters.dt)
    few = inputs._replace(x=averaging @ inputs.x, y=averaging @ inputs.y)
    rivals = jax.tree.map(lambda leaf: jnp.tile(leaf, STARTS), few)
    flat, grid = (mass.shape[0], -1), TimeGrid(parameters.dt * steps, mass, steps)
    first = begin(rivals, speed.reshape(flat), theta.reshape(flat), grid, parameters)
    found = _improve(
        first, rivals, grid, STARTS, _COARSE_TOLERANCE, min(_COARSE_ITERATIONS, parameters.max_iterations), parameters
    )

    grouped = (-1, STARTS, inputs.speed.shape[0])
    cost = found.cost.reshape(grouped[1:])
    speed, theta = (leaf.reshape(grouped) for leaf in (found.trajectory.speed, found.trajectory.theta))
    best_cost, best_speed, best_theta = cost[0], speed[:, 0], theta[:, 0]
    for k in range(1, STARTS):
        better = cost[k] < best_cost
        best_cost = jnp.where(better, cost[k], best_cost)
        best_speed, best_theta = (jnp.where(better, a[:, k], b) for a, b in ((speed, best_speed), (theta, best_theta)))
    speed, theta = interpolation @ best_speed, interpolation @ best_theta
    grid = uniform_grid(inputs.x[:, :1], parameters.dt)
    first = begin(inputs, speed, theta, grid, parameters)
    solved = _improve(first, inputs, grid, 1, parameters.tolerance, parameters.max_iterations, parameters)
    spent = jnp.max(found.iterations.reshape(grouped[1:]), axis=0)
    solved = second_order_view(solved, inputs, grid, parameters)
    return solved._replace(iterations=solved.iterations + spent), speed, theta

"""Unicycle model-predictive control: the best motion a unicycle can make along a reference path."""

from typing import NamedTuple, get_args

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from iwalker_jax.errors import InputError
from iwalker_jax.optimization.solution import GradientMode, Solution, Status
from iwalker_jax.optimization.unicycle import UnicycleParameters, UnicyclePlan, rollout, tracking_cost
from iwalker_jax.optimization.unicycle_ddp import (
    Policy,
    Trajectory,
    backward_sweep,
    forward_sweep,
)
from iwalker_jax.optimization.unicycle_gradients import MINIMUM_CURVATURE, TrackingInputs, attach_derivatives
from iwalker_jax.optimization.unicycle_starts import starting_controls

# Step lengths tried side by side.
_STEPS = (1.0, 0.5, 0.2, 0.05)
# Larger coordinates lose their squares in single precision.
_LARGEST = 1e6
# Less convex stages (relative to the control weights) make the quadratic model explode on its way back.
_CURVATURE_FLOOR = 0.1
# A start is given up when even this many times the promised decrease would leave it behind the best one.
_OPTIMISM = 3.0


class _Iterate(NamedTuple):
    """One start's progress: the motion, its cost, the policy around it and the decrease that it promises."""

    trajectory: Trajectory
    cost: Array
    policy: Policy
    promised: Array
    curvature: Array
    damping: Array


def solve_unicycle(
    reference: Float[Array, "n 2"],
    initial_state: Float[Array, "4"],
    parameters: UnicycleParameters = UnicycleParameters(),
    gradient: GradientMode = "implicit",
    weights: Float[Array, "3"] | None = None,
) -> Solution:
    """Track a reference path with a unicycle (iWalker, eqs. 5-7) by differential dynamic programming.

    Args:
        reference: (N, 2) positions [m], N >= 3, in any frame.
        initial_state: (4,) [x, y, v, theta] in that frame.
        parameters: weights, bounds and solver settings (static under jit).
        gradient: `implicit` differentiates the optimum, `unrolled` the iterations, `stopped` nothing.
        weights: (3,) position, turn and acceleration weight, to replace and differentiate those of `parameters`.

    Returns:
        Solution of a `UnicyclePlan`. The residual is sqrt(2 d / (J + w_pos N f^2)): d the decrease of the cost J that
        the second-order model still promises, f the position floor; that is the length of the next Newton step
        relative to the plan, both measured by the cost. INFEASIBLE: the initial speed cannot be brought under the
        speed bound in one step; the plan returns to it as fast as the bounds allow.

    Raises:
        InputError: for arrays of a wrong shape or an unknown gradient mode.
    """
    _check(reference, initial_state, gradient, weights)
    live_weights = parameters.weights().astype(reference.dtype) if weights is None else weights
    if gradient == "stopped":
        reference, initial_state, live_weights = lax.stop_gradient((reference, initial_state, live_weights))

    usable_reference = jnp.abs(reference) <= _LARGEST
    usable_state = jnp.abs(initial_state) <= _LARGEST
    usable_weights = jnp.isfinite(live_weights) & (live_weights > 0)
    usable = jnp.all(usable_reference) & jnp.all(usable_state) & jnp.all(usable_weights)
    state = jnp.where(usable_state, initial_state, 0.0)
    relative = jnp.where(usable_reference, reference, state[:2]) - state[:2]
    live_weights = jnp.where(usable_weights, live_weights, 1.0)
    inputs = TrackingInputs(relative[:, 0], relative[:, 1], state[2], state[3], live_weights)

    constants = lax.stop_gradient(inputs)
    starts = starting_controls(jnp.stack([constants.x, constants.y], -1), constants.speed, constants.theta, parameters)
    best, iterations, winner = _solve(constants, starts, parameters)
    residual = _residual(best, constants, parameters)
    if gradient == "unrolled":
        trajectory = _unroll(inputs, starts[winner], parameters)
    else:
        trajectory = attach_derivatives(inputs, best.trajectory, parameters)

    states = jnp.stack(trajectory[:4], axis=-1)
    controls = jnp.stack(trajectory[4:], axis=-1)
    cost = tracking_cost(states, controls, relative, live_weights)
    states = states + jnp.concatenate([state[:2], jnp.zeros_like(state[:2])])
    finite = usable & jnp.isfinite(residual) & jnp.isfinite(cost)
    solved = residual <= parameters.tolerance
    status = jnp.where(solved, Status.CONVERGED, Status.MAX_ITERATIONS)
    if parameters.speed_bound is not None:
        overspeed = jnp.abs(states[1, 2]) > parameters.speed_bound * (1 + 1e-5)
        status = jnp.where(overspeed, Status.INFEASIBLE, status)
    status = jnp.where(finite, status, Status.NON_FINITE).astype(jnp.int32)
    trusted = finite & solved & (best.curvature > MINIMUM_CURVATURE)
    plan = UnicyclePlan(states[:, :2], states, controls, cost)
    return Solution(plan, status, residual, iterations, trusted)


def _check(reference, initial_state, gradient, weights) -> None:
    if reference.ndim != 2 or reference.shape[1] != 2 or reference.shape[0] < 3:
        raise InputError(f"The reference must be (N, 2) with N >= 3, got {reference.shape}; use jax.vmap for a batch.")
    if initial_state.shape != (4,):
        raise InputError(f"The initial state must be (4,) = [x, y, v, theta], got {initial_state.shape}.")
    if weights is not None and weights.shape != (3,):
        raise InputError(f"The weights must be (3,) = [position, turn, acceleration], got {weights.shape}.")
    if gradient not in get_args(GradientMode):
        raise InputError(f"The gradient mode must be one of {get_args(GradientMode)}, got {gradient!r}.")


def _residual(iterate: _Iterate, inputs: TrackingInputs, parameters: UnicycleParameters) -> Array:
    floor = inputs.weights[0] * inputs.x.shape[0] * parameters.position_floor**2
    # A damped step promises less than a full one.
    promised = jnp.maximum(iterate.promised, 0.0) * (1 + iterate.damping)
    return jnp.sqrt(2 * promised / (iterate.cost + floor))


def _begin(inputs: TrackingInputs, controls: Float[Array, "m 2"], parameters: UnicycleParameters) -> _Iterate:
    zero = jnp.zeros_like(inputs.speed)
    origin = jnp.stack([zero, zero, inputs.speed, inputs.theta])
    states = rollout(origin, controls, parameters.dt)
    trajectory = Trajectory(*states.T, *controls.T)
    reference = (inputs.x, inputs.y)
    if parameters.bounded:
        still = Policy(*(jnp.zeros_like(controls[:, 0]) for _ in Policy._fields))
        trajectory, cost = forward_sweep(trajectory, still, zero, reference, inputs.weights, parameters)
    else:
        cost = tracking_cost(states, controls, jnp.stack(reference, axis=-1), inputs.weights)
    policy, inverse, promised = backward_sweep(
        trajectory, reference, inputs.weights, zero, _CURVATURE_FLOOR, parameters
    )
    return _Iterate(trajectory, cost, policy, promised, jnp.min(inverse.curvature), zero)


def _advance(iterate: _Iterate, inputs: TrackingInputs, parameters: UnicycleParameters) -> _Iterate:
    """Try several step lengths, keep the best if it is an improvement, and sweep backwards from there."""
    reference = (inputs.x, inputs.y)
    old = iterate.trajectory

    def attempt(step):
        return forward_sweep(old, iterate.policy, step, reference, inputs.weights, parameters)

    steps = jnp.asarray(_STEPS, inputs.x.dtype)
    _, costs = jax.vmap(attempt)(steps)
    costs = lax.stop_gradient(jnp.where(jnp.isfinite(costs), costs, jnp.inf))
    best = jnp.argmin(costs)
    # Near the optimum the change of the cost drowns in rounding; such steps still improve the plan.
    rounding = 4 * jnp.finfo(costs.dtype).eps * iterate.cost
    accepted = costs[best] <= iterate.cost + rounding
    new, cost = attempt(steps[best])
    trajectory = Trajectory(*(jnp.where(accepted, a, b) for a, b in zip(new, old)))
    cost = jnp.where(accepted, cost, iterate.cost)
    raised = jnp.where(iterate.damping < 1e-2, 1e-1, 8 * iterate.damping)
    lowered = jnp.where(iterate.damping < 5e-3, 0.0, 0.2 * iterate.damping)
    damping = jnp.where(accepted, jnp.where(best == 0, lowered, iterate.damping), raised)
    policy, inverse, promised = backward_sweep(
        trajectory, reference, inputs.weights, damping, _CURVATURE_FLOOR, parameters
    )
    return _Iterate(trajectory, cost, policy, promised, jnp.min(inverse.curvature), damping)


def _solve(inputs: TrackingInputs, starts: Float[Array, "s m 2"], parameters: UnicycleParameters):
    """Improve all starts together until none that can still win is unfinished; return the best one."""

    def pending(iterates: _Iterate) -> Array:
        residuals = jax.vmap(_residual, (0, None, None))(iterates, inputs, parameters)
        # Comparisons are arranged so that a start whose model overflowed (NaN) counts as unfinished.
        hopeless = iterates.cost - _OPTIMISM * iterates.promised > jnp.min(iterates.cost)
        return jnp.any(~hopeless & ~(residuals <= parameters.tolerance))

    def proceed(carry):
        iterates, count = carry
        return (count < parameters.max_iterations) & pending(iterates)

    def body(carry):
        iterates, count = carry
        return jax.vmap(_advance, (0, None, None))(iterates, inputs, parameters), count + 1

    begun = jax.vmap(_begin, (None, 0, None))(inputs, starts, parameters)
    iterates, count = lax.while_loop(proceed, body, (begun, jnp.int32(0)))
    winner = jnp.argmin(jnp.where(jnp.isfinite(iterates.cost), iterates.cost, jnp.inf))
    return jax.tree.map(lambda leaf: leaf[winner], iterates), count, winner


def _unroll(inputs: TrackingInputs, controls: Float[Array, "m 2"], parameters: UnicycleParameters) -> Trajectory:
    """Repeat the winning start's iterations, a fixed number of them, so that they can be differentiated."""

    def body(iterate, _):
        return _advance(iterate, inputs, parameters), None

    first = _begin(inputs, controls, parameters)
    return lax.scan(body, first, None, length=parameters.max_iterations)[0].trajectory

"""Unicycle model-predictive control: the best motion a unicycle can make along a reference path."""

from typing import Any, NamedTuple, get_args

import jax
import jax.numpy as jnp
from jax import lax
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from iwalker_jax.arrays import as_floats
from iwalker_jax.errors import InputError
from iwalker_jax.optimization.solution import GradientMode, Solution, Status
from iwalker_jax.optimization.unicycle.ddp import Trajectory, uniform_grid
from iwalker_jax.optimization.unicycle.gradients import MINIMUM_CURVATURE, TrackingInputs, attach_derivatives
from iwalker_jax.optimization.unicycle.model import UnicycleParameters, UnicyclePlan, tracking_cost
from iwalker_jax.optimization.unicycle.solver import Iterate, advance, begin, residual, second_order_view, solve_lanes
from iwalker_jax.promotion import usual_promotion

# Larger coordinates lose their squares in single precision.
_LARGEST = 1e6
# Controls nearer to a change of their active bounds than this part of the bounds have derivatives of one side only.
_LEAST_MARGIN = 1e-4


@usual_promotion
def solve_unicycle(
    reference: Float[ArrayLike, "n 2"],
    initial_state: Float[ArrayLike, "4"],
    parameters: UnicycleParameters = UnicycleParameters(),
    gradient: GradientMode = "implicit",
    weights: Float[ArrayLike, "3"] | None = None,
) -> Solution:
    """Track a reference path with a unicycle (iWalker, eqs. 5-7) by differential dynamic programming or iLQR.

    Args:
        reference: (N, 2) positions [m], N >= 3, in any frame.
        initial_state: (4,) [x, y, v, theta] in that frame.
        parameters: weights, bounds and solver settings (static under jit).
        gradient: `implicit` differentiates the optimum, `unrolled` the iterations, `stopped` nothing.
        weights: (3,) position, turn and acceleration weight, to replace and differentiate those of `parameters`.

    Returns:
        Solution of a `UnicyclePlan`. The residual is sqrt(2 d / (J + w_pos N f^2)): d the decrease of the cost J that
        the second-order model still promises (whatever the method), f the position floor; that is the length of the
        next Newton step relative to the plan, both measured by the cost. INFEASIBLE: the initial speed cannot be
        brought under the speed bound in one step; the plan returns to it as fast as the bounds allow. CONVERGED: an
        optimum among its neighbours, the best of those that the starts led to; a wild reference may have a better one.
        The margin is the least of the plan's curvature over the control weights and of any control's distance from
        meeting or leaving a bound.

    Raises:
        InputError: for arrays of a wrong shape, what are no real numbers, or an unknown gradient mode.
    """
    reference, initial_state = as_floats(reference, "The reference"), as_floats(initial_state, "The initial state")
    own_weights = parameters.weights().astype(reference.dtype)
    live_weights = own_weights if weights is None else as_floats(weights, "weights")
    _check_inputs(reference, initial_state, gradient, live_weights)
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

    best, error, flattest, margin, iterations, speed, theta = _solve(lax.stop_gradient(inputs), parameters)
    if gradient == "unrolled":
        best, error, flattest, margin = _unroll(inputs, speed, theta, parameters)
        trajectory = best
    else:
        trajectory = attach_derivatives(inputs, best, parameters)

    states = jnp.stack(trajectory[:4], axis=-1)
    controls = jnp.stack(trajectory[4:], axis=-1)
    cost = tracking_cost(states, controls, relative, live_weights)
    states = states + jnp.concatenate([state[:2], jnp.zeros_like(state[:2])])
    finite = usable & jnp.isfinite(error) & jnp.isfinite(cost)
    solved = error <= parameters.tolerance
    status = jnp.where(solved, Status.CONVERGED, Status.MAX_ITERATIONS)
    if parameters.speed_bound is not None:
        overspeed = jnp.abs(states[1, 2]) > parameters.speed_bound * (1 + 1e-5)
        status = jnp.where(overspeed, Status.INFEASIBLE, status)
    status = jnp.where(finite, status, Status.NON_FINITE).astype(jnp.int32)
    trusted = finite & solved & (flattest > MINIMUM_CURVATURE) & (margin > jnp.maximum(4 * error, _LEAST_MARGIN))
    margin = jnp.where(finite & solved, jnp.minimum(flattest, margin), 0)
    plan = UnicyclePlan(states[:, :2], states, controls, cost)
    return Solution(plan, status, error, iterations, trusted, lax.stop_gradient(margin))


def _check_inputs(reference: Array, initial_state: Array, gradient: str, weights: Array) -> None:
    """Refuse shapes that do not fit and unknown gradient modes; works on tracers."""
    if reference.ndim != 2 or reference.shape[1] != 2 or reference.shape[0] < 3:
        raise InputError(f"The reference must be (N, 2) with N >= 3, got {reference.shape}; use jax.vmap for a batch.")
    if initial_state.shape != (4,):
        raise InputError(f"The initial state must be (4,) = [x, y, v, theta], got {initial_state.shape}.")
    if weights.shape != (3,):
        raise InputError(f"The weights must be (3,) = [position, turn, acceleration], got {weights.shape}.")
    if gradient not in get_args(GradientMode):
        raise InputError(f"The gradient mode must be one of {get_args(GradientMode)}, got {gradient!r}.")


class _Solved(NamedTuple):
    """Of each problem the optimum, its residual, curvature and margin, and where the search started."""

    trajectory: Trajectory
    residual: Array
    curvature: Array
    margin: Array
    iterations: Array
    speed: Array
    theta: Array


def _solve(inputs: TrackingInputs, parameters: UnicycleParameters) -> _Solved:
    """Solve one problem, with a rule that turns `jax.vmap`, however nested, into lanes of one batched solve.

    Left to itself vmap would put the batch in front of the time axis of every array the recursions touch.
    """

    @jax.custom_batching.custom_vmap
    def lanes(*leaves: Array) -> _Solved:
        inputs = TrackingInputs(*leaves)
        solved, speed, theta = solve_lanes(inputs, parameters)
        error = residual(solved, inputs, parameters)
        return _Solved(solved.trajectory, error, solved.curvature, solved.margin, solved.iterations, speed, theta)

    @lanes.def_vmap
    def _merge(size: int, batched: list[bool], *leaves: Array) -> tuple[_Solved, Any]:
        def widen(leaf: Array, is_batched: bool) -> Array:
            leaf = jnp.moveaxis(leaf, 0, -1) if is_batched else jnp.repeat(leaf[..., None], size, axis=-1)
            return leaf.reshape(*leaf.shape[:-2], -1)

        def split(leaf: Array) -> Array:
            return jnp.moveaxis(leaf.reshape(*leaf.shape[:-1], -1, size), -1, 0)

        outputs = jax.tree.map(split, lanes(*map(widen, leaves, batched)))
        return outputs, jax.tree.map(lambda _: True, outputs)

    outputs = lanes(*(leaf[..., None] for leaf in inputs))
    return jax.tree.map(lambda leaf: leaf[..., 0], outputs)


def _unroll(
    inputs: TrackingInputs, speed: Float[Array, " n"], theta: Float[Array, " n"], parameters: UnicycleParameters
) -> tuple[Trajectory, Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """Repeat the iterations on the full grid, a fixed number of them, so that they can be differentiated."""
    inputs, speed, theta = jax.tree.map(lambda leaf: leaf[..., None], (inputs, speed, theta))

    grid = uniform_grid(inputs.x, parameters.dt)

    def body(iterate: Iterate, _: None) -> tuple[Iterate, None]:
        return advance(iterate, inputs, grid, jnp.ones_like(inputs.speed, bool), parameters), None

    first = begin(inputs, speed, theta, grid, parameters)
    last, _ = lax.scan(body, first, None, length=parameters.unrolled_iterations)
    last = second_order_view(last, inputs, grid, parameters)
    error = lax.stop_gradient(residual(last, inputs, parameters))
    outputs = (last.trajectory, error, last.curvature, last.margin)
    return jax.tree.map(lambda leaf: leaf[..., 0], outputs)

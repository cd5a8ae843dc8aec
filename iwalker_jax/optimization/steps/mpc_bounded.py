"""H-LIP step MPC with reachability: every step within the swing leg's reach and on its own side."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from iwalker_jax.arrays import as_numbers
from iwalker_jax.errors import InputError
from iwalker_jax.optimization.solution import GradientMode, Solution, Status
from iwalker_jax.optimization.steps.box_qp import (
    PENALTIES,
    ActiveBounds,
    bound_solver,
    distance_to_change,
    find_active_bounds,
)
from iwalker_jax.optimization.steps.hlip import HlipParameters, Modes, divergent_component, modes
from iwalker_jax.optimization.steps.mpc import kkt_solver
from iwalker_jax.optimization.steps.problem import (
    StepMpcWeights,
    as_plan,
    check_step_inputs,
    conclude,
    kkt_residual,
    modal_cost,
    sanitise,
    tracking_problem,
)
from iwalker_jax.optimization.steps.reach import (
    StepReach,
    capture_margin,
    heading_axes,
    sanitise_reach,
    step_bounds,
)
from iwalker_jax.optimization.steps.riccati import Kkt, StepCost
from iwalker_jax.promotion import usual_promotion

_PENALTY = 50.0  # ADMM's base penalty over the mean curvature of the cost, by measurement
_REFINEMENTS = 3
_INSIDE = 0.98  # a state beyond reach is pulled to this fraction of the catchable set


@usual_promotion
def solve_bounded_step_mpc(
    footsteps: Float[ArrayLike, "n 2"],
    initial_state: Float[ArrayLike, "2 3"],
    stance: Float[ArrayLike, ""],
    headings: Float[ArrayLike, " n"] | None = None,
    reach: StepReach | None = None,
    parameters: HlipParameters | None = None,
    weights: StepMpcWeights | None = None,
    gradient: GradientMode = "implicit",
) -> Solution:
    """Plan the steps nearest to wanted ones among those within reach: the QP of `solve_step_mpc` with bounds.

    Args:
        footsteps: (N, 2) wanted footsteps s_1..s_N [m]; row 0 is the next footstep.
        initial_state: (2, 3) pre-impact state [c, p, v] of the x and y plane on the current stance foot, same frame.
        stance: +1 if the current stance foot is the left one (the next footstep is then a right one, to the right
            of it), -1 if it is the right one.
        headings: (N,) heading of each footstep [rad] in the frame of the footsteps; bounds hold in it. Zero if None.
        reach: bounds on a step, possibly traced.
        parameters, weights, gradient: as in `solve_step_mpc`; derivatives are those of the optimum with its active
            bounds held.

    Returns:
        Solution whose value is a `StepPlan` within reach, whatever the status. INFEASIBLE: the bounds contradict
        each other, or no steps within reach keep the COM bounded; the plan then catches the state where the true
        one, moved towards the middle of the catchable set, enters it, and the residual tells how far beyond the
        true one lies (0.1 is 10 %). MAX_ITERATIONS: the active bounds were not found; the steps are approximate
        and the plan's initial xi is not the robot's. The margin is how far any step is from meeting or leaving one
        of its bounds, over the sagittal reach.

    Raises:
        InputError: on wrong shapes, what are no real numbers, an unknown gradient mode, or constants under which the
            pendulum runs away faster than the precision can follow (traced ones give NON_FINITE).
    """
    parameters, weights, reach = parameters or HlipParameters(), weights or StepMpcWeights(), reach or StepReach()
    footsteps, initial_state = check_step_inputs(footsteps, initial_state, gradient, parameters)
    horizon, dtype = footsteps.shape[0], footsteps.dtype
    headings = jnp.zeros(horizon, dtype) if headings is None else as_numbers(headings, "headings").astype(dtype)
    if headings.shape != (horizon,):
        raise InputError(f"headings have shape {headings.shape}; give ({horizon},), one for each footstep.")
    stance = as_numbers(stance, "stance").astype(dtype)
    if stance.shape:
        raise InputError(f"stance has shape {stance.shape}; give one number, +1 for the left foot or -1 for the right.")
    if gradient == "stopped":
        footsteps, initial_state, headings, reach, parameters, weights = jax.lax.stop_gradient(
            (footsteps, initial_state, headings, reach, parameters, weights)
        )
    footsteps, initial_state, parameters, weights, usable = sanitise(footsteps, initial_state, parameters, weights)
    reach, known, empty = sanitise_reach(reach, dtype)
    usable &= known & jnp.all(jnp.isfinite(headings)) & (jnp.abs(stance) == 1)
    headings = jnp.where(jnp.isfinite(headings), headings, 0)
    low, high = step_bounds(reach, jnp.where(stance < 0, -1, 1), horizon)
    axes = heading_axes(headings)
    form = modes(parameters)
    cost = modal_cost(form, weights)
    excess, state = catchable_state(parameters, form.pole, axes, low, high, initial_state)
    steps, gait, rows = tracking_problem(form, cost, footsteps, state)
    problem = _Problem(form, cost, steps, rows, axes, low.ravel(), high.ravel())

    answer, found, error, margin = _optimum(problem, gradient)
    residual = jnp.maximum(kkt_residual(cost, form.pole, answer.point, answer.rows), error / reach.sagittal)
    converged = residual <= jnp.sqrt(jnp.finfo(dtype).eps)
    status = jnp.where(converged, Status.CONVERGED, Status.MAX_ITERATIONS)
    status = jnp.where((excess > 0) | empty, Status.INFEASIBLE, status).astype(jnp.int32)
    residual = jax.lax.stop_gradient(jnp.maximum(residual, excess))
    within = jnp.einsum("kij,ki->kj", axes, found.within.reshape(horizon, 2))
    safe = hold_steps(form, within, steps, gait, state)
    point = jax.tree.map(lambda a, b: jnp.where(converged, a, b), answer.point[:2], safe)
    plan = as_plan(form, cost, footsteps, steps, gait, *point)
    return conclude(plan, residual, usable, status, found.rounds, margin / jax.lax.stop_gradient(reach.sagittal))


class _Problem(NamedTuple):
    """The tracking problem in modal coordinates with bounds on its steps in their heading frames."""

    form: Modes
    cost: StepCost
    steps: Float[Array, "n 2"]
    rows: Kkt
    axes: Float[Array, "n 2 2"]
    low: Float[Array, " m"]
    high: Float[Array, " m"]


class _Answer(NamedTuple):
    """The KKT system's right-hand side with the bounds' forces, its solution and the steps in heading frames."""

    rows: Kkt
    point: Kkt
    landing: Float[Array, " m"]


def _under_forces(problem: _Problem, solve_kkt: Callable[[Kkt], Kkt], forces: Float[Array, "n 2"]) -> _Answer:
    """Solve the KKT system with forces (in heading frames) on the steps."""
    axes, rows = problem.axes, problem.rows
    pushed = (rows[0], rows[1] - jnp.einsum("kij,ki->kj", axes, forces), rows[2])
    point = solve_kkt(pushed)
    return _Answer(pushed, point, jnp.einsum("kij,kj->ki", axes, problem.steps + point[1]).ravel())


def _optimum(
    problem: _Problem, gradient: GradientMode
) -> tuple[_Answer, ActiveBounds, Float[Array, ""], Float[Array, ""]]:
    """The bounded optimum, how its active bounds were found, the error of bounds and multipliers [m], and how far any
    step is from meeting or leaving a bound [m].
    """
    form, cost, axes, horizon = problem.form, problem.cost, problem.axes, problem.steps.shape[0]
    dtype = problem.steps.dtype
    none = jnp.zeros((horizon, 3, horizon), dtype)
    solve_kkt = kkt_solver(cost, form.pole, horizon, gradient)
    probe = (none, jnp.eye(horizon, dtype=dtype), none)

    def damped(penalty: Float[Array, ""]) -> Float[Array, "n n"]:
        heavier = cost._replace(effort=cost.effort + penalty)
        return penalty * kkt_solver(heavier, form.pole, horizon, "unrolled")(probe)[1]

    compliance = solve_kkt(probe)[1]
    inverse, scale = turn_blocks(axes, compliance), jnp.mean(jnp.diagonal(compliance))
    operators = jax.vmap(damped)(_PENALTY * jnp.asarray(PENALTIES, dtype) / scale)
    start = _under_forces(problem, solve_kkt, jnp.zeros_like(problem.steps))
    frozen = jax.lax.stop_gradient((axes, operators, inverse, start.landing, problem.low, problem.high))
    found = find_active_bounds(lambda i: turn_blocks(frozen[0], frozen[1][i]), *frozen[2:])
    respond = bound_solver(inverse, found.sides)
    bound = jnp.where(found.sides > 0, problem.high, problem.low)

    def refine(carry: tuple[Array, _Answer], _: None) -> tuple[tuple[Array, _Answer], None]:
        forces, answer = carry
        forces += respond(answer.landing - bound).reshape(horizon, 2)
        return (forces, _under_forces(problem, solve_kkt, forces)), None

    # Repeating the solve with what is left of the violation takes out the rounding of the inverse.
    begin = (jnp.zeros_like(problem.steps), start)
    (forces, answer), _ = jax.lax.scan(refine, begin, None, length=_REFINEMENTS)
    violation = jnp.max(jnp.maximum(answer.landing - problem.high, problem.low - answer.landing))
    sign_error = jnp.max(-forces.ravel() * found.sides) * scale
    pushed, landing = jax.lax.stop_gradient((forces.ravel(), answer.landing))
    margin = distance_to_change(frozen[2], found.sides, pushed, landing, *frozen[4:])
    return answer, found, jnp.maximum(jnp.maximum(violation, sign_error), 0), margin


def turn_blocks(axes: Float[Array, "n 2 2"], matrix: Float[Array, "n n"]) -> Float[Array, "m m"]:
    """A matrix that acts on both planes alike, in heading frames."""
    blocks = jnp.einsum("kij,lmj,kl->kilm", axes, axes, matrix)
    return blocks.reshape(2 * matrix.shape[0], 2 * matrix.shape[0])


def hold_steps(
    form: Modes,
    taken: Float[Array, "n 2"],
    steps: Float[Array, "n 2"],
    gait: Float[Array, "n 2 2"],
    initial_state: Float[Array, "2 3"],
) -> tuple[Float[Array, "n 3 2"], Float[Array, "n 2"]]:
    """Deviations from the reference under fixed steps: zeta runs forward, xi backward from the gait, so both stay
    bounded; only the initial xi is then not the robot's own.
    """

    def forward(zeta: Float[Array, "2"], step: Float[Array, "2"]) -> tuple[Array, Array]:
        zeta = (zeta - step) / form.pole
        return zeta, zeta

    def backward(xi: Float[Array, "2"], step: Float[Array, "2"]) -> tuple[Array, Array]:
        return step + xi / form.pole, xi

    start = initial_state[:, 1] + form.convergent_lead * initial_state[:, 2]
    _, convergent = jax.lax.scan(forward, start, taken)
    _, divergent = jax.lax.scan(backward, gait[-1, 0], taken, reverse=True)
    offset = jnp.cumsum(taken - steps, axis=0)
    return jnp.stack([offset, divergent - gait[:, 0], convergent - gait[:, 1]], axis=1), taken - steps


def catchable_state(
    parameters: HlipParameters,
    pole: Float[Array, ""],
    axes: Float[Array, "n 2 2"],
    low: Float[Array, "n 2"],
    high: Float[Array, "n 2"],
    initial_state: Float[Array, "2 3"],
) -> tuple[Float[Array, ""], Float[Array, "2 3"]]:
    """Relative distance beyond the catchable set, and the state with its velocity changed so as to lie inside."""
    divergent = divergent_component(parameters, initial_state[:, 1], initial_state[:, 2])
    ratio, centre = capture_margin(pole, axes, low, high, divergent)
    pull = jnp.where(ratio > 1, 1 - _INSIDE / jnp.maximum(ratio, 1), 0) * (centre - divergent)
    change = jax.lax.stop_gradient(pull / modes(parameters).divergent_lead)
    return jnp.maximum(ratio - 1, 0), initial_state.at[:, 2].add(change)

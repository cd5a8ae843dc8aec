"""H-LIP step MPC in closed form: the steps nearest to wanted ones that keep the pendulum walking (iWalker, eq. 9)."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from iwalker_jax.optimization.solution import GradientMode, Solution, Status
from iwalker_jax.optimization.steps.hlip import HlipParameters, modes
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
from iwalker_jax.optimization.steps.riccati import (
    Kkt,
    StepCost,
    apply_kkt,
    factorise_kkt,
    pack,
    solve_factorised,
    unpack,
)
from iwalker_jax.promotion import usual_promotion


def kkt_solver(cost: StepCost, pole: Float[Array, ""], horizon: int, gradient: GradientMode) -> Callable[[Kkt], Kkt]:
    """Factorise once; the result solves for any right-hand side and is differentiated through the system
    (`implicit`) or through the recursions.
    """
    if gradient != "implicit":
        return partial(solve_factorised, factorise_kkt(cost, pole, horizon))
    factor = factorise_kkt(*jax.lax.stop_gradient((cost, pole)), horizon)

    def respond(rows: Kkt) -> Kkt:
        packed = jax.lax.custom_linear_solve(
            lambda x: pack(apply_kkt(cost, pole, unpack(x))),
            pack(rows),
            lambda _, b: pack(solve_factorised(factor, unpack(b))),
            symmetric=True,
        )
        return unpack(packed)

    return respond


@usual_promotion
def solve_step_mpc(
    footsteps: Float[ArrayLike, "n 2"],
    initial_state: Float[ArrayLike, "2 3"],
    parameters: HlipParameters | None = None,
    weights: StepMpcWeights | None = None,
    gradient: GradientMode = "implicit",
) -> Solution:
    """Plan the steps nearest to wanted ones (iWalker, eq. 9, with weights on the orbit: see `problem`).

    One linear KKT solve; the plan is linear in (footsteps, initial state).

    Args:
        footsteps: (N, 2) wanted footsteps s_1..s_N [m] in any fixed frame; row 0 is the next footstep.
        initial_state: (2, 3) pre-impact state [c, p, v] of the x and y plane on the current stance foot, same frame.
        parameters: pendulum constants, possibly traced; BRUCE's by default.
        weights: cost weights, possibly traced.
        gradient: `implicit` differentiates the KKT system, `unrolled` the recursions (the same derivative),
            `stopped` neither.

    Returns:
        Solution whose value is a `StepPlan`. The residual is that of the KKT system, each row relative to its
        largest term. Non-finite or unphysical input gives NON_FINITE and a finite value computed without it.

    Raises:
        InputError: on wrong shapes, what are no real numbers, an unknown gradient mode, or constants under which the
            pendulum runs away faster than the precision can follow (traced ones give NON_FINITE).
    """
    parameters, weights = parameters or HlipParameters(), weights or StepMpcWeights()
    footsteps, initial_state = check_step_inputs(footsteps, initial_state, gradient, parameters)
    if gradient == "stopped":
        footsteps, initial_state, parameters, weights = jax.lax.stop_gradient(
            (footsteps, initial_state, parameters, weights)
        )
    footsteps, initial_state, parameters, weights, usable = sanitise(footsteps, initial_state, parameters, weights)
    form = modes(parameters)
    cost = modal_cost(form, weights)
    steps, gait, rows = tracking_problem(form, cost, footsteps, initial_state)
    point = kkt_solver(cost, form.pole, footsteps.shape[0], gradient)(rows)
    residual = jax.lax.stop_gradient(kkt_residual(cost, form.pole, point, rows))
    plan = as_plan(form, cost, footsteps, steps, gait, *point[:2])
    converged = residual <= jnp.sqrt(jnp.finfo(residual.dtype).eps)
    status = jnp.where(converged, Status.CONVERGED, Status.MAX_ITERATIONS).astype(jnp.int32)
    unbounded = jnp.asarray(jnp.inf, residual.dtype)
    return conclude(plan, residual, usable, status, jnp.asarray(1, jnp.int32), unbounded)

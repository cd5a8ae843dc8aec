"""The step MPC's quadratic program (iWalker, eq. 9): weights, reference gait, modal form, plan of its solution.

Indices: the robot stands on s_0 = c_0 - p_0 in the pre-impact state x_0; footsteps[k] is the wanted s_{k+1}, so row 0
is the NEXT footstep, and row k of a plan's states is the pre-impact state on that footstep. With u_k = s_{k+1} - s_k
    J = sum_k w_s |s_k - s^_k|^2 + w_p |p_k - p^_k|^2 + w_v |v_k - v^_k|^2   (k = 1..N)
        + sum_k w_u |u_k|^2 (k = 0..N-1) + w_xi |xi_N - xi^_N|^2
for both planes alike. A cost of footsteps and inputs alone says nothing of the COM, which then runs away.
"""

from dataclasses import dataclass
from typing import NamedTuple, get_args

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.arrays import as_numbers
from iwalker_jax.checks import Scalar, field_values, require_range
from iwalker_jax.errors import InputError
from iwalker_jax.optimization.solution import GradientMode, Solution, Status
from iwalker_jax.optimization.steps.hlip import HlipParameters, Modes, modes
from iwalker_jax.optimization.steps.riccati import Kkt, StepCost, apply_kkt, weigh_states

# Residuals of plans over growth squared times eps: at most 2.8 of 32 random plans for each growth from 5 to 1400.
_LOSS = 3.0


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class StepMpcWeights:
    """Weights of the step MPC; a pytree, so that any of them may be traced and differentiated.

    Attributes:
        footstep: w_s [1/m^2].
        effort: w_u [1/m^2], on the step size itself; 0 by default, because it shortens and narrows every step.
        orbit_position: w_p [1/m^2].
        orbit_velocity: w_v [s^2/m^2].
        terminal: w_xi [1/m^2], on the divergent component after the last step; it bounds the COM.
    """

    footstep: Scalar = 100.0
    effort: Scalar = 0.0
    orbit_position: Scalar = 100.0
    orbit_velocity: Scalar = 4.0
    terminal: Scalar = 100.0

    def __post_init__(self) -> None:
        require_range(self, "footstep", 0.0, 1e6, "1/m^2")
        require_range(self, "effort", 0.0, 1e6, "1/m^2")
        require_range(self, "orbit_position", 0.0, 1e6, "1/m^2")
        require_range(self, "orbit_velocity", 0.0, 1e6, "s^2/m^2")
        require_range(self, "terminal", 0.0, 1e6, "1/m^2")
        plain = [x for x in (self.footstep, self.effort) if isinstance(x, (int, float))]
        if len(plain) == 2 and max(plain) <= 0:
            raise InputError("StepMpcWeights.footstep and effort are both 0; make one of them positive.")

    @classmethod
    def published(cls) -> "StepMpcWeights":
        """The paper's weights, which leave the COM free to run away; for comparison only."""
        return cls(footstep=100.0, effort=3.0, orbit_position=0.0, orbit_velocity=0.0, terminal=0.0)

    @property
    def hold_com(self) -> bool:
        """Whether any weight lies on the COM; traced ones count as present."""
        weights = (self.orbit_position, self.orbit_velocity, self.terminal)
        return not all(isinstance(weight, (int, float)) and weight == 0 for weight in weights)


class StepPlan(NamedTuple):
    """Outcome of the step MPC over N steps, in the frame of the wanted footsteps.

    Attributes:
        footsteps: (N, 2) planned footsteps s_1..s_N [m].
        states: (N, 2, 3) pre-impact state [c, p, v] of the x and y plane on each of them [m, m, m/s].
        inputs: (N, 2) step sizes u_0..u_{N-1} [m].
        cost: () J.
    """

    footsteps: Float[Array, "n 2"]
    states: Float[Array, "n 2 3"]
    inputs: Float[Array, "n 2"]
    cost: Float[Array, ""]


def gait_reference(pole: Float[Array, ""], steps: Float[Array, "n 2"]) -> Float[Array, "n 2 2"]:
    """Divergent and convergent component (axis 1) of the period-two orbit through each of N wanted steps.

    The reference is local on purpose. The exact bounded motion of the wanted steps would make any of them optimal
    up to one fixed correction of the initial xi; this one also pulls each step towards a regular gait, and costs
    about 0.1 mm of tracking on a path that turns 0.15 rad a step.

    Row k belongs to s_{k+1}, where the next two wanted steps are u_{k+1} and u_{k+2}; after the last one the
    gait repeats its last two steps. One wanted step tells no gait: the reference then stands still.
    """
    if steps.shape[0] == 1:
        following = jnp.zeros_like(jnp.concatenate([steps, steps]))
    else:
        following = jnp.concatenate([steps[1:], steps[-2:]])
    step, after = following[:-1], following[1:]
    scale = 1 / (1 - pole**-2)
    return jnp.stack([scale * (step + after / pole), -scale * (after + step / pole) / pole], axis=1)


def largest_growth(dtype: jnp.dtype) -> float:
    """Growth of the divergent component in a step up to which residuals are below the tolerance, sqrt(eps).

    The cost to go of a step carries the square of the pole beside one, so that residuals grow with its square.
    """
    return (_LOSS * float(jnp.finfo(dtype).eps) ** 0.5) ** -0.5


def check_growth(parameters: HlipParameters, dtype: jnp.dtype) -> None:
    """Refuse plain constants under which the pendulum runs away faster than a precision can follow.

    Raises:
        InputError: with the growth and the most that plans hold.
    """
    if not all(isinstance(value, (int, float)) for value in field_values(parameters)):
        return
    with jax.ensure_compile_time_eval():
        growth = float(modes(parameters).pole)
    most = largest_growth(dtype)
    wider = ", or compute in double precision" if dtype == jnp.float32 else ""
    if not growth <= most:
        raise InputError(
            f"With com_height {parameters.com_height:g} m and a step time of {parameters.step_time:g} s the divergent "
            f"component of the COM grows {growth:.3g} times in a step, and {dtype} holds {most:.3g} at most; step "
            f"faster or raise the COM{wider}."
        )


def check_step_inputs(
    footsteps: Float[ArrayLike, "n 2"],
    initial_state: Float[ArrayLike, "2 3"],
    gradient: str,
    parameters: HlipParameters,
) -> tuple[Float[Array, "n 2"], Float[Array, "2 3"]]:
    """Both arrays in the footsteps' float type, or InputError."""
    footsteps, initial_state = as_numbers(footsteps, "footsteps"), as_numbers(initial_state, "initial_state")
    if footsteps.ndim != 2 or footsteps.shape[1] != 2 or footsteps.shape[0] == 0:
        raise InputError(f"footsteps have shape {footsteps.shape}; give (N, 2) with N >= 1 and vmap over batches.")
    if initial_state.shape != (2, 3):
        raise InputError(
            f"initial_state has shape {initial_state.shape}; give (2, 3): [c, p, v] of the x and of the y plane."
        )
    if gradient not in get_args(GradientMode):
        raise InputError(f"gradient is {gradient!r}; choose one of {', '.join(get_args(GradientMode))}.")
    dtype = jnp.promote_types(footsteps.dtype, jnp.float32)
    check_growth(parameters, dtype)
    return footsteps.astype(dtype), initial_state.astype(dtype)


def sanitise(
    footsteps: Float[Array, "n 2"],
    initial_state: Float[Array, "2 3"],
    parameters: HlipParameters,
    weights: StepMpcWeights,
) -> tuple[Float[Array, "n 2"], Float[Array, "2 3"], HlipParameters, StepMpcWeights, Bool[Array, ""]]:
    """Replace unusable values by harmless ones, so that neither value nor gradient is NaN, and say if all were good.

    Non-finite coordinates become 0; unphysical constants (z0, T_SSP, g not positive, T_DSP or a weight negative, no
    weight on footsteps and effort, a growth beyond `largest_growth`) become the defaults.
    """
    dtype = footsteps.dtype
    constants = jnp.stack([jnp.asarray(x, dtype) for x in field_values(parameters)])
    factors = jnp.stack([jnp.asarray(x, dtype) for x in field_values(weights)])
    physical = jnp.all(jnp.isfinite(constants)) & jnp.all(constants.at[2].add(1) > 0) & (constants[2] >= 0)
    physical &= modes(HlipParameters(*constants)).pole <= largest_growth(dtype)
    convex = jnp.all(jnp.isfinite(factors)) & jnp.all(factors >= 0) & (factors[0] + factors[1] > 0)
    constants = jnp.where(physical, constants, jnp.asarray(field_values(HlipParameters()), dtype))
    factors = jnp.where(convex, factors, jnp.asarray(field_values(StepMpcWeights()), dtype))
    finite = jnp.all(jnp.isfinite(footsteps)) & jnp.all(jnp.isfinite(initial_state))
    return (
        jnp.where(jnp.isfinite(footsteps), footsteps, 0),
        jnp.where(jnp.isfinite(initial_state), initial_state, 0),
        HlipParameters(*constants),
        StepMpcWeights(*factors),
        physical & convex & finite,
    )


def modal_cost(form: Modes, weights: StepMpcWeights) -> StepCost:
    """Stage cost in (s, xi, zeta): v = (xi - zeta) / d and p = (e zeta - f xi) / d, with leads e, f and d = e - f."""
    e, f = form.divergent_lead, form.convergent_lead
    scale = (e - f) ** -2
    position, velocity = weights.orbit_position, weights.orbit_velocity
    return StepCost(
        footstep=weights.footstep,
        divergent=scale * (position * f**2 + velocity),
        convergent=scale * (position * e**2 + velocity),
        cross=-scale * (position * e * f + velocity),
        terminal=weights.terminal,
        effort=weights.effort,
    )


def tracking_problem(
    form: Modes, cost: StepCost, footsteps: Float[Array, "n 2"], initial_state: Float[Array, "2 3"]
) -> tuple[Float[Array, "n 2"], Float[Array, "n 2 2"], Kkt]:
    """Wanted steps, reference (xi, zeta), and the KKT system's right-hand side for the deviation from them.

    Deviations are small where footsteps are metres away, which is what float32 needs; the reference's own defects of
    the step map appear as drift.
    """
    com, position, velocity = initial_state[:, 0], initial_state[:, 1], initial_state[:, 2]
    steps = jnp.diff(footsteps, axis=0, prepend=(com - position)[None])
    gait = gait_reference(form.pole, steps)
    lead = jnp.stack([form.divergent_lead, form.convergent_lead])[:, None]
    path = jnp.concatenate([(position + lead * velocity)[None], gait])
    growth = jnp.stack([form.pole, 1 / form.pole])[:, None]
    defect = path[1:] - growth * (path[:-1] - steps[:, None])
    drift = jnp.concatenate([jnp.zeros_like(steps)[:, None], defect], axis=1)
    return steps, gait, (jnp.zeros_like(drift), -cost.effort * steps, drift)


def kkt_residual(cost: StepCost, pole: Float[Array, ""], point: Kkt, rows: Kkt) -> Float[Array, ""]:
    """Largest error of the three blocks of the KKT system, each relative to the block's largest term."""
    left = apply_kkt(cost, pole, point)
    states, inputs, costates = (jnp.max(jnp.abs(x)) for x in point)
    sizes = (jnp.max(jnp.abs(rows[0])) + costates, cost.effort * inputs + costates, states + inputs)
    errors = [jnp.max(jnp.abs(a - b)) for a, b in zip(left, rows, strict=True)]
    tiny = jnp.finfo(pole.dtype).tiny
    return jnp.max(jnp.stack([error / (size + tiny) for error, size in zip(errors, sizes, strict=True)]))


def as_plan(
    form: Modes,
    cost: StepCost,
    footsteps: Float[Array, "n 2"],
    steps: Float[Array, "n 2"],
    gait: Float[Array, "n 2 2"],
    states: Float[Array, "n 3 2"],
    inputs: Float[Array, "n 2"],
) -> StepPlan:
    """Plan from the wanted footsteps and steps, the reference (xi, zeta) and the deviations from them."""
    planned, taken = footsteps + states[:, 0], steps + inputs
    divergent, convergent = gait[:, 0] + states[:, 1], gait[:, 1] + states[:, 2]
    velocity = (divergent - convergent) / (form.divergent_lead - form.convergent_lead)
    position = divergent - form.divergent_lead * velocity
    total = jnp.sum(states * weigh_states(cost, states)) + cost.effort * jnp.sum(taken**2)
    return StepPlan(planned, jnp.stack([planned + position, position, velocity], axis=-1), taken, total)


def conclude(
    plan: StepPlan,
    residual: Float[Array, ""],
    usable: Bool[Array, ""],
    status: Int[Array, ""],
    iterations: Int[Array, ""],
    margin: Float[Array, ""],
) -> Solution:
    """Solution of a plan; whatever is not finite is replaced by 0 and reported as NON_FINITE.

    Args:
        margin: how far the bounds are from changing sides, relative; derivatives need more than the tolerance.
    """
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in plan])) & jnp.isfinite(residual)
    good = usable & finite
    plan = StepPlan(*(jnp.where(jnp.isfinite(x), x, 0) for x in plan))
    status = jnp.where(good, status, jnp.asarray(Status.NON_FINITE, jnp.int32))
    residual = jnp.where(good, residual, jnp.inf)
    valid = (status == Status.CONVERGED) & (margin > jnp.sqrt(jnp.finfo(residual.dtype).eps))
    return Solution(plan, status, residual, iterations, valid, jnp.where(good, margin, 0))

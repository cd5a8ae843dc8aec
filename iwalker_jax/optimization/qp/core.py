"""The solver's core: searches for the active set in rounds, with ADMM, proximal and elastic steps between them.

All problems of a batch run side by side (batch axis last, see `factor`); a problem that is done keeps its answer.
- A round finds an active set, corrects the point by its true residual and keeps it if it is the best so far.
- P singular: the factor holds a small proximal term, which each correction and each round re-centres.
- A search that ran out of pivots is followed by ADMM, whose multipliers start the next round.
- Contradicting constraints: S gets ELASTIC added to its diagonal. Repeating that with the last multipliers is the
  augmented-Lagrangian method, which tends to the point of least violation, then least cost (Chiche, Gilbert 2016).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.optimization.qp.active_set import (
    ActiveSet,
    Tableau,
    Thresholds,
    contradiction,
    find_active_set,
    row_bounds,
)
from iwalker_jax.optimization.qp.admm import Splitting, admm
from iwalker_jax.optimization.qp.certificates import (
    cancelling,
    newton_step,
    proves_infeasible,
    proves_not_convex,
    proves_unbounded,
    violates_least,
)
from iwalker_jax.optimization.qp.factor import apply, apply_transposed, factorise, largest
from iwalker_jax.optimization.qp.scaling import (
    ProgramArrays,
    equilibrate,
    scale_point,
    scale_program,
    unscale_point,
)
from iwalker_jax.optimization.qp.settings import QpSettings
from iwalker_jax.optimization.qp.verdicts import (
    DEPENDENT,
    QpIterate,
    ScaledProgram,
    admissible_multipliers,
    assess,
    keep_better,
    nearly_feasible,
    optimality_residual,
    rate,
)
from iwalker_jax.optimization.solution import Status
from iwalker_jax.promotion import usual_promotion

ELASTIC = {4: 1e-3, 8: 1e-6}  # by the bytes of a number; relative to the unit diagonal of S
_SLACK, _LOOSE = 20, 1000  # violations taken for rounding: in units of eps, and of that


class _State(NamedTuple):
    centre: Array  # of the proximal term
    y: Array  # scaled multipliers, centre of the dual proximal term
    priority: Array  # rows to start the next search from
    elastic: Array
    penalty: Array
    best: QpIterate
    values: Array  # scaled constraint values, within the bounds: ADMM's copy
    ray: Array  # multipliers of a contradiction, if a search met one
    infeasible: Array  # proven
    done: Array
    rounds: Array


class _Subproblem(NamedTuple):
    """The proximal problem of a round: V (q - E centre), the unconstrained w0 and what counts as rounding in it."""

    shift: Array
    unconstrained: Array
    thresholds: Thresholds


class _Refinement(NamedTuple):
    found: ActiveSet
    x: Array
    y: Array
    settled: Array
    corrections: Array


@usual_promotion
def solve_core(
    settings: QpSettings,
    P: Float[Array, "n n *b"],
    q: Float[Array, " n *b"],
    C: Float[Array, "m n *b"],
    low: Float[Array, " m *b"],
    high: Float[Array, " m *b"],
    x: Float[Array, " n *b"],
    y: Float[Array, " m *b"],
) -> QpIterate:
    """Solve a batch of finite programs with low <= high from the guess (x, y); multipliers are those of C's rows."""
    dtype, batch = q.dtype, q.shape[1:]
    if not settings.well_posed:
        given = ProgramArrays(P, q, C, low, high)
        scaling = equilibrate(given)
        P, q, C, low, high = scale_program(given, scaling)
        x, y = scale_point(scaling, x, y)
    factor = factorise(P, C)
    # A row of zeros cannot be moved: it stays out of the search and is judged relative to its own bound.
    empty = factor.lengths == 0
    contradiction = jnp.any(empty & ((low > 0) | (high < 0)), axis=0)
    low = jnp.where(empty | jnp.isinf(low), -jnp.inf, low * factor.lengths)
    high = jnp.where(empty | jnp.isinf(high), jnp.inf, high * factor.lengths)
    program = ScaledProgram(P, q, C, row_bounds(low, high), factor)
    y = admissible_multipliers(program.bounds, jnp.where(empty, 0, y / jnp.where(empty, 1, factor.lengths)))
    start = QpIterate(
        x,
        y,
        jnp.zeros(low.shape, jnp.int32),
        jnp.full(batch, Status.MAX_ITERATIONS, jnp.int32),
        jnp.full(batch, jnp.inf, dtype),
        jnp.zeros(batch, bool),
        jnp.zeros(batch, dtype),
        jnp.asarray(0, jnp.int32),
    )
    state = _State(
        x,
        y,
        _priorities(program, y),
        jnp.zeros(batch, bool),
        jnp.full(batch, settings.penalty, dtype),
        start,
        jnp.clip(apply(C, x) * factor.lengths, low, high),
        jnp.zeros_like(y),
        jnp.zeros(batch, bool),
        jnp.zeros(batch, bool),
        jnp.asarray(0, jnp.int32),
    )
    run_round = _run_round if settings.method == "active_set" else _run_admm_round
    if settings.rounds == 1:
        state = run_round(program, settings, state)
    else:
        state = jax.lax.while_loop(
            lambda s: jnp.any(~s.done) & (s.rounds < settings.rounds),
            lambda s: run_round(program, settings, s),
            state,
        )
    best = state.best
    status = jnp.where(contradiction | state.infeasible, Status.INFEASIBLE, best.status)
    steep = factor.pivot < -30 * jnp.finfo(dtype).eps ** 0.5
    status = jnp.where(steep if settings.well_posed else proves_not_convex(P, factor), Status.NOT_CONVEX, status)
    x, y = best.x, best.y * factor.lengths
    if not settings.well_posed:
        x, y = unscale_point(scaling, x, y)
    return best._replace(x=x, y=y, status=status.astype(jnp.int32))


def _priorities(program: ScaledProgram, y: Float[Array, " m *b"]) -> Float[Array, " m *b"]:
    """Rows to start a search from: the equalities, then those with large multipliers."""
    equality = program.bounds.equality
    first = jnp.where(equality, 1e3 * (1 + largest(y)), 0)
    return jnp.where(equality, first, y)


def _run_round(program: ScaledProgram, settings: QpSettings, state: _State) -> _State:
    """One search, its refinements and their verdict; then where the next round starts from."""
    tolerance = settings.tolerance_for(program.q.dtype)
    subproblem = _subproblem(program, state)
    found, x, y = _refined(program, settings, state, subproblem, _search(program, settings, state, subproblem))
    assessment = assess(program, found, x, y, tolerance, settings.well_posed)
    iterate = rate(program, found, x, assessment, tolerance, settings.well_posed)
    blocked = state.elastic | found.blocked
    # Proofs of failure are rare and not looked for where no problem of the chunk gives cause.
    never = jnp.zeros(blocked.shape, bool)

    def contradicted() -> tuple[Array, Array, Array]:
        still, violation = violates_least(program, assessment)
        ray = jnp.where(found.blocked, cancelling(program, found, contradiction(found, program.bounds)), state.ray)
        proven = proves_infeasible(program, ray, x)
        proven |= state.elastic & proves_infeasible(program, cancelling(program, found, violation), x)
        return blocked & proven & ~state.done, still, ray

    infeasible, still, ray = jax.lax.cond(jnp.any(blocked), contradicted, lambda: (never, never, state.ray))
    infeasible |= state.infeasible
    drifting = ~blocked & (jnp.max(program.factor.excess, axis=0) > 0) & (iterate.residual > tolerance)

    def descending() -> Array:
        return proves_unbounded(program, found, x - state.centre) & nearly_feasible(program, assessment, x, tolerance)

    unbounded = drifting & jax.lax.cond(jnp.any(drifting), descending, lambda: never)
    # The point of least violation is worth more rounds than the proof.
    proven = unbounded | (infeasible & (still if settings.rounds > 1 else True))
    iterate = iterate._replace(status=jnp.where(unbounded, Status.UNBOUNDED, iterate.status).astype(jnp.int32))
    improved = ~state.done & ((iterate.residual < state.best.residual) | proven | (state.elastic & found.solved))
    improved &= jnp.all(jnp.isfinite(x), axis=0)
    best = keep_better(iterate, state.best, improved)
    done = state.done | (iterate.residual <= tolerance) | proven
    if settings.rounds == 1:
        guess, penalty = y, state.penalty
    else:
        lost = ~done & ~found.solved & ~blocked
        guess, penalty = _next_guess(program, settings, state, subproblem, iterate, assessment.values, lost)
    finite = jnp.all(jnp.isfinite(x), axis=0) & jnp.all(jnp.isfinite(y), axis=0)
    # The first elastic round starts from scratch: a blocked search leaves no point worth keeping.
    fresh = blocked & ~state.elastic
    return _State(
        jnp.where(finite & ~fresh, x, state.centre),
        jnp.where(finite, jnp.where(fresh, 0, iterate.y), state.y),
        _priorities(program, jnp.where(finite, guess, 0)),
        blocked,
        penalty,
        best,
        state.values,
        ray,
        infeasible,
        done,
        state.rounds + 1,
    )


def _run_admm_round(program: ScaledProgram, settings: QpSettings, state: _State) -> _State:
    """ADMM's iterations, the point that they point to (OSQP's polish), and the verdict on the better of the two."""
    bounds, tolerance = program.bounds, settings.tolerance_for(program.q.dtype)
    subproblem = _subproblem(program, state)
    split, penalty = _split(program, settings, subproblem, Splitting(state.values, state.y), state.penalty)
    y = admissible_multipliers(bounds, split.y)
    x = -apply_transposed(program.factor.root, subproblem.shift + apply(program.factor.rows, y))
    touching = (split.z >= bounds.high) | (split.z <= bounds.low)
    pointed = state._replace(priority=_priorities(program, jnp.where(touching, y, 0)))
    found = _search(program, settings, pointed, subproblem)
    found, polished_x, polished_y = _refined(program, settings, pointed, subproblem, found)
    assessment = assess(program, found, polished_x, polished_y, tolerance, settings.well_posed)
    polished = rate(program, found, polished_x, assessment, tolerance, settings.well_posed)
    rough = optimality_residual(program, x, y, tolerance, settings.well_posed)
    never = jnp.zeros(state.done.shape, bool)
    iterate = QpIterate(
        x,
        y,
        jnp.sign(y).astype(jnp.int32),
        jnp.where(rough.residual <= tolerance, Status.CONVERGED, Status.MAX_ITERATIONS).astype(jnp.int32),
        rough.residual,
        never,
        jnp.zeros_like(rough.residual),
        jnp.asarray(settings.admm_iterations, jnp.int32),
    )
    better = (polished.residual <= rough.residual) & jnp.all(jnp.isfinite(polished_x), axis=0)
    iterate = keep_better(polished._replace(pivots=jnp.asarray(0, jnp.int32)), iterate, better)

    def failing() -> tuple[Array, Array]:
        infeasible = proves_infeasible(program, cancelling(program, found, y - state.y), x)
        unbounded = proves_unbounded(program, found, x - state.centre)
        return infeasible, unbounded & nearly_feasible(program, rough, x, tolerance)

    lost = ~state.done & (iterate.residual > tolerance)
    infeasible, unbounded = jax.lax.cond(jnp.any(lost), failing, lambda: (never, never))
    infeasible, unbounded = state.infeasible | (lost & infeasible), lost & unbounded
    status = jnp.where(unbounded, Status.UNBOUNDED, iterate.status).astype(jnp.int32)
    iterate = iterate._replace(status=status)
    improved = ~state.done & ((iterate.residual < state.best.residual) | unbounded) & jnp.all(jnp.isfinite(x), axis=0)
    finite = jnp.all(jnp.isfinite(x), axis=0) & jnp.all(jnp.isfinite(split.z + split.y), axis=0)
    return state._replace(
        centre=jnp.where(finite, x, state.centre),
        y=jnp.where(finite, split.y, 0),
        values=jnp.where(finite, split.z, state.values),
        penalty=penalty,
        best=keep_better(iterate, state.best, improved),
        infeasible=infeasible,
        done=state.done | ~lost | infeasible | unbounded,
        rounds=state.rounds + 1,
    )


def _subproblem(program: ScaledProgram, state: _State) -> _Subproblem:
    """The proximal problem around the state."""
    factor, bounds, dtype = program.factor, program.bounds, program.q.dtype
    size = dtype.itemsize
    shift = apply(factor.root, program.q - factor.excess * state.centre)
    unconstrained = -apply_transposed(factor.rows, shift)
    outside = jnp.maximum(jnp.maximum(unconstrained - bounds.high, bounds.low - unconstrained), 0)
    slack = _SLACK * jnp.finfo(dtype).eps * jnp.maximum(largest(unconstrained), largest(outside))
    pivot = jnp.where(state.elastic, ELASTIC[size] / 2, DEPENDENT[size]).astype(dtype)
    return _Subproblem(shift, unconstrained, Thresholds(slack, _LOOSE * slack, pivot))


def _pivot_limit(settings: QpSettings, rows: int) -> int:
    return settings.pivots or 5 * (rows + 10)


def _search(program: ScaledProgram, settings: QpSettings, state: _State, subproblem: _Subproblem) -> ActiveSet:
    """Search the active set of the proximal, and for contradicting constraints elastic, problem from its start."""
    m, gram, dtype = program.bounds.low.shape[0], program.factor.gram, program.q.dtype
    elasticity = jnp.where(state.elastic, ELASTIC[dtype.itemsize], 0).astype(dtype)
    identity = jnp.eye(m, dtype=dtype).reshape((m, m) + (1,) * elasticity.ndim)
    # The first round is never elastic.
    matrix = gram if settings.rounds == 1 else gram + elasticity * identity
    tableau = Tableau(matrix, subproblem.unconstrained + elasticity * state.y, jnp.zeros_like(program.bounds.low))
    return find_active_set(
        tableau,
        program.bounds,
        subproblem.thresholds,
        state.priority,
        jnp.zeros(elasticity.shape, bool),
        _pivot_limit(settings, m),
    )


def _correct(
    program: ScaledProgram, found: ActiveSet, x: Float[Array, " n *b"], y: Float[Array, " m *b"]
) -> tuple[Float[Array, " n *b"], Float[Array, " m *b"]]:
    """One Newton step on the true optimality conditions with the active set held."""
    factor, bounds = program.factor, program.bounds
    force = apply(program.P, x) + program.q + apply_transposed(program.C, y * factor.lengths)
    bound = jnp.where(found.sides > 0, bounds.high, bounds.low)
    gap = jnp.where(found.sides != 0, apply(program.C, x) * factor.lengths - bound, 0)
    step, change = newton_step(factor, found, force, gap)
    return x + step, y + change


def _refine(
    program: ScaledProgram, settings: QpSettings, state: _State, least_pivot: Float[Array, "*b"], carry: _Refinement
) -> _Refinement:
    """Correct the point by its true residual and go on with the search from there."""
    found, x, y, settled, corrections = carry
    factor, dtype = program.factor, program.q.dtype
    # An elastic row's multiplier grows by what is still violated; correcting it here would overshoot.
    held = state.done | state.elastic | found.blocked | settled
    better_x, better_y = _correct(program, found, x, y)
    x, y = jnp.where(held, x, better_x), jnp.where(held, y, better_y)
    # Rounding may have hidden a violated row or a wrong sign: the search goes on from the corrected values.
    values = apply(program.C, x) * factor.lengths
    slack = _SLACK * jnp.finfo(dtype).eps * largest(values)
    after = find_active_set(
        Tableau(found.matrix, jnp.where(found.sides != 0, y, values), found.sides),
        program.bounds,
        Thresholds(slack, slack, least_pivot),
        None,
        held,
        _pivot_limit(settings, y.shape[0]),
    )
    change = jnp.where(held, 0, after.y - y)
    x -= apply_transposed(factor.root, apply(factor.rows, change))
    found = after._replace(
        solved=jnp.where(held, found.solved, after.solved),
        blocked=found.blocked | after.blocked,
        blocker=jnp.where(found.blocked, found.blocker, after.blocker),
        pivots=found.pivots + after.pivots,
    )
    y += change
    tolerance = settings.tolerance_for(dtype)
    settled = settled | (assess(program, found, x, y, tolerance, settings.well_posed).residual <= tolerance)
    return _Refinement(found, x, y, settled, corrections + 1)


def _refined(
    program: ScaledProgram, settings: QpSettings, state: _State, subproblem: _Subproblem, found: ActiveSet
) -> tuple[ActiveSet, Float[Array, " n *b"], Float[Array, " m *b"]]:
    """The active set's point, refined; the set may change on the way."""
    factor, unsettled = program.factor, jnp.zeros(state.done.shape, bool)
    x = -apply_transposed(factor.root, subproblem.shift + apply(factor.rows, found.y))
    carry = _Refinement(found, x, found.y, unsettled, jnp.asarray(0, jnp.int32))

    def refine(carry: _Refinement) -> _Refinement:
        return _refine(program, settings, state, subproblem.thresholds.pivot, carry)

    def unfinished(carry: _Refinement) -> Bool[Array, ""]:
        held = carry.settled | state.done | state.elastic | carry.found.blocked
        return (carry.corrections < settings.refinements) & jnp.any(~held)

    if settings.rounds == 1:
        for _ in range(settings.refinements):
            carry = refine(carry._replace(settled=unsettled))
    else:
        carry = jax.lax.while_loop(unfinished, refine, carry)
    return carry.found, carry.x, carry.y


def _split(
    program: ScaledProgram, settings: QpSettings, subproblem: _Subproblem, start: Splitting, penalty: Float[Array, "*b"]
) -> tuple[Splitting, Float[Array, "*b"]]:
    """One round of ADMM, and the penalty of the next."""
    bounds = program.bounds
    return admm(
        program.factor.gram,
        subproblem.unconstrained,
        bounds.low,
        bounds.high,
        start,
        penalty,
        settings.relaxation,
        settings.admm_iterations,
    )


def _next_guess(
    program: ScaledProgram,
    settings: QpSettings,
    state: _State,
    subproblem: _Subproblem,
    iterate: QpIterate,
    values: Float[Array, " m *b"],
    lost: Bool[Array, "*b"],
) -> tuple[Float[Array, " m *b"], Float[Array, "*b"]]:
    """Multipliers for the next search to start from, by ADMM where the last one is `lost`; and ADMM's next penalty."""
    bounds = program.bounds

    def explore(_: None) -> tuple[Array, Array]:
        begin = Splitting(jnp.where(jnp.isfinite(values), values, 0), iterate.y)
        split, penalty = _split(program, settings, subproblem, begin, state.penalty)
        return admissible_multipliers(bounds, split.y), penalty

    guess, penalty = jax.lax.cond(jnp.any(lost), explore, lambda _: (iterate.y, state.penalty), None)
    return jnp.where(lost, guess, iterate.y), penalty

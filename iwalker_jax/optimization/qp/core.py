"""The solver's core: searches for the active set in rounds, with ADMM, proximal and elastic steps between them.

All problems of a batch run side by side (batch axis last, see `qp_factor`); a problem that is done keeps its answer.
- A round finds an active set, corrects the point by its true residual and keeps it if it is the best so far.
- P singular: the factor holds a small proximal term, which each correction and each round re-centres.
- A search that ran out of pivots is followed by ADMM, whose multipliers start the next round.
- Contradicting constraints: S gets ELASTIC added to its diagonal. Repeating that with the last multipliers is the
  augmented-Lagrangian method, which tends to the point of least violation, then least cost (Chiche, Gilbert 2016).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.optimization.qp.active_set import ActiveSet, find_active_set
from iwalker_jax.optimization.qp.admm import Splitting, admm
from iwalker_jax.optimization.qp.factor import Factor, apply, apply_transposed, factorise, largest
from iwalker_jax.optimization.qp.settings import QpSettings
from iwalker_jax.optimization.solution import Status

ELASTIC = {4: 1e-3, 8: 1e-6}  # by the bytes of a number; relative to the unit diagonal of S
_DEPENDENT = {4: 2e-5, 8: 1e-10}  # bytes of a number -> Schur complement that counts as zero
_SLACK, _LOOSE = 20, 1000  # violations taken for rounding: in units of eps, and of that
_CERTIFICATE = {4: 1e-3, 8: 1e-6}  # largest relative error of a proof that there is no solution


class Answer(NamedTuple):
    """Outcome, shapes as in `qp_factor`.

    Attributes:
        x, y: (n, *b), (m, *b) point and multipliers, unscaled.
        sides: (m, *b) int, independent active rows: +1 at high, -1 at low.
        status, residual, rounds: (*b,), (*b,), ().
        regular: (*b,) bool, no row is about to become active or inactive.
        pivots: () pivots of the longest search, all rounds together.
    """

    x: Float[Array, " n *b"]
    y: Float[Array, " m *b"]
    sides: Int[Array, " m *b"]
    status: Int[Array, "*b"]
    residual: Float[Array, "*b"]
    regular: Bool[Array, "*b"]
    pivots: Int[Array, ""]


class _Scaled(NamedTuple):
    """Data of the problem with the bounds of scaled rows."""

    P: Array
    q: Array
    C: Array
    low: Array
    high: Array
    factor: Factor


class _State(NamedTuple):
    point: Array  # centre of the proximal term
    y: Array  # scaled multipliers, centre of the dual proximal term
    wish: Array
    elastic: Array
    penalty: Array
    best: Answer
    done: Array
    rounds: Array


def _search(data: _Scaled, state: _State, settings: QpSettings) -> tuple[Callable[..., ActiveSet], Array, Array, Array]:
    """Search for the active set of the proximal problem around the state; also V (q - E centre), w0 and its noise."""
    factor, dtype = data.factor, data.q.dtype
    m, size = data.low.shape[0], dtype.itemsize
    shift = apply(factor.root, data.q - factor.excess * state.point)
    free = -apply_transposed(factor.rows, shift)
    outside = jnp.maximum(jnp.maximum(free - data.high, data.low - free), 0)
    slack = _SLACK * jnp.finfo(dtype).eps * jnp.maximum(largest(free), largest(outside))
    least = jnp.where(state.elastic, ELASTIC[size] / 2, _DEPENDENT[size]).astype(dtype)
    limit = settings.pivots or 5 * (m + 10)

    def search(
        tableau: Array,
        value: Array,
        sides: Array,
        wish: Array | None,
        slack: Array,
        loose: Array,
        still: Array | None = None,
    ) -> ActiveSet:
        still = jnp.zeros(slack.shape, bool) if still is None else still
        return find_active_set(tableau, value, sides, data.low, data.high, wish, slack, loose, least, still, limit)

    return search, shift, free, slack


def _correct(data: _Scaled, found: ActiveSet, x: Array, y: Array) -> tuple[Array, Array]:
    """One Newton step on the true optimality conditions with the active set held."""
    factor = data.factor
    active = found.sides != 0
    force = apply(data.P, x) + data.q + apply_transposed(data.C, y * factor.lengths)
    step = -apply(factor.root, force)
    bound = jnp.where(found.sides > 0, data.high, data.low)
    miss = jnp.where(active, apply(data.C, x) * factor.lengths - bound, 0)
    miss = jnp.where(active, miss + apply_transposed(factor.rows, step), 0)
    change = jnp.where(active, -apply(found.tableau, miss), 0)
    step = step - apply(factor.rows, change)
    return x + apply_transposed(factor.root, step), y + change


def _judge(data: _Scaled, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Residual of the optimality conditions in the metric of the cost, scaled violation and the scale of both.

    The multipliers must have their signs already.
    """
    factor = data.factor
    value = apply(data.C, x) * factor.lengths
    image = apply(data.P, x)
    force = apply(factor.root, image + data.q + apply_transposed(data.C, y * factor.lengths))
    violation = jnp.maximum(jnp.maximum(value - data.high, data.low - value), 0)
    bound = jnp.where(y > 0, data.high, data.low)
    gap = jnp.where(y != 0, jnp.abs(value - bound), 0)
    energy = jnp.sqrt(jnp.maximum(jnp.sum(x * (image + factor.excess * x), axis=0), 0))
    cost = apply(factor.root, data.q)
    eps = jnp.finfo(x.dtype).eps
    floor = jnp.sqrt(eps) * jnp.sqrt(jnp.sum(cost * cost, axis=0))
    scale = jnp.maximum(energy, jnp.maximum(floor, largest(jnp.where(y != 0, bound, 0))))
    scale = jnp.maximum(scale, jnp.finfo(x.dtype).tiny)
    worst = jnp.maximum(largest(force), jnp.maximum(largest(violation), largest(gap)))
    return worst / scale, value, scale


def solve_core(
    settings: QpSettings,
    P: Float[Array, "n n *b"],
    q: Float[Array, " n *b"],
    C: Float[Array, "m n *b"],
    low: Float[Array, " m *b"],
    high: Float[Array, " m *b"],
    x: Float[Array, " n *b"],
    y: Float[Array, " m *b"],
) -> Answer:
    """Solve a batch of finite programs with low <= high from the guess (x, y)."""
    dtype, batch, m = q.dtype, q.shape[1:], low.shape[0]
    size = dtype.itemsize
    eps = jnp.finfo(dtype).eps
    tolerance, certificate = settings.tolerance_for(dtype), _CERTIFICATE[size]
    factor = factorise(P, C)
    # A row of zeros cannot be moved: it stays out of the search and is judged relative to its own bound.
    empty = factor.lengths == 0
    contradiction = jnp.any(empty & ((low > 0) | (high < 0)), axis=0)
    low = jnp.where(empty | jnp.isinf(low), -jnp.inf, low * factor.lengths)
    high = jnp.where(empty | jnp.isinf(high), jnp.inf, high * factor.lengths)
    data = _Scaled(P, q, C, low, high, factor)
    equality = low == high

    def signed(y: Array) -> Array:
        y = jnp.where(y > 0, jnp.where(jnp.isfinite(high), y, 0), jnp.where(jnp.isfinite(low), y, 0))
        return jnp.where(jnp.isfinite(y), y, 0)

    def wishes(y: Array) -> Array:
        sure = jnp.where(equality, 1e3 * (1 + largest(y)), 0)
        return jnp.where(equality, sure, y)

    def rate(found: ActiveSet, x: Array, y: Array) -> tuple[Answer, Array, Array]:
        right = signed(jnp.where(found.sides * y < 0, jnp.where(equality, y, 0), y))
        residual, value, scale = _judge(data, x, right)
        residual = jnp.where(jnp.isfinite(residual), residual, jnp.inf)
        diagonal = jnp.stack([found.tableau[i, i] for i in range(m)])
        edge = jnp.maximum(4 * residual, tolerance / 100) * scale
        weak = (found.sides != 0) & ~equality & (jnp.abs(right) * jnp.abs(1 / jnp.minimum(diagonal, -1e-30)) < edge)
        room = jnp.minimum(high - value, value - low)
        near = (found.sides == 0) & (room < edge) & (diagonal > _DEPENDENT[size])
        regular = ~jnp.any(weak | near, axis=0)
        status = jnp.where(residual <= tolerance, Status.CONVERGED, Status.MAX_ITERATIONS)
        answer = Answer(
            x, right, found.sides.astype(jnp.int32), status.astype(jnp.int32), residual, regular, found.pivots
        )
        return answer, value, scale

    def impossible(value: Array, scale: Array) -> Array:
        violation = value - jnp.clip(value, low, high)
        length = jnp.sqrt(jnp.sum(violation * violation, axis=0))
        slope = apply(factor.rows, violation)
        steep = jnp.sqrt(jnp.sum(slope * slope, axis=0))
        return (length > tolerance * scale) & (steep <= certificate * length)

    def unbounded(direction: Array, x: Array) -> Array:
        weights = jnp.stack([P[k, k] for k in range(q.shape[0])]) + factor.excess
        length = jnp.sqrt(jnp.maximum(jnp.sum(weights * direction * direction, axis=0), jnp.finfo(dtype).tiny))
        direction = direction / length
        bent = jnp.sqrt(jnp.maximum(jnp.sum(direction * apply(P, direction), axis=0), 0))
        value = apply(C, direction) * factor.lengths
        leaves = jnp.maximum(jnp.where(jnp.isfinite(high), value, 0), jnp.where(jnp.isfinite(low), -value, 0))
        slope, total = jnp.sum(q * direction, axis=0), jnp.sum(jnp.abs(q * direction), axis=0)
        small = certificate
        far = length > 0.1 * jnp.sqrt(jnp.sum(weights * x * x, axis=0))
        return far & (bent <= small) & (largest(leaves) <= small) & (slope < -small * total) & (total > 0)

    def better(new: Answer, old: Answer, improved: Array) -> Answer:
        kept = jax.tree.map(
            lambda a, b: jnp.where(improved, a, b), new._replace(pivots=old.status), old._replace(pivots=old.status)
        )
        return kept._replace(pivots=old.pivots + new.pivots)

    def turn(state: _State) -> _State:
        search, shift, free, slack = _search(data, state, settings)
        soft = jnp.where(state.elastic, ELASTIC[size], 0).astype(dtype)
        identity = jnp.eye(m, dtype=dtype).reshape((m, m) + (1,) * soft.ndim)
        begin = free + soft * state.y
        # The first round is never elastic.
        tableau = factor.gram if settings.rounds == 1 else factor.gram + soft * identity
        found = search(tableau, begin, jnp.zeros_like(low), state.wish, slack, _LOOSE * slack)

        def refine(carry: tuple) -> tuple:
            found, point, y, settled, count = carry
            # An elastic row's multiplier grows by what is still violated; correcting it here would overshoot.
            held = state.done | state.elastic | found.blocked | settled
            better_point, better_y = _correct(data, found, point, y)
            point, y = jnp.where(held, point, better_point), jnp.where(held, y, better_y)
            # Rounding may have hidden a violated row or a wrong sign: the search goes on from the corrected values.
            value = apply(C, point) * factor.lengths
            slack = _SLACK * eps * largest(value)
            after = search(
                found.tableau,
                jnp.where(found.sides != 0, y, value),
                found.sides,
                None,
                slack,
                slack,
                held,
            )
            change = jnp.where(held, 0, after.y - y)
            point -= apply_transposed(factor.root, apply(factor.rows, change))
            found = after._replace(
                solved=jnp.where(held, found.solved, after.solved),
                blocked=found.blocked | after.blocked,
                pivots=found.pivots + after.pivots,
            )
            y += change
            return found, point, y, settled | (rate(found, point, y)[0].residual <= tolerance), count + 1

        point = -apply_transposed(factor.root, shift + apply(factor.rows, found.y))
        carry = (found, point, found.y, jnp.zeros(batch, bool), jnp.asarray(0, jnp.int32))
        if settings.rounds == 1:
            for _ in range(settings.refinements):
                carry = refine((*carry[:3], jnp.zeros(batch, bool), carry[4]))
        else:
            carry = jax.lax.while_loop(
                lambda c: (c[4] < settings.refinements) & jnp.any(~(c[3] | state.done | state.elastic | c[0].blocked)),
                refine,
                carry,
            )
        found, point, y = carry[:3]
        held = state.elastic | found.blocked
        answer, value, scale = rate(found, point, y)
        # Proofs of failure are rare and not looked for where no problem of the chunk gives cause.
        never = jnp.zeros(batch, bool)
        none = held & jax.lax.cond(jnp.any(held), lambda: impossible(value, scale), lambda: never)
        status = jnp.where(none, Status.INFEASIBLE, answer.status)
        wild = ~held & (jnp.max(factor.excess, axis=0) > 0)
        wild &= jax.lax.cond(jnp.any(wild), lambda: unbounded(point - state.point, point), lambda: never)
        status = jnp.where(wild & (answer.residual > tolerance), Status.UNBOUNDED, status)
        answer = answer._replace(status=status.astype(jnp.int32))
        verdict = none | (wild & (answer.residual > tolerance))
        improved = ~state.done & ((answer.residual < state.best.residual) | verdict | (state.elastic & found.solved))
        improved &= jnp.all(jnp.isfinite(point), axis=0)
        best = better(answer, state.best, improved)
        done = state.done | (answer.residual <= tolerance) | verdict
        elastic = state.elastic | found.blocked

        def explore(_: None) -> tuple[Array, Array]:
            begin = Splitting(jnp.where(jnp.isfinite(value), value, 0), answer.y)
            split, penalty = admm(
                factor.gram, free, low, high, begin, state.penalty, settings.relaxation, settings.admm_iterations
            )
            return signed(split.y), penalty

        if settings.rounds == 1:
            guess, penalty = y, state.penalty
        else:
            lost = ~done & ~found.solved & ~elastic
            guess, penalty = jax.lax.cond(jnp.any(lost), explore, lambda _: (answer.y, state.penalty), None)
            guess = jnp.where(lost, guess, answer.y)
        finite = jnp.all(jnp.isfinite(point), axis=0) & jnp.all(jnp.isfinite(y), axis=0)
        # The first elastic round starts from scratch: a blocked search leaves no point worth keeping.
        fresh = elastic & ~state.elastic
        return _State(
            jnp.where(finite & ~fresh, point, state.point),
            jnp.where(finite, jnp.where(fresh, 0, answer.y), state.y),
            wishes(jnp.where(finite, guess, 0)),
            elastic,
            penalty,
            best,
            done,
            state.rounds + 1,
        )

    y = signed(jnp.where(empty, 0, y / jnp.where(empty, 1, factor.lengths)))
    none = Answer(
        x,
        y,
        jnp.zeros(low.shape, jnp.int32),
        jnp.full(batch, Status.MAX_ITERATIONS, jnp.int32),
        jnp.full(batch, jnp.inf, dtype),
        jnp.zeros(batch, bool),
        jnp.asarray(0, jnp.int32),
    )
    state = _State(
        x,
        y,
        wishes(y),
        jnp.zeros(batch, bool),
        jnp.full(batch, settings.penalty, dtype),
        none,
        jnp.zeros(batch, bool),
        jnp.asarray(0, jnp.int32),
    )
    if settings.rounds == 1:
        state = turn(state)
    else:
        state = jax.lax.while_loop(lambda s: jnp.any(~s.done) & (s.rounds < settings.rounds), turn, state)
    best = state.best
    status = jnp.where(contradiction, Status.INFEASIBLE, best.status)
    status = jnp.where(factor.pivot < -30 * jnp.sqrt(eps), Status.NOT_CONVEX, status)
    return best._replace(y=best.y * factor.lengths, status=status.astype(jnp.int32))

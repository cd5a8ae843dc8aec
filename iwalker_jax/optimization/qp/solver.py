"""Dense quadratic programs min x'P x / 2 + q'x with low <= C x <= high: solved, judged and differentiated."""

from typing import NamedTuple, get_args

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.optimization.qp.batch import solve_batched
from iwalker_jax.optimization.qp.gradients import differentiable, unrolled
from iwalker_jax.optimization.qp.problem import QuadraticProgram, check_program_shapes, in_floats, named_rows
from iwalker_jax.optimization.qp.settings import QpSettings
from iwalker_jax.optimization.solution import GradientMode, Solution, Status, describe
from iwalker_jax.promotion import usual_promotion


class QpPoint(NamedTuple):
    """A solution, or a guess of one (only x and y matter then).

    Attributes:
        x: (n,) variables.
        y: (m,) multipliers: P x + q + C'y = 0, y > 0 only at high, y < 0 only at low.
        sides: (m,) int, the independent active rows: +1 at high, -1 at low, 0 none.
        violation: (m,) how far C x lies beyond the bounds, in the units of each row.
        block_violation: (blocks,) the largest of each named block, in its units.
    """

    x: Float[Array, " n"]
    y: Float[Array, " m"]
    sides: Int[Array, " m"]
    violation: Float[Array, " m"]
    block_violation: Float[Array, " k"]


def cold_start(problem: QuadraticProgram) -> QpPoint:
    """The guess that knows nothing; a scan's first carry."""
    problem = in_floats(problem)
    m = problem.low.shape[0]
    zeros, blocks = jnp.zeros_like(problem.low), jnp.zeros(len(problem.blocks), problem.q.dtype)
    return QpPoint(jnp.zeros_like(problem.q), zeros, jnp.zeros(m, jnp.int32), zeros, blocks)


@usual_promotion
def solve_qp(
    problem: QuadraticProgram,
    start: QpPoint | None = None,
    settings: QpSettings = QpSettings(),
    gradient: GradientMode = "implicit",
) -> Solution:
    """Solve a dense quadratic program by a dual active-set method that ADMM, proximal and elastic steps make robust.

    Args:
        problem: the program; batches by vmap.
        start: guess, such as the last tick's solution; the nearer, the fewer pivots.
        settings: effort and tolerance; `control_settings()` for a control loop.
        gradient: `implicit` differentiates the optimality conditions with the active set held; `unrolled` runs and
            differentiates ADMM alone for `settings.admm_iterations`; `stopped` neither.

    Returns:
        Solution whose value is a `QpPoint`, finite whatever happens. The units of the variables and rows do not
        matter. The residual is the largest of stationarity, violation and complementarity, each in the metric of the
        cost (a row's violation over sqrt(c'H^-1 c)) and relative to the solution's own size in it, and of each row's
        violation relative to its own bound. CONVERGED: it is below the tolerance. INFEASIBLE: proven within the
        rounding of the program's entries (Farkas), and x violates the rows least (least squares of the violations
        over sqrt(c'H^-1 c)), then costs least. UNBOUNDED: likewise proven, and x is on its way along a direction of
        descent. NOT_CONVEX: the cost curves downwards along some direction. NON_FINITE: the input has NaN or infinite
        costs, replaced by zeros, or the solution is too large for a float. MAX_ITERATIONS: x is the best point met.
        `iterations` counts pivots (ADMM iterations if unrolled). `gradient_valid` is false where the solution is not
        unique, and where a row's own bound is about to matter or to stop mattering; the margin tells by how much (see
        `verdicts.regularity`).

    Raises:
        InputError: on wrong shapes, on what are no real numbers, or on an unknown gradient mode. Whole numbers and
            half precision are solved in single precision (double, if JAX's default is).
    """
    if gradient not in get_args(GradientMode):
        raise InputError(f"gradient is {gradient!r}; choose one of {', '.join(get_args(GradientMode))}.")
    problem = in_floats(problem)
    check_program_shapes(problem)
    blocks, m = problem.blocks, problem.low.shape[0]
    data: tuple[Array, ...] = (problem.P, problem.q, problem.C, problem.low, problem.high)
    dtype = problem.q.dtype
    if m == 0:  # one row that says nothing stands for none
        n = problem.q.shape[0]
        data = (*data[:2], jnp.zeros((1, n), dtype), jnp.full(1, -jnp.inf, dtype), jnp.full(1, jnp.inf, dtype))
    if gradient == "stopped":
        data = jax.lax.stop_gradient(data)
    data, usable, low, high = _sanitise(data)
    x, y = (jnp.zeros_like(data[1]), jnp.zeros_like(data[3])) if start is None or m == 0 else (start.x, start.y)
    x, y = (jnp.where(jnp.isfinite(v), v, 0).astype(dtype) for v in jax.lax.stop_gradient((x, y)))
    if gradient == "unrolled":
        (x, y), answer = unrolled(data, (x, y), settings)
    else:
        answer = jax.lax.stop_gradient(solve_batched(settings, *jax.lax.stop_gradient(data), x, y))
        # A solution beyond the range of floats is none.
        usable &= jnp.all(jnp.isfinite(answer.x)) & jnp.all(jnp.isfinite(answer.y))
        x, y = (jnp.where(jnp.isfinite(v), v, 0) for v in (answer.x, answer.y))
        if gradient == "implicit":
            meaningful = (answer.status != Status.UNBOUNDED) & (answer.status != Status.NOT_CONVEX)
            x, y = differentiable(data, x, y, answer.sides, meaningful)
    value = data[2] @ x
    usable &= jnp.all(jnp.isfinite(value))
    violation = jnp.maximum(jnp.maximum(value - high, low - value), 0)[:m]
    violation = jnp.nan_to_num(violation, nan=0.0)  # infinite becomes the largest float
    worst = [jnp.max(violation[rows], initial=0) for _, rows in named_rows(blocks, m)] if blocks else []
    point = QpPoint(x, y[:m], answer.sides[:m], violation, jnp.stack(worst) if worst else jnp.zeros(0, dtype))
    status = jnp.where(jnp.all(low <= high), answer.status, Status.INFEASIBLE)
    status = jnp.where(usable, status, Status.NON_FINITE).astype(jnp.int32)
    valid = answer.regular & (status == Status.CONVERGED)
    margin = jnp.where(status == Status.CONVERGED, answer.margin, 0)
    return Solution(point, status, answer.residual, answer.pivots, valid, margin)


def _sanitise(data: tuple[Array, ...]) -> tuple[tuple[Array, ...], Array, Array, Array]:
    """Finite data with low <= high, whether nothing had to be replaced, and the wanted bounds."""
    P, q, C, low, high = data
    usable = jnp.asarray(True)
    clean = []
    for array in (P, q, C):
        finite = jnp.isfinite(array)
        usable &= jnp.all(finite)
        clean.append(jnp.where(finite, array, 0))
    good_low, good_high = ~(jnp.isnan(low) | (low == jnp.inf)), ~(jnp.isnan(high) | (high == -jnp.inf))
    usable &= jnp.all(good_low) & jnp.all(good_high)
    low, high = jnp.where(good_low, low, -jnp.inf), jnp.where(good_high, high, jnp.inf)
    # Crossed bounds are met halfway.
    crossed = low > high
    middle = jnp.where(crossed, low, 0) / 2 + jnp.where(crossed, high, 0) / 2
    P = (clean[0] + clean[0].T) / 2
    return (P, clean[1], clean[2], jnp.where(crossed, middle, low), jnp.where(crossed, middle, high)), usable, low, high


def explain(problem: QuadraticProgram, solution: Solution) -> str:
    """Say in a sentence or two how a solve ended and, if constraints are violated, which block and row is worst.

    For concrete values on the host.
    """
    problem, sentence = in_floats(problem), describe(int(solution.status))
    violation = jnp.asarray(solution.value.violation)
    if int(solution.status) == Status.CONVERGED or not violation.size or float(violation.max()) == 0:
        return sentence
    lengths = jnp.linalg.norm(problem.C, axis=1)
    relative = violation / jnp.where(lengths > 0, lengths, 1)
    row = int(jnp.argmax(relative))
    for name, rows in named_rows(problem.blocks, violation.size):
        if rows.start <= row < rows.stop:
            others = int(jnp.sum(violation[rows] > 1e-3 * violation[row]))
            return (
                f"{sentence} The worst row is {row - rows.start} of {name!r}: it lies "
                f"{float(violation[row]):.3g} beyond "
                f"[{float(problem.low[row]):.3g}, {float(problem.high[row]):.3g}]; {others} of the block's "
                f"{rows.stop - rows.start} rows are violated."
            )
    return sentence

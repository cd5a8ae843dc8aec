"""MuJoCo's contact problem for one-sided rows, solved exactly and differentiated at its solution.

The acceleration q minimises 1/2 q'M q - q'f + 1/2 sum_i D_i min(0, J_i q - a_i)^2: smooth inertia M and force f, and
for joint limits and the edges of friction pyramids the Jacobian J, stiffness D and reference acceleration a of MuJoCo.
The cost is convex and piecewise quadratic: Newton's method with an exact line search meets the solution after a finite
number of steps, when the set of pressing rows no longer changes. Derivatives hold that set fixed: with the residual
r = f - M q + J'D(a - J q) over pressing rows, dq = (M + J'DJ)^-1 dr. They jump where a contact opens or closes.
Inside, matrices carry the batch as the last axes.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from iwalker_jax.optimization.hlip import require_range
from iwalker_jax.robot.batching import batch_last


@dataclass(frozen=True)
class ContactSolver:
    """Settings of the contact solver.

    Attributes:
        max_iterations: of Newton's method; two or three are usual, an impact can need eight.
        tolerance: largest residual force relative to the forces that balance; 0 asks for the precision's own.
    """

    max_iterations: int = 20
    tolerance: float = 0.0

    def __post_init__(self) -> None:
        require_range(self, "max_iterations", 1, 1000, "iterations")
        require_range(self, "tolerance", 0.0, 1.0, "relative")


class ContactProblem(NamedTuple):
    """Attributes:
    mass: (n, n) positive definite; force: (n,) smooth forces.
    rows: (m, n), stiffness: (m,) not negative, reference: (m,) of the one-sided rows.
    """

    mass: Float[Array, "n n"]
    force: Float[Array, " n"]
    rows: Float[Array, "m n"]
    stiffness: Float[Array, " m"]
    reference: Float[Array, " m"]


class ContactSolution(NamedTuple):
    """Attributes:
    acceleration: (n,); forces: (m,) not negative, of the rows.
    residual: () largest unbalanced force relative to the largest force; iterations: () of Newton's method.
    """

    acceleration: Float[Array, " n"]
    forces: Float[Array, " m"]
    residual: Float[Array, ""]
    iterations: Int[Array, ""]


def solve_contact(problem: ContactProblem, start: Float[Array, " n"], settings: ContactSolver) -> ContactSolution:
    """Solve from a first guess of the acceleration; differentiable in the problem in both modes.

    A non-finite problem gives a non-finite acceleration and stops at once.
    """
    acceleration, residual, iterations = _solve(settings, problem, start)
    forces = row_forces(problem, acceleration)
    return ContactSolution(acceleration, forces, residual, iterations)


def row_forces(problem: ContactProblem, acceleration: Float[Array, " n"]) -> Float[Array, " m"]:
    """Force of each row at an acceleration."""
    return problem.stiffness * jnp.maximum(problem.reference - problem.rows @ acceleration, 0)


def solve_symmetric(matrix: Float[Array, "n n"], right: Float[Array, " n"]) -> Float[Array, " n"]:
    """Solve a positive definite system, differentiable in the right-hand side alone."""
    return jax.lax.custom_linear_solve(lambda x: matrix @ x, right, lambda _, b: _eliminate(matrix, b), symmetric=True)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _solve(settings: ContactSolver, problem: ContactProblem, start: Float[Array, " n"]) -> tuple[Array, Array, Array]:
    return _newton(settings)(*problem, start)


@_solve.defjvp
def _solve_jvp(settings: ContactSolver, primals: tuple, tangents: tuple) -> tuple:
    problem, start = primals
    acceleration, residual, iterations = _solve(settings, problem, start)

    def unbalanced(problem: ContactProblem) -> Array:
        return problem.force - problem.mass @ acceleration + problem.rows.T @ row_forces(problem, acceleration)

    _, change = jax.jvp(unbalanced, (problem,), (tangents[0],))
    pressing = problem.stiffness * (problem.rows @ acceleration < problem.reference)
    hessian = problem.mass + problem.rows.T @ (pressing[:, None] * problem.rows)
    moved = solve_symmetric(jax.lax.stop_gradient(hessian), change)
    nothing = jnp.zeros(iterations.shape, jax.dtypes.float0)
    return (acceleration, residual, iterations), (moved, jnp.zeros_like(residual), nothing)


class _State(NamedTuple):
    acceleration: Array
    slack: Array  # J q - a
    gradient: Array
    scale: Array
    iterations: Array
    running: Array


def _newton(settings: ContactSolver):
    """Newton's method as a function of arrays with trailing batch axes."""

    def solve(mass: Array, force: Array, rows: Array, stiffness: Array, reference: Array, start: Array) -> tuple:
        tolerance = settings.tolerance or 8 * float(jnp.finfo(mass.dtype).eps)

        def evaluate(acceleration: Array, slack: Array) -> tuple[Array, Array]:
            inertial = _multiply(mass, acceleration)
            pressing = _multiply_transposed(rows, stiffness * jnp.minimum(slack, 0))
            size = jnp.maximum(jnp.max(jnp.abs(inertial), 0), jnp.max(jnp.abs(force), 0))
            return inertial - force + pressing, size

        def begin() -> _State:
            acceleration = jnp.where(jnp.isfinite(start), start, 0)
            slack = _multiply(rows, acceleration) - reference
            gradient, scale = evaluate(acceleration, slack)
            running = jnp.isfinite(jnp.sum(gradient, axis=0))
            return _State(acceleration, slack, gradient, scale, jnp.zeros(running.shape, jnp.int32), running)

        def advance(state: _State) -> _State:
            active = state.slack < 0
            hessian = mass
            weights = jnp.where(active, stiffness, 0)
            for k in range(rows.shape[0]):
                hessian = hessian + (weights[k] * rows[k])[:, None] * rows[k][None]
            step = -_eliminate_last(hessian, state.gradient)
            change = _multiply(rows, step)
            length = _line_search(
                jnp.sum(step * state.gradient, 0),
                jnp.sum(step * _multiply(mass, step), 0),
                state.slack,
                change,
                stiffness,
            )
            acceleration, slack = state.acceleration + length * step, state.slack + length * change
            gradient, scale = evaluate(acceleration, slack)
            unchanged = jnp.all((slack < 0) == active, axis=0)
            small = jnp.max(jnp.abs(gradient), 0) <= tolerance * scale
            running = ~(unchanged | small) & jnp.isfinite(jnp.sum(gradient, axis=0))
            new = _State(acceleration, slack, gradient, scale, state.iterations + 1, running)
            return jax.tree.map(lambda a, b: jnp.where(state.running, a, b), new, state)

        state = jax.lax.while_loop(
            lambda s: jnp.any(s.running & (s.iterations < settings.max_iterations)), advance, begin()
        )
        residual = jnp.max(jnp.abs(state.gradient), 0) / state.scale
        return state.acceleration, residual, state.iterations

    return batch_last(solve)


def _line_search(slope: Array, curvature: Array, slack: Array, change: Array, stiffness: Array) -> Array:
    """Exact minimiser along a Newton step of the piecewise quadratic cost; `slope` is its derivative at 0.

    The derivative grows linearly between the lengths where a row starts or stops pressing; it is evaluated at all of
    them and interpolated across its zero.
    """
    kinks = jnp.where(slack * change < 0, -slack / jnp.where(change == 0, 1, change), jnp.inf)
    pressing = stiffness * jnp.minimum(slack, 0) * change
    smooth = slope - jnp.sum(pressing, 0)

    def derivative(length: Array) -> Array:
        total = smooth + curvature * length
        for k in range(slack.shape[0]):
            total = total + stiffness[k] * change[k] * jnp.minimum(slack[k] + length * change[k], 0)
        return total

    finite = jnp.isfinite(kinks)
    at_kinks = derivative(jnp.where(finite, kinks, 0))
    below = finite & (at_kinks < 0)
    low = jnp.max(jnp.where(below, kinks, 0), 0)
    high = jnp.min(jnp.where(finite & ~below, kinks, jnp.inf), 0)
    # Between two neighbouring kinks the derivative is linear: take its value and slope at the middle.
    middle = jnp.where(jnp.isfinite(high), (low + high) / 2, low + 1)
    pressing_there = slack + middle * change < 0
    rise = curvature + jnp.sum(jnp.where(pressing_there, stiffness * change**2, 0), 0)
    at_zero = smooth + jnp.sum(jnp.where(pressing_there, stiffness * change * slack, 0), 0)
    return -at_zero / rise


def _multiply(matrix: Array, vector: Array) -> Array:
    """Matrix times vector, batch last."""
    total = matrix[:, 0] * vector[0]
    for k in range(1, matrix.shape[1]):
        total = total + matrix[:, k] * vector[k]
    return total


def _multiply_transposed(matrix: Array, vector: Array) -> Array:
    """Transposed matrix times vector, batch last."""
    total = matrix[0] * vector[0]
    for k in range(1, matrix.shape[0]):
        total = total + matrix[k] * vector[k]
    return total


def _eliminate_last(matrix: Array, right: Array) -> Array:
    """Solve a positive definite system by elimination without pivots, batch last."""
    work = jnp.concatenate([matrix, right[:, None]], axis=1)
    rows = []
    for _ in range(matrix.shape[0]):
        row = work[0] / work[0, 0]
        rows.append(row)
        work = work[1:, 1:] - work[1:, 0][:, None] * row[None, 1:]
    solution: list[Array] = []
    for row in reversed(rows):
        value = row[-1]
        for k, known in enumerate(reversed(solution)):
            value = value - row[k + 1] * known
        solution.append(value)
    return jnp.stack(solution[::-1])


_eliminate = batch_last(_eliminate_last)

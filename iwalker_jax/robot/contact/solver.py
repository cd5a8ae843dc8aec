"""MuJoCo's contact problem for one-sided rows, solved exactly and differentiated at its solution.

The acceleration q minimises 1/2 q'M q - q'f + 1/2 sum_i D_i min(0, J_i q - a_i)^2: smooth inertia M and force f, and
for joint limits and the edges of friction pyramids the Jacobian J, stiffness D and reference acceleration a of MuJoCo.
The cost is convex and piecewise quadratic: Newton's method with an exact line search meets the solution after a finite
number of steps, when the set of pressing rows no longer changes. Derivatives hold that set fixed: with the residual
r = f - M q + J'D(a - J q) over pressing rows, dq = (M + J'DJ)^-1 dr. They jump where a row starts or stops pressing.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from iwalker_jax.checks import require_range
from iwalker_jax.robot.contact.newton import minimise
from iwalker_jax.robot.limbs import Limbs, solve_symmetric


@dataclass(frozen=True)
class ContactSettings:
    """Settings of the contact solver.

    Attributes:
        max_iterations: of Newton's method; one or two are usual, an impact can need eight.
        tolerance: residual at which to stop, relative; 0 asks for what the precision allows.
    """

    max_iterations: int = 20
    tolerance: float = 0.0

    def __post_init__(self) -> None:
        require_range(self, "max_iterations", 1, 1000, "iterations")
        require_range(self, "tolerance", 0.0, 1.0, "relative")


class ContactProblem(NamedTuple):
    """One contact problem of n velocities, of which the last n - 6 are joints, and m contact rows.

    Attributes:
        mass: (n, n) positive definite; force: (n,) smooth forces.
        limit_signs: (n - 6,) Jacobian of the joint limits, 1 at a lower and -1 at an upper limit.
        limit_stiffness: (n - 6,) zero where no limit is met; limit_reference: (n - 6,).
        rows: (m, n) of the contacts, in the order of `Limbs.contacts`.
        stiffness: (m,) zero where nothing touches; reference: (m,).
    """

    mass: Float[Array, "n n"]
    force: Float[Array, " n"]
    limit_signs: Float[Array, " joints"]
    limit_stiffness: Float[Array, " joints"]
    limit_reference: Float[Array, " joints"]
    rows: Float[Array, "m n"]
    stiffness: Float[Array, " m"]
    reference: Float[Array, " m"]


class ContactSolution(NamedTuple):
    """Attributes:
    acceleration: (n,).
    residual: () largest unbalanced force relative to the largest inertial or smooth force.
    iterations: () of Newton's method.
    """

    acceleration: Float[Array, " n"]
    residual: Float[Array, ""]
    iterations: Int[Array, ""]


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def solve_contact(
    limbs: Limbs, settings: ContactSettings, problem: ContactProblem, start: Float[Array, " n"]
) -> ContactSolution:
    """Solve from a first guess of the acceleration; differentiable in the problem in both modes.

    A problem with a non-finite number gives a non-finite acceleration and stops at once.
    """
    return ContactSolution(*minimise(limbs, settings.max_iterations, settings.tolerance)(*problem, start))


@solve_contact.defjvp
def _solve_contact_jvp(
    limbs: Limbs, settings: ContactSettings, primals: tuple, tangents: tuple
) -> tuple[ContactSolution, ContactSolution]:
    problem, start = primals
    solution = solve_contact(limbs, settings, problem, start)
    acceleration = solution.acceleration
    _, moved = jax.jvp(lambda p: unbalanced_force(p, acceleration), (problem,), (tangents[0],))
    rows, limits = pressing_rows(problem, acceleration)
    hessian = problem.mass + problem.rows.T @ (rows[:, None] * problem.rows)
    hessian = hessian + jnp.diag(jnp.pad(limits, (6, 0)))
    change = solve_symmetric(limbs, jax.lax.stop_gradient(hessian), moved)
    nothing = jnp.zeros(solution.iterations.shape, jax.dtypes.float0)
    return solution, ContactSolution(change, jnp.zeros_like(solution.residual), nothing)


def row_forces(problem: ContactProblem, acceleration: Float[Array, " n"]) -> Float[Array, " m"]:
    """Force of each contact row at an acceleration, not negative."""
    return problem.stiffness * jnp.maximum(problem.reference - problem.rows @ acceleration, 0)


def limit_forces(problem: ContactProblem, acceleration: Float[Array, " n"]) -> Float[Array, " joints"]:
    """Generalised force of each joint's limit at an acceleration."""
    missing = problem.limit_reference - problem.limit_signs * acceleration[6:]
    return problem.limit_signs * problem.limit_stiffness * jnp.maximum(missing, 0)


def unbalanced_force(problem: ContactProblem, acceleration: Float[Array, " n"]) -> Float[Array, " n"]:
    """Smooth and constraint forces less inertial ones; zero at the solution."""
    force = problem.force - problem.mass @ acceleration + problem.rows.T @ row_forces(problem, acceleration)
    return force + jnp.pad(limit_forces(problem, acceleration), (6, 0))


def pressing_rows(
    problem: ContactProblem, acceleration: Float[Array, " n"]
) -> tuple[Float[Array, " m"], Float[Array, " joints"]]:
    """Stiffness of the contact rows and of the limits that press at an acceleration, zero for the others."""
    rows = problem.stiffness * (problem.rows @ acceleration < problem.reference)
    limits = problem.limit_stiffness * (problem.limit_signs * acceleration[6:] < problem.limit_reference)
    return rows, limits

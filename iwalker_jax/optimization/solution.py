"""What every solver returns: a value, a status that explains itself, and how good the value is."""

from enum import IntEnum
from typing import Any, Literal, NamedTuple

from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.errors import InputError

GradientMode = Literal["implicit", "unrolled", "stopped"]
"""How a solver is differentiated: at the optimum (implicit function theorem), through its iterations, or not at all."""


class Status(IntEnum):
    """Outcome of a solve; `describe` turns one into a sentence."""

    CONVERGED = 0
    MAX_ITERATIONS = 1
    NON_FINITE = 2
    INFEASIBLE = 3
    UNBOUNDED = 4
    NOT_CONVEX = 5


_SENTENCES = {
    Status.CONVERGED: "Converged: the residual is below the tolerance.",
    Status.MAX_ITERATIONS: (
        "Stopped at the iteration limit before the residual reached the tolerance; "
        "raise max_iterations or loosen the tolerance, and do not trust the gradient."
    ),
    Status.NON_FINITE: (
        "The inputs or an iterate were not finite; the value is the last finite iterate. "
        "Check the inputs for NaN, infinities and extreme scales."
    ),
    Status.UNBOUNDED: (
        "The cost falls without limit along a direction that no constraint stops; the value is a point on the way. "
        "Add a small quadratic cost or the missing bounds."
    ),
    Status.NOT_CONVEX: (
        "The cost curves downwards in some direction; the value is no minimum. "
        "Check the sign of the weights, or add a multiple of the identity to P."
    ),
    Status.INFEASIBLE: ("No point satisfies all constraints; the value is the least violating one. Relax the bounds."),
}


def describe(status: int | Array) -> str:
    """Say in one sentence what a status means and what to do about it.

    Raises:
        InputError: for what is no `Status`.
    """
    try:
        return _SENTENCES[Status(int(status))]
    except (TypeError, ValueError) as error:
        raise InputError(f"{status!r:.40} is no status; give that of a Solution.") from error


class Solution(NamedTuple):
    """Value of a solve with the facts needed to trust it.

    Attributes:
        value: the solver's answer (a pytree; see the solver).
        status: () int32, a `Status`.
        residual: () optimality residual, normalised as the solver documents.
        iterations: () int32, iterations used.
        gradient_valid: () bool, whether implicit derivatives can be trusted: solved, the optimum unique, and no
            constraint about to become active or inactive.
        margin: () how far the optimum is from losing its derivatives, relative, as the solver documents; infinite
            where nothing can take them away, 0 where it is not measured.
    """

    value: Any
    status: Int[Array, ""]
    residual: Float[Array, ""]
    iterations: Int[Array, ""]
    gradient_valid: Bool[Array, ""]
    margin: Float[Array, ""]

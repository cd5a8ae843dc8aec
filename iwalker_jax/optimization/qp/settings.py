"""Settings of the quadratic-program solver."""

from dataclasses import dataclass
from typing import Literal, get_args

import jax.numpy as jnp

from iwalker_jax.errors import InputError

QpMethod = Literal["active_set", "admm"]
"""How a program is solved."""


@dataclass(frozen=True)
class QpSettings:
    """How long to search and when to be content; frozen and hashable, a static argument under jit.

    Attributes:
        method: `active_set` (dual active set, ADMM where it fails) or `admm` (OSQP: ADMM with an adapted penalty, each
            round polished by solving with the active set that it points to).
        rounds: searches for the active set; a failed one is followed by ADMM, whose point starts the next. With
            `admm`, rounds of its iterations, after each of which the penalty is adapted and the point polished.
        pivots: rows added or dropped in one search at most; None allows 5 (rows + 10). With `admm` those by which
            polishing corrects the active set, which is right but for a few rows that hardly press.
        refinements: most corrections of the point by the true residual after each search; all are made if there is
            but one round.
        admm_iterations: ADMM iterations after a failed search (of a round with `admm`), and all of them when
            derivatives are unrolled.
        relaxation: ADMM's over-relaxation, in (0, 2).
        tolerance: largest relative residual of a converged solve (see `solve_qp`); None takes 1e-4 in single and
            1e-8 in double precision.
        penalty: ADMM's first penalty in the metric of the cost, where 1 is natural; 1000 times it for equalities.
        well_posed: whether all programs are known to be strictly convex, with variables of similar sizes, and their
            redundant rows (which touch their bound and depend on the active ones) to be constants: then all errors
            count in the metric of the cost alone, and no time goes into scaling, into proving that a program is not
            convex, and into the derivatives by redundant rows.
    """

    method: QpMethod = "active_set"
    rounds: int = 20
    pivots: int | None = None
    refinements: int = 10
    admm_iterations: int = 100
    relaxation: float = 1.6
    tolerance: float | None = None
    penalty: float = 1.0
    well_posed: bool = False

    def __post_init__(self) -> None:
        if self.method not in get_args(QpMethod):
            raise InputError(f"QpSettings.method is {self.method!r}; choose one of {', '.join(get_args(QpMethod))}.")
        counts = {"rounds": self.rounds, "pivots": self.pivots or 1, "admm_iterations": self.admm_iterations}
        for name, value in counts.items():
            if value < 1:
                raise InputError(f"QpSettings.{name} is {value}; give at least 1.")
        if self.refinements < 0:
            raise InputError(f"QpSettings.refinements is {self.refinements}; give 0 or more.")
        if not 0 < self.relaxation < 2:
            raise InputError(f"QpSettings.relaxation is {self.relaxation}; ADMM converges only between 0 and 2.")
        for name, size in {"tolerance": self.tolerance, "penalty": self.penalty}.items():
            if size is not None and not size > 0:
                raise InputError(f"QpSettings.{name} is {size}; give a positive number.")

    def tolerance_for(self, dtype: jnp.dtype) -> float:
        """The tolerance, or the default of a precision."""
        return self.tolerance or (1e-4 if dtype == jnp.float32 else 1e-8)


def control_settings(method: QpMethod = "active_set") -> QpSettings:
    """A warm-started search and no second chance: for a control loop, whose next tick is the second chance.

    With `admm` as many short rounds as it takes, at most twelve: most ticks need one.

    Its programs are taken to be well posed: scaled by construction, and the friction cone of a foot in the air, of
    which all rows touch at once, a constant.
    """
    if method == "admm":
        return QpSettings(method, rounds=12, pivots=8, refinements=3, admm_iterations=25, well_posed=True)
    return QpSettings(method, rounds=1, pivots=60, refinements=1, well_posed=True)

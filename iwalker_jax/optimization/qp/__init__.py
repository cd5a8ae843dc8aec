"""Dense convex quadratic programs: problem, solver, derivatives."""

from iwalker_jax.optimization.qp.problem import QuadraticProgram, load_program, quadratic_program
from iwalker_jax.optimization.qp.settings import QpMethod, QpSettings, control_settings
from iwalker_jax.optimization.qp.solver import QpPoint, cold_start, explain, solve_qp

__all__ = [
    "QpMethod",
    "QpPoint",
    "QpSettings",
    "QuadraticProgram",
    "cold_start",
    "control_settings",
    "explain",
    "load_program",
    "quadratic_program",
    "solve_qp",
]

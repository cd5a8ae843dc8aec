"""The lower-level optimisations and their derivatives; knows no robot, no network and no sensor."""

from iwalker_jax.optimization.qp.problem import QuadraticProgram, load_program, quadratic_program
from iwalker_jax.optimization.qp.settings import QpSettings, control_settings
from iwalker_jax.optimization.qp.solver import QpPoint, cold_start, explain, solve_qp
from iwalker_jax.optimization.solution import GradientMode, Solution, Status, describe
from iwalker_jax.optimization.steps.hlip import HlipParameters
from iwalker_jax.optimization.steps.mpc import solve_step_mpc
from iwalker_jax.optimization.steps.mpc_bounded import solve_bounded_step_mpc
from iwalker_jax.optimization.steps.problem import StepMpcWeights, StepPlan
from iwalker_jax.optimization.steps.reach import StepReach
from iwalker_jax.optimization.unicycle.model import UnicycleParameters, UnicyclePlan, initial_state_from_reference
from iwalker_jax.optimization.unicycle.mpc import solve_unicycle

__all__ = [
    "GradientMode",
    "HlipParameters",
    "QpPoint",
    "QpSettings",
    "QuadraticProgram",
    "Solution",
    "Status",
    "StepMpcWeights",
    "StepPlan",
    "StepReach",
    "UnicycleParameters",
    "UnicyclePlan",
    "cold_start",
    "control_settings",
    "describe",
    "explain",
    "initial_state_from_reference",
    "load_program",
    "quadratic_program",
    "solve_bounded_step_mpc",
    "solve_qp",
    "solve_step_mpc",
    "solve_unicycle",
]

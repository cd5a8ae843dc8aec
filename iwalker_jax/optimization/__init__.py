"""The lower-level optimisations and their derivatives; knows no robot, no network and no sensor."""

from iwalker_jax.optimization.hlip import HlipParameters
from iwalker_jax.optimization.solution import GradientMode, Solution, Status, describe
from iwalker_jax.optimization.step_mpc import solve_step_mpc
from iwalker_jax.optimization.step_mpc_bounded import solve_bounded_step_mpc
from iwalker_jax.optimization.step_problem import StepMpcWeights, StepPlan
from iwalker_jax.optimization.step_reach import StepReach
from iwalker_jax.optimization.unicycle import UnicycleParameters, UnicyclePlan, initial_state_from_reference
from iwalker_jax.optimization.unicycle_mpc import solve_unicycle

__all__ = [
    "GradientMode",
    "HlipParameters",
    "Solution",
    "Status",
    "StepMpcWeights",
    "StepPlan",
    "StepReach",
    "UnicycleParameters",
    "UnicyclePlan",
    "describe",
    "initial_state_from_reference",
    "solve_bounded_step_mpc",
    "solve_step_mpc",
    "solve_unicycle",
]

"""H-LIP and its step MPCs: which footsteps are dynamically feasible."""

from iwalker_jax.optimization.steps.hlip import (
    HlipParameters,
    Modes,
    deadbeat_gain,
    divergent_component,
    lqr_gain,
    modes,
    orbit_p1,
    orbit_p2,
    pendulum_flow,
    step_matrices,
)
from iwalker_jax.optimization.steps.mpc import solve_step_mpc
from iwalker_jax.optimization.steps.mpc_bounded import solve_bounded_step_mpc
from iwalker_jax.optimization.steps.problem import StepMpcWeights, StepPlan
from iwalker_jax.optimization.steps.reach import StepReach, step_bounds

__all__ = [
    "HlipParameters",
    "Modes",
    "StepMpcWeights",
    "StepPlan",
    "StepReach",
    "deadbeat_gain",
    "divergent_component",
    "lqr_gain",
    "modes",
    "orbit_p1",
    "orbit_p2",
    "pendulum_flow",
    "solve_bounded_step_mpc",
    "solve_step_mpc",
    "step_bounds",
    "step_matrices",
]

"""iPath, iStepper, and the geometry of paths and footsteps."""

from iwalker_jax.planning.ipath import IPathConfig
from iwalker_jax.planning.istepper import IStepperConfig
from iwalker_jax.planning.models import PlannerModels
from iwalker_jax.planning.planner import Plan, Planner, PlannerConfig
from iwalker_jax.planning.robot_state import RobotState, StepGeometry

__all__ = [
    "IPathConfig",
    "IStepperConfig",
    "Plan",
    "Planner",
    "PlannerConfig",
    "PlannerModels",
    "RobotState",
    "StepGeometry",
]

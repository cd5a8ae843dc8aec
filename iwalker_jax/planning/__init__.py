"""Depth image and goal to path and footsteps: iPath, iStepper, and the planner that chains them."""

from iwalker_jax.planning.footsteps import PathProgress, closest_on_path, nominal_footsteps
from iwalker_jax.planning.goal_scan import GoalScan
from iwalker_jax.planning.ipath import IPath, IPathConfig, reduced_goal
from iwalker_jax.planning.istepper import IStepper, IStepperConfig
from iwalker_jax.planning.map_view import MapCell, MapView, MapViewParameters
from iwalker_jax.planning.memory_ipath import (
    MemoryIPath,
    MemoryIPathConfig,
    PathCandidates,
    choose_path,
    start_direction,
)
from iwalker_jax.planning.models import PlannerModels
from iwalker_jax.planning.planner import PATH_POINTS, Plan, Planner, PlannerConfig, waypoints_to_path
from iwalker_jax.planning.robot_state import (
    RobotState,
    StepGeometry,
    next_foot,
    pre_impact_planes,
    sample_robot_state,
    standing_state,
)
from iwalker_jax.planning.split_module import SplitModule, split_module

__all__ = [
    "PATH_POINTS",
    "GoalScan",
    "IPath",
    "IPathConfig",
    "IStepper",
    "IStepperConfig",
    "MapCell",
    "MapView",
    "MapViewParameters",
    "MemoryIPath",
    "MemoryIPathConfig",
    "PathCandidates",
    "PathProgress",
    "Plan",
    "Planner",
    "PlannerConfig",
    "PlannerModels",
    "RobotState",
    "SplitModule",
    "StepGeometry",
    "choose_path",
    "closest_on_path",
    "next_foot",
    "nominal_footsteps",
    "pre_impact_planes",
    "reduced_goal",
    "sample_robot_state",
    "split_module",
    "standing_state",
    "start_direction",
    "waypoints_to_path",
]

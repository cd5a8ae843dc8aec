"""iwalker-jax: a humanoid's sense-plan-act loop in differentiable JAX.

``import iwalker_jax as iw`` is cheap and has no side effects: a name below is imported from its room when it is first
asked for, so that `configure_runtime` can come before JAX does. The rooms hold the rest, for example
``from iwalker_jax.optimization import StepReach``.
"""

from typing import TYPE_CHECKING

from iwalker_jax.lazy_names import lazy_names
from iwalker_jax.version import __version__ as __version__

if TYPE_CHECKING:
    from iwalker_jax.api import EpisodesResult, WalkResult, load_planner, run_episodes, walk
    from iwalker_jax.errors import CheckpointError, InputError
    from iwalker_jax.evaluation.frames import draw_plan
    from iwalker_jax.humanoids import RobotDescription, load_robot
    from iwalker_jax.navigation import Outcome
    from iwalker_jax.optimization import (
        GradientMode,
        HlipParameters,
        QuadraticProgram,
        Solution,
        Status,
        StepMpcWeights,
        UnicycleParameters,
        describe,
        explain,
        initial_state_from_reference,
        quadratic_program,
        solve_bounded_step_mpc,
        solve_qp,
        solve_step_mpc,
        solve_unicycle,
    )
    from iwalker_jax.perception import (
        CameraMount,
        GridSpec,
        Intrinsics,
        SoftOccupancy,
        build_local_map,
        cost_to_go,
        read_depth,
        signed_distance_field,
        write_depth,
    )
    from iwalker_jax.planning import Plan, Planner, RobotState
    from iwalker_jax.runtime import configure_runtime
    from iwalker_jax.tasks import Task
    from iwalker_jax.walking import Disturbances, Motion

__all__ = [
    "CameraMount",
    "CheckpointError",
    "Disturbances",
    "EpisodesResult",
    "GradientMode",
    "GridSpec",
    "HlipParameters",
    "InputError",
    "Intrinsics",
    "Motion",
    "Outcome",
    "Plan",
    "Planner",
    "QuadraticProgram",
    "RobotDescription",
    "RobotState",
    "SoftOccupancy",
    "Solution",
    "Status",
    "StepMpcWeights",
    "Task",
    "UnicycleParameters",
    "WalkResult",
    "build_local_map",
    "configure_runtime",
    "cost_to_go",
    "describe",
    "draw_plan",
    "explain",
    "initial_state_from_reference",
    "load_planner",
    "load_robot",
    "quadratic_program",
    "read_depth",
    "run_episodes",
    "signed_distance_field",
    "solve_bounded_step_mpc",
    "solve_qp",
    "solve_step_mpc",
    "solve_unicycle",
    "walk",
    "write_depth",
]

_HOMES = {
    "api": "EpisodesResult WalkResult load_planner run_episodes walk",
    "errors": "CheckpointError InputError",
    "evaluation.frames": "draw_plan",
    "humanoids": "RobotDescription load_robot",
    "navigation": "Outcome",
    "optimization": (
        "GradientMode HlipParameters QuadraticProgram Solution Status StepMpcWeights UnicycleParameters "
        "describe explain initial_state_from_reference quadratic_program solve_bounded_step_mpc solve_qp "
        "solve_step_mpc solve_unicycle"
    ),
    "perception": (
        "CameraMount GridSpec Intrinsics SoftOccupancy build_local_map cost_to_go read_depth signed_distance_field "
        "write_depth"
    ),
    "planning": "Plan Planner RobotState",
    "runtime": "configure_runtime",
    "tasks": "Task",
    "walking": "Disturbances Motion",
}
"""Where the names are at home; the imports above tell type checkers the same."""

__getattr__, __dir__ = lazy_names(__name__, _HOMES)

"""From footsteps to joint torques: gait clock, stepping feedback, swing trajectory, tasks and the whole-body QP."""

from iwalker_jax.control.controller import (
    ControlInfo,
    Controller,
    ControllerState,
    WholeBodySolution,
    control_step,
    initial_controller,
    make_controller,
    posture_of,
    solve_whole_body,
)
from iwalker_jax.control.footstep_check import (
    check_footsteps,
    load_footsteps,
)
from iwalker_jax.control.footstep_plan import (
    FootstepPlan,
    footsteps_along,
    make_plan,
    ramp_shares,
    velocity_footsteps,
)
from iwalker_jax.control.gait import (
    advance_gait,
    initial_gait,
)
from iwalker_jax.control.gait_state import (
    GaitMode,
    GaitReference,
    GaitState,
    Posture,
)
from iwalker_jax.control.parameters import (
    GaitParameters,
    LegEffect,
    WholeBodyParameters,
)
from iwalker_jax.control.stepping import (
    StepChoice,
    SteppingGains,
    choose_step,
    stepping_gains,
)
from iwalker_jax.control.swing import (
    TrajectoryPoint,
    advance_towards,
    rise_and_fall,
)

__all__ = [
    "ControlInfo",
    "Controller",
    "ControllerState",
    "FootstepPlan",
    "GaitMode",
    "GaitParameters",
    "GaitReference",
    "GaitState",
    "LegEffect",
    "Posture",
    "StepChoice",
    "SteppingGains",
    "TrajectoryPoint",
    "WholeBodyParameters",
    "WholeBodySolution",
    "advance_gait",
    "advance_towards",
    "check_footsteps",
    "choose_step",
    "control_step",
    "footsteps_along",
    "initial_controller",
    "initial_gait",
    "load_footsteps",
    "make_controller",
    "make_plan",
    "posture_of",
    "ramp_shares",
    "rise_and_fall",
    "solve_whole_body",
    "stepping_gains",
    "velocity_footsteps",
]

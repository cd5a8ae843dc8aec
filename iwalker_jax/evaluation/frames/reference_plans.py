"""Plans that need no network and that a trained planner must beat: standing still, and straight at the goal."""

from dataclasses import dataclass
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.errors import InputError
from iwalker_jax.planning import (
    Plan,
    PlannerConfig,
    RobotState,
    next_foot,
    nominal_footsteps,
    reduced_goal,
    waypoints_to_path,
)

ReferenceName = Literal["stand still", "straight line"]
REFERENCE_NAMES: tuple[ReferenceName, ...] = ("stand still", "straight line")
"""Names of the plans without a planner that a table shows beside the planners'."""

_AT_REST = 1e-4
"""[m] length of the path of a robot that stands still: its tangent says where the robot looks."""


@jax.tree_util.register_static
@dataclass(frozen=True)
class ReferencePlanner:
    """Plans by a rule, with footsteps at their nominal places beside the path.

    Attributes:
        name: `stand still`, or `straight line` to the goal as far as iPath reaches, through whatever is in the way.
        config: number of waypoints, reach, and foot placement.
    """

    name: ReferenceName
    config: PlannerConfig

    def __post_init__(self) -> None:
        if self.name not in REFERENCE_NAMES:
            raise InputError(f"Unknown reference {self.name!r}; choose one of {', '.join(REFERENCE_NAMES)}.")

    def __call__(self, goals: Float[Array, "n 2"], state: RobotState) -> Plan:
        """Plans towards goals [m], base frame, for robots in the given states."""
        ipath = self.config.ipath
        ends = reduced_goal(goals, ipath.goal_reach)
        if self.name == "stand still":
            ends = jnp.zeros_like(ends).at[:, 0].set(_AT_REST)
        share = jnp.arange(1, ipath.waypoints + 1) / ipath.waypoints
        waypoints = share[:, None] * ends[:, None, :]
        path = waypoints_to_path(waypoints)
        place = jax.vmap(lambda p, sign: nominal_footsteps(p, sign, self.config.steps)[0])
        return Plan(path, waypoints, jnp.zeros(len(ends)), place(path, state.stance_sign), next_foot(state))

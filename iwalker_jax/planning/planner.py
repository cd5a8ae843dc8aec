"""The planner: iPath and iStepper chained, depth image to footsteps, as one pure function of its parameters."""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Float

from iwalker_jax.errors import InputError
from iwalker_jax.geometry.splines import hermite_path
from iwalker_jax.planning.ipath import IPath, IPathConfig
from iwalker_jax.planning.istepper import IStepper, IStepperConfig
from iwalker_jax.planning.robot_state import RobotState, StepGeometry

PATH_POINTS = 100
"""Points of a path, as published: the unicycle's horizon."""


@dataclass(frozen=True)
class PlannerConfig:
    """Sizes of both networks and the foot placement they are made for."""

    ipath: IPathConfig = IPathConfig()
    istepper: IStepperConfig = IStepperConfig()
    steps: StepGeometry = StepGeometry()


class Plan(NamedTuple):
    """What the planner says for a batch of frames.

    Attributes:
        path: (batch, 100, 2) [m] base frame, from the origin, uniform in the spline's parameter.
        waypoints: (batch, k, 2) [m] the spline's knots after the origin.
        fear: (batch,) logit of the path meeting an obstacle.
        footsteps: (batch, m, 2) [m] the next footsteps; `footstep_sides` says which are left.
    """

    path: Float[Array, "batch n 2"]
    waypoints: Float[Array, "batch k 2"]
    fear: Float[Array, " batch"]
    footsteps: Float[Array, "batch m 2"]


class Planner(nnx.Module):
    """iPath followed by iStepper."""

    def __init__(self, config: PlannerConfig, rngs: nnx.Rngs):
        self.config = config
        self.ipath = IPath(config.ipath, rngs)
        self.istepper = IStepper(config.istepper, config.steps, rngs)

    def __call__(
        self,
        depth: Float[Array, "batch h w"],
        goal: Float[Array, "batch 2"],
        state: RobotState,
        mount: Float[Array, "batch 5"] | None = None,
    ) -> Plan:
        """Plan for a batch of depth images [m] (0 = no return), goals [m] in base, robot states and camera mounts."""
        path, waypoints, fear = self.plan_path(depth, goal, mount)
        return Plan(path, waypoints, fear, self.istepper(path, state))

    def plan_path(
        self,
        depth: Float[Array, "batch h w"],
        goal: Float[Array, "batch 2"],
        mount: Float[Array, "batch 5"] | None = None,
    ) -> tuple[Float[Array, "batch n 2"], Float[Array, "batch k 2"], Float[Array, " batch"]]:
        """Path [m], waypoints [m] and fear logit: iPath alone, for the faster of the two loops.

        Raises:
            InputError: for depth that is not floating-point metres of the configured size, or other batch sizes.
        """
        _check(depth, goal, mount, self.config.ipath)
        waypoints, fear = self.ipath(depth, goal, mount)
        return waypoints_to_path(waypoints), waypoints, fear


def _check(depth: Array, goal: Array, mount: Array | None, config: IPathConfig) -> None:
    if not jnp.issubdtype(depth.dtype, jnp.floating):
        raise InputError(
            f"The planner takes depth in floating-point metres, got {depth.dtype}; convert raw sensor units with "
            "depth_from_uint16."
        )
    if depth.ndim != 3 or depth.shape[1:] != (config.height, config.width):
        raise InputError(
            f"The planner takes depth of shape (batch, {config.height}, {config.width}), got {depth.shape}; resize "
            "with resize_depth, and give a single image a batch axis."
        )
    for name, value, size in (("goals", goal, 2), ("mounts", mount, 5)):
        if value is not None and value.shape != (depth.shape[0], size):
            raise InputError(
                f"{depth.shape[0]} depth images need {name} of shape ({depth.shape[0]}, {size}), got {value.shape}."
            )


def waypoints_to_path(waypoints: Float[Array, "batch k 2"], points: int = PATH_POINTS) -> Float[Array, "batch n 2"]:
    """Hermite path [m] from the origin through the waypoints [m]."""
    origin = jnp.zeros_like(waypoints[:, :1])
    return hermite_path(jnp.concatenate([origin, waypoints], axis=1), points)

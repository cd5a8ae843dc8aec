"""The planner: iPath and iStepper chained, depth image to footsteps, as one pure function of its parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from iwalker_jax.arrays import as_floats, as_numbers, is_known
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import hermite_path
from iwalker_jax.optimization import HlipParameters, StepMpcWeights
from iwalker_jax.perception import CameraMount, check_depth_image, clean_depth
from iwalker_jax.planning.ipath import IPath, IPathConfig
from iwalker_jax.planning.istepper import IStepper, IStepperConfig
from iwalker_jax.planning.robot_state import RobotState, StepGeometry, next_foot, standing_state
from iwalker_jax.planning.split_module import SplitModule, split_module

Numbers = ArrayLike | Sequence
"""A JAX or NumPy array, or a list of numbers."""

PATH_POINTS = 100
"""Points of a path, as published: the unicycle's horizon."""


@dataclass(frozen=True)
class PlannerConfig:
    """Sizes of both networks and what they are made for; who uses a planner takes these numbers from it.

    Attributes:
        ipath: iPath's size, and the camera whose images it sees.
        istepper: iStepper's size.
        steps: foot placement.
        hlip: pendulum whose robot states iStepper sees; its single-support time is the step time of the walk.
        step_weights: of the step MPC on that pendulum, which teaches iStepper and keeps the walk on its footsteps.
    """

    ipath: IPathConfig = IPathConfig()
    istepper: IStepperConfig = IStepperConfig()
    steps: StepGeometry = StepGeometry()
    hlip: HlipParameters = HlipParameters()
    step_weights: StepMpcWeights = StepMpcWeights()

    @property
    def tracking_pendulum(self) -> HlipParameters:
        """Pendulum of the step MPC on the predicted footsteps: `hlip`, unless no weight holds its COM.

        The footsteps are then the same for every pendulum. A slow one keeps the COM, which runs away by the pole's
        power of the number of steps, within single precision.
        """
        return self.hlip if self.step_weights.hold_com else _SLOW_PENDULUM


_SLOW_PENDULUM = HlipParameters(com_height=10.0, single_support_time=0.01)
"""Its pole is 1.01 a step; 3.8 of BRUCE's, to the power of 150, is no number of single precision."""


class Plan(NamedTuple):
    """What the planner says; without the batch axis for a single frame.

    Attributes:
        path: (batch, 100, 2) [m] base frame, from the origin, uniform in the spline's parameter.
        waypoints: (batch, k, 2) [m] the spline's knots after the origin.
        fear: (batch,) logit of the path meeting an obstacle.
        footsteps: (batch, m, 2) [m] the next footsteps, right and left in turn.
        first_swing: (batch,) int32, the foot that makes the first footstep, a `Side`: 0 right, 1 left.
    """

    path: Float[Array, "*batch n 2"]
    waypoints: Float[Array, "*batch k 2"]
    fear: Float[Array, "*batch"]
    footsteps: Float[Array, "*batch m 2"]
    first_swing: Int[Array, "*batch"]


class Planner(nnx.Module):
    """iPath followed by iStepper."""

    def __init__(self, config: PlannerConfig, rngs: nnx.Rngs) -> None:
        self.config = config
        self.ipath = IPath(config.ipath, rngs)
        self.istepper = IStepper(config.istepper, config.steps, rngs)

    def __call__(
        self,
        depth: Numbers,
        goal: Numbers,
        state: RobotState | None = None,
        mount: CameraMount | Numbers | None = None,
    ) -> Plan:
        """Plan for one depth image, or for a batch of them: `plan = planner(depth, goal)`.

        JAX and NumPy arrays and lists do. A single frame is compiled at the first call; batches are for the caller to
        compile. Both are pure functions that `jit`, `vmap` and `grad` take.

        Args:
            depth: (h, w) or (batch, h, w) z-depth [m] of the configured size; 0, negative, NaN and inf: no return.
            goal: (2,) or (batch, 2) [m] in the base frame (x forward, y left), at any distance.
            state: of the robot or robots; one that stands still, left foot first, if left out.
            mount: a `CameraMount`, or (5,) or (batch, 5) of them as arrays; the configured nominal mount if left out.

        Returns:
            The plan, with a batch axis if the depth had one.

        Raises:
            InputError: for shapes that do not fit each other or the configuration, and depth that is not
                floating-point metres; millimetres and degrees are recognised in a single frame outside `jit`.
        """
        depth, goal = as_numbers(depth, "The depth image"), as_floats(goal, "The goal")
        _check_dimensions(depth, (2, 3), self.config.ipath)
        batch = depth.shape[:-2]
        mount = self.config.ipath.mount if mount is None else mount
        if isinstance(mount, CameraMount):
            mounts = jnp.broadcast_to(mount.as_array(), (*batch, 5))
        else:
            mounts = as_floats(mount, "The mount")
        if state is None:
            standing = standing_state(self.config.steps)
            state = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (*batch, *leaf.shape)), standing)
        if not isinstance(state, RobotState):
            raise InputError(f"The robot's state is a {type(state).__name__}; give a RobotState.")
        state = RobotState(*(as_floats(leaf, f"RobotState.{name}") for name, leaf in state._asdict().items()))
        _check_state(state, batch)
        if batch:
            path, waypoints, fear = self.plan_path(depth, goal, mounts)
            return Plan(path, waypoints, fear, self.istepper(path, state), next_foot(state))
        _check(depth, goal, mounts, self.config.ipath)
        _check_values(depth, mounts, state)
        return _plan_frame(split_module(self), depth, goal, state, mounts)

    def plan_path(
        self,
        depth: Float[Array, "batch h w"],
        goal: Float[Array, "batch 2"],
        mount: Float[Array, "batch 5"] | None = None,
        cleaned: bool = False,
    ) -> tuple[Float[Array, "batch n 2"], Float[Array, "batch k 2"], Float[Array, " batch"]]:
        """Path [m], waypoints [m] and fear logit of a batch: iPath alone, for the faster of the two loops.

        Args:
            depth: z-depth [m]; 0, negative, NaN and inf: no return.
            goal: [m] in the base frame, at any distance.
            mount: camera mounts as in `CameraMount`; the configured nominal mount if left out.
            cleaned: the images have been through `clean_depth` already.

        Raises:
            InputError: for depth that is not floating-point metres of the configured size, or other batch sizes.
        """
        _check_dimensions(depth, (3,), self.config.ipath)
        _check(depth, goal, mount, self.config.ipath)
        waypoints, fear = self.ipath(depth if cleaned else jax.vmap(clean_depth)(depth), goal, mount)
        return waypoints_to_path(waypoints), waypoints, fear


@jax.jit
def _plan_frame(
    network: SplitModule[Planner],
    depth: Float[Array, "h w"],
    goal: Float[Array, " 2"],
    state: RobotState,
    mount: Float[Array, " 5"],
) -> Plan:
    """The plan for a batch of one, without its axis."""
    rows = jax.tree.map(lambda leaf: leaf[None], (depth, goal, state, mount))
    return jax.tree.map(lambda leaf: leaf[0], network.merge()(*rows))


def _check_dimensions(depth: Array, allowed: tuple[int, ...], config: IPathConfig) -> None:
    if depth.ndim not in allowed:
        size = f"{config.camera.height}, {config.camera.width}"
        shapes = {2: f"({size})", 3: f"(batch, {size})"}
        wanted = " or ".join(shapes[count] for count in allowed)
        raise InputError(f"The planner takes depth of shape {wanted} here, got {depth.shape}.")


def _check_state(state: RobotState, batch: tuple[int, ...]) -> None:
    for name, leaf, own in zip(state._fields, state, ((2,), (2,), (), ()), strict=True):
        if leaf.shape != (*batch, *own):
            raise InputError(f"RobotState.{name} has shape {leaf.shape}; these depth images need {(*batch, *own)}.")


def _check_values(depth: Array, mount: Array, state: RobotState) -> None:
    """Refuse a single frame in millimetres, a mount in degrees and a state that is not finite; under a trace there are
    no values to look at."""
    if is_known(depth):
        check_depth_image(np.asarray(depth))
    if is_known(mount):
        CameraMount(*np.asarray(mount).tolist())
    if is_known(state) and not all(np.isfinite(leaf).all() for leaf in state):
        raise InputError("The robot's state holds NaN or infinity; give finite numbers.")


def _check(depth: Array, goal: Array, mount: Array | None, config: IPathConfig) -> None:
    if not jnp.issubdtype(depth.dtype, jnp.floating):
        raise InputError(
            f"The planner takes depth in floating-point metres, got {depth.dtype}; convert raw sensor units with "
            "depth_from_uint16."
        )
    *batch, height, width = depth.shape
    camera = config.camera
    if (height, width) != (camera.height, camera.width):
        raise InputError(
            f"The planner takes depth images of {camera.height} x {camera.width} px, got {height} x {width} px; bring "
            "them to that size with resize_depth."
        )
    for name, value, size in (("goal", goal, 2), ("mount", mount, 5)):
        if value is not None and value.shape != (*batch, size):
            raise InputError(
                f"The {name} for depth of shape {depth.shape} must have shape {(*batch, size)}, got {value.shape}."
            )


def waypoints_to_path(waypoints: Float[Array, "batch k 2"], points: int = PATH_POINTS) -> Float[Array, "batch n 2"]:
    """Hermite path [m] from the origin through the waypoints [m]."""
    origin = jnp.zeros_like(waypoints[:, :1])
    return hermite_path(jnp.concatenate([origin, waypoints], axis=1), points)

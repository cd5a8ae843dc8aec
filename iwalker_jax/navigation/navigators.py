"""The robot that finds its way, and ways to compare: the networks as published, with lower levels online, a classical
planner."""

from dataclasses import dataclass, field
from typing import NamedTuple

import jax

from iwalker_jax.control import GaitParameters
from iwalker_jax.errors import InputError
from iwalker_jax.navigation.body_volume import BodyVolume, load_body_volume
from iwalker_jax.navigation.camera import RobotCamera, load_camera
from iwalker_jax.navigation.camera_health import HealthParameters
from iwalker_jax.navigation.guide import GuidanceParameters
from iwalker_jax.navigation.memory import SCAN_MEMORY
from iwalker_jax.navigation.step_planning import PursuitParameters
from iwalker_jax.perception import Intrinsics
from iwalker_jax.planning import MemoryIPath, Planner, SplitModule, split_module
from iwalker_jax.scenes import DepthNoise
from iwalker_jax.walking import Sensors, Walker, default_walker


@dataclass(frozen=True)
class LoopParameters:
    """Clocks and ends of an episode.

    Attributes:
        ticks_per_check: control ticks from one check whether new footsteps are due to the next.
        checks_per_frame: such checks in a camera frame.
        latency_frames: camera frames from taking an image to planning on it, and on the pose at which it was taken.
        arrival_distance: [m] from which a goal counts as reached.
        progress_distance: [m] of displacement that counts as progress.
        progress_timeout: [s] without progress after which the robot gives up.
        route_timeout: [s] without any route on the map after which it does.
    """

    ticks_per_check: int = 11
    checks_per_frame: int = 3
    latency_frames: int = 0
    arrival_distance: float = 0.30
    progress_distance: float = 0.30
    progress_timeout: float = 15.0
    route_timeout: float = 4.0

    def __post_init__(self) -> None:
        if self.ticks_per_check < 1 or self.checks_per_frame < 1:
            raise InputError("LoopParameters needs at least one tick per check and one check per frame.")
        if self.latency_frames < 0:
            raise InputError("LoopParameters needs a latency of 0 or more camera frames.")
        if not min(self.arrival_distance, self.progress_distance, self.progress_timeout, self.route_timeout) > 0:
            raise InputError("LoopParameters needs positive distances [m] and times [s].")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Navigator:
    """A robot with everything that makes it find its way.

    Attributes:
        walker: the walking robot.
        camera: fixed to the robot.
        volume: of the robot's body, for its clearance.
        planner: the networks.
        memory_ipath: the network of paths from memory; None without one.
        guidance: how paths come about.
        pursuit: how footsteps do; None takes the networks' output as it is.
        noise: of the depth camera; None for ideal depth.
        intrinsics: of its images.
        loop: clocks and ends of an episode.
        health: when the camera counts as failed.
    """

    walker: Walker
    camera: RobotCamera
    volume: BodyVolume
    planner: SplitModule[Planner]
    memory_ipath: SplitModule[MemoryIPath] | None = None
    guidance: GuidanceParameters = field(metadata={"static": True}, default=GuidanceParameters())
    pursuit: PursuitParameters | None = field(metadata={"static": True}, default=PursuitParameters())
    noise: DepthNoise | None = field(metadata={"static": True}, default=DepthNoise())
    intrinsics: Intrinsics = field(metadata={"static": True}, default=Intrinsics())
    loop: LoopParameters = field(metadata={"static": True}, default=LoopParameters())
    health: HealthParameters = field(metadata={"static": True}, default=HealthParameters())

    @property
    def frame_time(self) -> float:
        """[s] between two camera frames."""
        return self.loop.ticks_per_check * self.loop.checks_per_frame * self.walker.controller.time_step


class NavigationPolicy(NamedTuple):
    """A way of navigating.

    Attributes:
        guidance: how paths come about.
        pursuit: how footsteps do; None takes the networks' output as it is.
        feedback: whether the step MPC corrects the footsteps online.
    """

    guidance: GuidanceParameters
    pursuit: PursuitParameters | None
    feedback: bool


POLICIES = {
    "default": NavigationPolicy(GuidanceParameters(), PursuitParameters(), True),
    "networks": NavigationPolicy(GuidanceParameters(source="network"), PursuitParameters(), True),
    "published": NavigationPolicy(GuidanceParameters(source="network"), None, False),
    "memory": NavigationPolicy(GuidanceParameters(source="memory", memory=SCAN_MEMORY), PursuitParameters(), True),
    "classical": NavigationPolicy(GuidanceParameters(source="route"), PursuitParameters(), True),
}
"""default: iPath's path to the next way point of the remembered route, drawn off the obstacles; iStepper on a line that
the robot can turn along; the step MPC online. networks: iPath and iStepper alone choose the way, on such a line too;
the step MPC keeps the balance. memory: the same, with the iPath that reads the remembered map. published: iPath and
iStepper with nothing besides, the path as it is. classical: the route instead of iPath's path."""


def make_navigator(
    policy: str,
    planner: Planner,
    sensors: Sensors = "nominal",
    depth_noise: bool = True,
    loop: LoopParameters = LoopParameters(),
    memory_ipath: MemoryIPath | None = None,
) -> Navigator:
    """BRUCE with a policy of `POLICIES`.

    Args:
        policy: name of one.
        planner: trained networks; the classical policy uses their iStepper alone. Camera, foot placement, step time
            and step MPC are those that they were trained with.
        sensors: `none` walks on the true state, the others on the estimate.
        depth_noise: whether the camera is as noisy as a real one.
        loop: clocks and ends of an episode.
        memory_ipath: the trained network of the policy `memory`.

    Raises:
        InputError: for an unknown policy, or one whose network is missing.
    """
    if not isinstance(policy, str) or policy not in POLICIES:
        raise InputError(f"Unknown policy {policy!r}; choose one of {', '.join(POLICIES)}.")
    guidance, pursuit, feedback = POLICIES[policy]
    if guidance.source == "memory" and memory_ipath is None:
        raise InputError(f"The policy {policy} needs a MemoryIPath; give `memory_ipath=`, see load_memory_ipath.")
    gait = GaitParameters(hlip=planner.config.hlip, mpc=planner.config.step_weights, feedback=feedback)
    walker, model = default_walker(sensors, gait)
    return Navigator(
        walker=walker,
        camera=load_camera(model),
        volume=load_body_volume(model),
        planner=split_module(planner),
        memory_ipath=None if memory_ipath is None else split_module(memory_ipath),
        guidance=guidance,
        pursuit=pursuit,
        noise=DepthNoise() if depth_noise else None,
        intrinsics=planner.config.ipath.camera,
        loop=loop,
    )

"""Navigators to compare: the networks as published, the networks with lower levels online, the classical planner."""

from typing import NamedTuple

from iwalker_jax.control import GaitParameters
from iwalker_jax.errors import InputError
from iwalker_jax.navigation.body_volume import load_body_volume
from iwalker_jax.navigation.camera import load_camera
from iwalker_jax.navigation.closed_loop import LoopParameters, Navigator
from iwalker_jax.navigation.guide import GuidanceParameters
from iwalker_jax.navigation.step_planning import PursuitParameters
from iwalker_jax.planning import Planner, split_module
from iwalker_jax.scenes import DepthNoise
from iwalker_jax.walking import Sensors, default_walker


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
    "classical": NavigationPolicy(GuidanceParameters(source="route"), PursuitParameters(), True),
}
"""default: iPath's path to the next way point of the remembered route, drawn off the obstacles; iStepper on a line that
the robot can turn along; the step MPC online. networks: iPath and iStepper alone choose the way, on such a line too;
the step MPC keeps the balance. published: not even that, and the path as it is. classical: the route instead of iPath's
path."""


def make_navigator(
    policy: str,
    planner: Planner,
    sensors: Sensors = "nominal",
    depth_noise: bool = True,
    loop: LoopParameters = LoopParameters(),
) -> Navigator:
    """BRUCE with a policy of `POLICIES`.

    Args:
        policy: name of one.
        planner: trained networks; the classical policy uses their iStepper alone. Camera, foot placement, step time
            and step MPC are those that they were trained with.
        sensors: `none` walks on the true state, the others on the estimate.
        depth_noise: whether the camera is as noisy as a real one.
        loop: clocks and ends of an episode.

    Raises:
        InputError: for an unknown policy.
    """
    if not isinstance(policy, str) or policy not in POLICIES:
        raise InputError(f"Unknown policy {policy!r}; choose one of {', '.join(POLICIES)}.")
    guidance, pursuit, feedback = POLICIES[policy]
    gait = GaitParameters(hlip=planner.config.hlip, mpc=planner.config.step_weights, feedback=feedback)
    walker, model = default_walker(sensors, gait)
    return Navigator(
        walker=walker,
        camera=load_camera(model),
        volume=load_body_volume(model),
        planner=split_module(planner),
        guidance=guidance,
        pursuit=pursuit,
        noise=DepthNoise() if depth_noise else None,
        intrinsics=planner.config.ipath.camera,
        loop=loop,
    )

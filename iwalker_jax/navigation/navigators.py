"""Navigators to compare: the networks as published, the networks with lower levels online, the classical planner."""

import dataclasses
import math
from typing import Any, NamedTuple

import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Float

from iwalker_jax.control.parameters import GaitParameters
from iwalker_jax.errors import InputError
from iwalker_jax.navigation.camera import load_camera
from iwalker_jax.navigation.closed_loop import LoopRules, Navigator
from iwalker_jax.navigation.guide import GuideRules
from iwalker_jax.navigation.step_planning import PursuitRules
from iwalker_jax.navigation.task import TaskArrays
from iwalker_jax.planning.planner import Planner
from iwalker_jax.simulation.body_volume import load_body_volume
from iwalker_jax.simulation.depth_noise import DepthNoise
from iwalker_jax.simulation.walk_setup import Sensors, default_walker
from iwalker_jax.simulation.walking import Conditions


class Policy(NamedTuple):
    """A way of navigating.

    Attributes:
        guidance: how paths come about.
        pursuit: how footsteps do; None takes the networks' output as it is.
        feedback: whether the step MPC corrects the footsteps online.
    """

    guidance: GuideRules
    pursuit: PursuitRules | None
    feedback: bool


POLICIES = {
    "default": Policy(GuideRules(), PursuitRules(), True),
    "networks": Policy(GuideRules(source="network", band=False), None, True),
    "published": Policy(GuideRules(source="network", band=False), None, False),
    "classical": Policy(GuideRules(source="route"), PursuitRules(), True),
}
"""default: iPath's path to the next way point of the remembered route, drawn off the obstacles; iStepper on a line that
the robot can turn along; the step MPC online. networks: iPath and iStepper alone choose the way, the step MPC keeps the
balance. published: not even that. classical: the route instead of iPath's path."""


def make_navigator(
    policy: str,
    planner: Planner,
    sensors: Sensors = "nominal",
    depth_noise: bool = True,
    loop: LoopRules = LoopRules(),
) -> Navigator:
    """BRUCE with a policy of `POLICIES`.

    Args:
        planner: trained networks; the classical policy uses their iStepper alone.
        sensors: `none` walks on the true state, the others on the estimate.
        depth_noise: whether the camera is as noisy as a real one.

    Raises:
        InputError: for an unknown policy.
    """
    if policy not in POLICIES:
        raise InputError(f"Unknown policy {policy!r}; choose one of {', '.join(POLICIES)}.")
    guidance, pursuit, feedback = POLICIES[policy]
    walker, model = default_walker(sensors, GaitParameters(feedback=feedback))
    graph, params = nnx.split(planner, nnx.Param)
    return Navigator(
        walker=walker,
        camera=load_camera(model),
        volume=load_body_volume(model),
        planner=params,
        graph=graph,
        guidance=guidance,
        pursuit=pursuit,
        noise=DepthNoise() if depth_noise else None,
        intrinsics=planner.config.ipath.camera,
        loop=loop,
    )


def place_at(conditions: Conditions, start: Float[Array, "*batch 3"]) -> Conditions:
    """Conditions whose robots stand at (x [m], y [m], yaw [rad]) instead of at the origin, batch first."""
    cos, sin = jnp.cos(start[..., 2]), jnp.sin(start[..., 2])
    qpos, qvel = conditions.qpos, conditions.qvel

    def turned(xy: Float[Array, "*batch 2"]) -> Float[Array, "*batch 2"]:
        x, y = xy[..., 0], xy[..., 1]
        return jnp.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)

    half = start[..., 2] / 2
    w, x, y, z = (qpos[..., 3 + k] for k in range(4))
    c, s = jnp.cos(half), jnp.sin(half)
    # A turn about the vertical from the left: q = (c, 0, 0, s) * (w, x, y, z).
    quaternion = jnp.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=-1)
    place = turned(qpos[..., :2]) + start[..., :2]
    qpos = jnp.concatenate([place, qpos[..., 2:3], quaternion, qpos[..., 7:]], axis=-1)
    qvel = jnp.concatenate([turned(qvel[..., :2]), qvel[..., 2:]], axis=-1)
    return conditions._replace(qpos=qpos.astype(conditions.qpos.dtype), qvel=qvel.astype(conditions.qvel.dtype))


def frames_of(navigator: Navigator, tasks: TaskArrays) -> int:
    """Camera frames until the longest time limit of a batch of tasks."""
    return math.ceil(float(jnp.max(tasks.time_limit)) / navigator.frame_time) + 1


def with_rules(navigator: Navigator, **changes: Any) -> Navigator:
    """A navigator with some fields changed."""
    return dataclasses.replace(navigator, **changes)

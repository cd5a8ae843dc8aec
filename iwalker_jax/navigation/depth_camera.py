"""The depth camera of a walking robot: what it sees of a scene, with errors that last as long as the view does."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from iwalker_jax.navigation.camera import RobotCamera, camera_in_world
from iwalker_jax.perception import Intrinsics
from iwalker_jax.scenes import DepthNoise, SceneArrays, add_depth_noise, render_depth


class DepthCameraState(NamedTuple):
    """What the camera's errors carry from frame to frame.

    Attributes:
        key: of what changes with each frame, and of surfaces to come.
        surfaces: key of what lasts.
        view: (3,) x, y [m] and bearing [rad] of the camera when that was drawn.
    """

    key: Key[Array, ""]
    surfaces: Key[Array, ""]
    view: Float[Array, "3"]


def start_depth_camera(camera: RobotCamera, qpos: Float[Array, " nq"], key: Key[Array, ""]) -> DepthCameraState:
    """The camera of a robot in its first state."""
    key, surfaces = jax.random.split(key)
    return DepthCameraState(key, surfaces, _view(*camera_in_world(camera, qpos)))


def take_depth(
    camera: RobotCamera,
    intrinsics: Intrinsics,
    noise: DepthNoise | None,
    scene: SceneArrays,
    qpos: Float[Array, " nq"],
    state: DepthCameraState,
) -> tuple[DepthCameraState, Float[Array, "height width"]]:
    """Depth [m] of the scene from where the camera truly is, 0 = no return; ideal without noise.

    Surfaces are matched anew once the camera has moved `noise.view_distance` or turned by `noise.view_turn`.
    """
    rotation, position = camera_in_world(camera, qpos)
    depth = render_depth(scene, intrinsics, rotation, position)
    if noise is None:
        return state, depth
    key, own, drawn = jax.random.split(state.key, 3)
    view = _view(rotation, position)
    apart = view - state.view
    moved = jnp.sum(apart[:2] ** 2) > noise.view_distance**2
    moved |= jnp.cos(apart[2]) < math.cos(min(noise.view_turn, math.pi))
    surfaces = jnp.where(moved, drawn, state.surfaces)
    depth = add_depth_noise(own, depth, noise, intrinsics, surfaces)
    return DepthCameraState(key, surfaces, jnp.where(moved, view, state.view)), depth


def _view(rotation: Float[Array, "3 3"], position: Float[Array, "3"]) -> Float[Array, "3"]:
    """x, y [m] and bearing [rad] of a camera in the world."""
    axis = rotation[:, 2]
    return jnp.append(position[:2], jnp.arctan2(axis[1], axis[0]))

"""The robot's camera while it walks: where it is, and the gravity-aligned base frame in which the planner works.

The base frame lies on the floor below the COM, x along the heading of the camera's optical axis, y to the left.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import rotation_matrix, to_base


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class RobotCamera:
    """A camera fixed to the robot's base body.

    Attributes:
        p_body_camera: (3,) [m].
        R_body_camera: (3, 3) of the optical frame (x right, y down, z forward).
    """

    p_body_camera: Float[Array, "3"]
    R_body_camera: Float[Array, "3 3"]


def load_camera(model: mujoco.MjModel, name: str = "depth") -> RobotCamera:
    """The camera of that name.

    Raises:
        InputError: if the model has none on its base body.
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
    if index < 0 or model.cam_bodyid[index] != model.jnt_bodyid[0]:
        raise InputError(f"The robot has no camera {name!r} on its base body; add one to its MJCF.")
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.cam_quat[index])
    # MuJoCo's cameras look along -z with y up.
    optical = rotation.reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])
    return RobotCamera(jnp.asarray(model.cam_pos[index], float), jnp.asarray(optical, float))


def camera_in_world(camera: RobotCamera, qpos: Float[Array, " nq"]) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
    """R_world_camera and p_world_camera [m] at a state."""
    R_world_body = rotation_matrix(qpos[3:7])
    return R_world_body @ camera.R_body_camera, qpos[:3] + R_world_body @ camera.p_body_camera


def base_pose(R_world_camera: Float[Array, "3 3"], com: Float[Array, "3"]) -> Float[Array, "3"]:
    """(x [m], y [m], yaw [rad]) of the base frame."""
    axis = R_world_camera[:, 2]
    return jnp.stack([com[0], com[1], jnp.arctan2(axis[1], axis[0])])


def measured_mount(
    R_world_camera: Float[Array, "3 3"], p_world_camera: Float[Array, "3"], base: Float[Array, "3"]
) -> Float[Array, "5"]:
    """[height, pitch, roll, forward, left] of the camera in the base frame, as in `CameraMount`."""
    cos, sin = jnp.cos(base[2]), jnp.sin(base[2])
    axis, right = R_world_camera[:, 2], R_world_camera[:, 0]
    pitch = jnp.arcsin(jnp.clip(-axis[2], -1.0, 1.0))
    level_right = jnp.stack([sin, -cos, jnp.zeros_like(sin)])
    level_down = jnp.cross(axis, level_right)
    roll = jnp.arctan2(right @ level_down, right @ level_right)
    return jnp.concatenate([jnp.stack([p_world_camera[2], pitch, roll]), to_base(base, p_world_camera[:2])])

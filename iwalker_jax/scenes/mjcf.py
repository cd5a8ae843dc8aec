"""Scenes in MuJoCo: export to MJCF, and depth images by MuJoCo's own rays."""

import mujoco
import numpy as np
from jaxtyping import Float

from iwalker_jax.perception import Intrinsics
from iwalker_jax.scenes.scene import Scene

_RAY_CUTOFF = 1e6


def scene_to_mjcf(scene: Scene) -> str:
    """MJCF text of a scene: static, collidable geoms named floor, ceiling, box0.., cylinder0... in the world body.

    Every geom has a material, because MuJoCo's ray functions need a model that defines one.
    """
    geoms = ['<geom name="floor" type="plane" size="0 0 1" material="floor"/>']
    if scene.ceiling is not None:
        geoms.append(
            f'<geom name="ceiling" type="plane" size="0 0 1" pos="0 0 {scene.ceiling:.15g}" euler="{np.pi!r} 0 0" '
            'material="wall"/>'
        )
    body = "\n    ".join([*geoms, *obstacle_geoms(scene)])
    return f"""<mujoco model="{scene.name}">
  <compiler angle="radian"/>
  <asset>
    <material name="floor" rgba="0.5 0.5 0.5 1"/>
    <material name="wall" rgba="0.8 0.75 0.65 1"/>
  </asset>
  <worldbody>
    {body}
  </worldbody>
</mujoco>
"""


def obstacle_geoms(scene: Scene) -> list[str]:
    """MJCF elements of a scene's obstacles, angles in radians: geoms box0.., cylinder0... with the material wall."""
    geoms = []
    for i, (x, y, z, hx, hy, hz, yaw) in enumerate(scene.boxes.tolist()):
        geoms.append(
            f'<geom name="box{i}" type="box" pos="{x:.15g} {y:.15g} {z:.15g}" size="{hx:.15g} {hy:.15g} {hz:.15g}" '
            f'euler="0 0 {yaw:.15g}" material="wall"/>'
        )
    for i, (x, y, z, radius, half) in enumerate(scene.cylinders.tolist()):
        geoms.append(
            f'<geom name="cylinder{i}" type="cylinder" pos="{x:.15g} {y:.15g} {z:.15g}" size="{radius:.15g} '
            f'{half:.15g}" material="wall"/>'
        )
    return geoms


def load_mujoco_scene(scene: Scene) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """MuJoCo model and data of a scene, with kinematics computed, ready for `mujoco_ray_depth`."""
    model = mujoco.MjModel.from_xml_string(scene_to_mjcf(scene))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def mujoco_ray_depth(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    intrinsics: Intrinsics,
    R_world_camera: Float[np.ndarray, "3 3"],
    p_world_camera: Float[np.ndarray, " 3"],
    max_depth: float = 10.0,
) -> Float[np.ndarray, "height width"]:
    """z-depth image [m] of a loaded model by `mj_multiRay`; 0 where nothing lies within `max_depth`.

    Args:
        model, data: as from `load_mujoco_scene`.
        intrinsics: of the image.
        R_world_camera, p_world_camera: camera pose (optical frame: x right, y down, z forward) in the world frame.
        max_depth: [m] along the optical axis.
    """
    u = (np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx
    v = (np.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy
    rays = np.stack([*np.meshgrid(u, v), np.ones((intrinsics.height, intrinsics.width))], axis=-1).reshape(-1, 3)
    norms = np.linalg.norm(rays, axis=-1)
    directions = (rays / norms[:, None]) @ np.asarray(R_world_camera, np.float64).T
    geoms = np.empty(len(rays), np.int32)
    ranges = np.empty(len(rays))
    mujoco.mj_multiRay(
        model,
        data,
        np.asarray(p_world_camera, np.float64),
        directions.reshape(-1),
        None,
        True,
        -1,
        geoms,
        ranges,
        None,
        len(rays),
        _RAY_CUTOFF,
    )
    depth = np.where(ranges >= 0, ranges / norms, 0.0)
    return np.where(depth <= max_depth, depth, 0.0).reshape(intrinsics.height, intrinsics.width)

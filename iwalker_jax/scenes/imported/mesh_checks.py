"""Exact answers about meshes on the host, to check converted scenes against: MuJoCo's rays and closest points."""

import mujoco
import numpy as np
import trimesh
from jaxtyping import Float

from iwalker_jax.errors import InputError

_PAIRS_AT_ONCE = 4_000_000


def mesh_model(mesh: trimesh.Trimesh) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """MuJoCo model and data of a mesh, z up [m], on a floor at z = 0, ready for `simulation.mjcf.ray_depth`.

    Raises:
        InputError: MuJoCo refuses the mesh.
    """
    spec = mujoco.MjSpec()
    spec.add_material(name="wall")
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], material="wall")
    spec.add_mesh(
        name="scene",
        uservert=mesh.vertices.astype(np.float32).ravel(),
        userface=mesh.faces.astype(np.int32).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH, meshname="scene", material="wall", contype=0, conaffinity=0
    )
    try:
        model = spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"MuJoCo refuses the mesh ({reason}); repair it.") from error
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def mesh_clearance(mesh: trimesh.Trimesh, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Distances [m] from points to a mesh's surface by exact closest points, never negative."""
    count = max(1, _PAIRS_AT_ONCE // len(mesh.faces))
    parts = [points[i : i + count] for i in range(0, len(points), count)]
    return np.concatenate([trimesh.proximity.closest_point_naive(mesh, part)[1] for part in parts])

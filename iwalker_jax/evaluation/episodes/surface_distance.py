"""How near a body came to the surfaces of a user's scene file themselves, not to what they were converted to."""

import math
from os import PathLike
from pathlib import Path

import mujoco
import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import cKDTree

from iwalker_jax.navigation import BodyVolume
from iwalker_jax.scenes import LARGEST
from iwalker_jax.scenes.imported.mesh_distance import mesh_clearance
from iwalker_jax.scenes.imported.mesh_file import read_mesh
from iwalker_jax.scenes.imported.mjcf_solids import load_mjcf, solids_of_mjcf
from iwalker_jax.scenes.imported.user_scene import BAND, MJCF_SUFFIXES
from iwalker_jax.scenes.imported.voxel_boxes import sample_surface

AROUND = 1.0
"""[m] around the body within which surfaces are looked at."""

_SPACING = 0.04


def original_surface(
    path: str | PathLike, T_scene_file: Float[np.ndarray, "4 4"] = np.eye(4), lowest: float = BAND[0]
) -> trimesh.Trimesh:
    """The surfaces of a scene file in one mesh [m], without what is low, which leaves the floor out.

    Args:
        path: of the file.
        T_scene_file: how it became a scene, `UserScene.T_scene_file`.
        lowest: [m] height from which on surfaces count, `UserScene.lowest`.

    Raises:
        InputError: as `convert_user_scene` for files that cannot be read.
    """
    if Path(path).suffix.lower() in MJCF_SUFFIXES:
        solids = solids_of_mjcf(*load_mjcf(path), reach=LARGEST.extent)
        parts = list(solids.meshes)
        for *centre, x, y, z, yaw in solids.boxes:
            pose = trimesh.transformations.translation_matrix(centre) @ trimesh.transformations.euler_matrix(0, 0, yaw)
            parts.append(trimesh.creation.box((2 * x, 2 * y, 2 * z), pose))
        for *centre, radius, half in solids.cylinders:
            pose = trimesh.transformations.translation_matrix(centre)
            parts.append(trimesh.creation.cylinder(radius, 2 * half, sections=64, transform=pose))
    else:
        parts = [read_mesh(path)]
    vertices, faces = trimesh.util.append_faces([part.vertices for part in parts], [part.faces for part in parts])
    vertices = trimesh.transformations.transform_points(vertices, T_scene_file)
    vertices, faces, *_ = trimesh.intersections.slice_faces_plane(vertices, faces, (0, 0, 1), (0, 0, lowest))
    return trimesh.Trimesh(vertices, faces, process=False)


def least_surface_distance(
    surface: trimesh.Trimesh, volume: BodyVolume, model: mujoco.MjModel, qpos: Float[np.ndarray, "n nq"]
) -> float:
    """Least distance [m] between a body's volume in given states and a surface; infinite beyond `AROUND`.

    Exact for the spheres of the volume. It is negative by at most a sphere's radius where the body cuts a surface:
    inside of a solid, the way to its surface counts.

    Args:
        surface: in the world frame.
        volume: of the robot that `model` describes.
        qpos: base position [m] and quaternion (wxyz), joint positions [rad] of every state.
    """
    bodies, offsets, radii = (np.asarray(leaf) for leaf in volume)
    data = mujoco.MjData(model)
    places = []
    for state in qpos:
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        places.append(data.xpos[bodies] + np.einsum("nij,nj->ni", data.xmat[bodies].reshape(-1, 3, 3), offsets))
    centres = np.concatenate(places)
    low, high = centres.min(axis=0) - AROUND, centres.max(axis=0) + AROUND
    corners = surface.triangles
    near = ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)
    surface = trimesh.Trimesh(surface.vertices, surface.faces[near], process=False)
    bounds = (low[0], low[1], high[0], high[1])
    points = sample_surface(surface, _SPACING, (low[2], high[2]), bounds).points if near.any() else np.empty((0, 3))
    if not len(points):
        return math.inf
    # No point of the surface is farther from a sample than this, so that spheres beyond it cannot be the nearest.
    slack = _SPACING
    tree, least, sampled = cKDTree(points), math.inf, []
    for place in places:
        # The search is quick because it ends where nothing is nearer than in the states before.
        sampled.append(tree.query(place, distance_upper_bound=least + slack + radii.max())[0] - radii)
        least = min(least, sampled[-1].min())
    chosen = np.concatenate(sampled) <= least + slack
    distance = float(np.min(mesh_clearance(surface, centres[chosen]) - np.tile(radii, len(places))[chosen]))
    return distance if distance <= AROUND else math.inf

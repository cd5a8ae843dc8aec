"""Scenes from a user's own MJCF and mesh files."""

from iwalker_jax.scenes.imported.mesh_distance import mesh_clearance
from iwalker_jax.scenes.imported.mesh_file import read_mesh
from iwalker_jax.scenes.imported.mesh_frame import MeshFrame, Up, mesh_frame
from iwalker_jax.scenes.imported.mesh_solids import MeshSolids, recognise_solids
from iwalker_jax.scenes.imported.mjcf_solids import MjcfSolids, load_mjcf, solids_of_mjcf
from iwalker_jax.scenes.imported.user_scene import UserScene, convert_user_scene

__all__ = [
    "MeshFrame",
    "MeshSolids",
    "MjcfSolids",
    "Up",
    "UserScene",
    "convert_user_scene",
    "load_mjcf",
    "mesh_clearance",
    "mesh_frame",
    "read_mesh",
    "recognise_solids",
    "solids_of_mjcf",
]

"""Scenes from a user's own MJCF and mesh files."""

from iwalker_jax.scenes.imported.mesh_distance import mesh_clearance
from iwalker_jax.scenes.imported.mesh_solids import MeshSolids, read_mesh, recognise_solids
from iwalker_jax.scenes.imported.mjcf_solids import MjcfSolids, load_mjcf, solids_of_mjcf
from iwalker_jax.scenes.imported.user_scene import UserScene, convert_user_scene

__all__ = [
    "MeshSolids",
    "MjcfSolids",
    "UserScene",
    "convert_user_scene",
    "load_mjcf",
    "mesh_clearance",
    "read_mesh",
    "recognise_solids",
    "solids_of_mjcf",
]

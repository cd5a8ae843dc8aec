"""Meshes from files, in the files' own axes and units."""

import io
from os import PathLike
from pathlib import Path

import numpy as np
import trimesh

from iwalker_jax.errors import InputError

MESH_SUFFIXES = (".stl", ".obj", ".glb", ".gltf", ".ply", ".off")

_AS_A_MESH = "make a mesh of it first, for example by Screened Poisson reconstruction in MeshLab or CloudCompare"
_POINT_CLOUDS = dict.fromkeys((".pcd", ".las", ".laz", ".e57", ".xyz", ".pts"), f"is a point cloud; {_AS_A_MESH}")
_OTHER_MODELS = dict.fromkeys(
    (".dae", ".fbx", ".usd", ".usda", ".usdc", ".usdz", ".blend", ".step", ".stp", ".ifc", ".3ds", ".dxf", ".3mf"),
    "is a model that is not read; export it as GLB, OBJ, STL or PLY, for example with Blender",
)
UNREAD_SUFFIXES = _POINT_CLOUDS | _OTHER_MODELS
"""What becomes of files of common kinds that are not read, in words."""

_BINARY_STL_HEADER = 80
_TO_ASCII = bytes(range(128)) + b"?" * 128


def read_mesh(path: str | PathLike) -> trimesh.Trimesh:
    """All triangles of a file in one mesh, in the file's own coordinates.

    Raises:
        InputError: there is no such file, trimesh cannot read it, it has no triangles, or they are not finite.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError(f"There is no file {file}; give the path of a mesh.")
    try:
        mesh = _loaded(file)
    except Exception as error:  # trimesh's readers raise whatever their parsers do
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{file} cannot be read as a mesh ({reason}); export it as STL, OBJ, PLY or GLB.") from error
    if isinstance(mesh, trimesh.PointCloud) or (isinstance(mesh, trimesh.Trimesh) and len(mesh.faces) == 0):
        count = len(mesh.vertices)
        if count:
            raise InputError(f"{file} has {count} points but no triangles: it is a point cloud; {_AS_A_MESH}.")
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise InputError(f"{file} has no triangles; export the scene's surfaces as a mesh.")
    if not np.isfinite(mesh.vertices).all():
        raise InputError(f"{file} has vertices that are not finite; repair the mesh.")
    return mesh


def _loaded(file: Path) -> object:
    suffix = file.suffix.lower()
    if suffix in (".glb", ".gltf"):
        return trimesh.load(file, force="mesh")
    # Materials may be in other files and encodings, and names in any: neither is needed.
    content = io.BytesIO(_in_ascii(file.read_bytes(), suffix))
    if suffix == ".obj":
        return trimesh.load(content, file_type="obj", force="mesh", skip_materials=True)
    # Forced to be a mesh, a point cloud would lose its points.
    return trimesh.load(content, file_type=suffix[1:], force=None if suffix == ".ply" else "mesh")


def _in_ascii(data: bytes, suffix: str) -> bytes:
    """A file whose names and comments are ASCII, so that its reader need not guess at their encoding."""
    if suffix == ".stl":
        count = int.from_bytes(data[_BINARY_STL_HEADER : _BINARY_STL_HEADER + 4], "little")
        if len(data) == _BINARY_STL_HEADER + 4 + 50 * count:
            return bytes(_BINARY_STL_HEADER) + data[_BINARY_STL_HEADER:]
    if suffix == ".ply":
        end = data.find(b"end_header")
        return data[:end].translate(_TO_ASCII) + data[end:] if end >= 0 else data
    return data.translate(_TO_ASCII)

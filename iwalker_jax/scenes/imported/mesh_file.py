"""Meshes from files, in the files' own axes and units."""

import io
from os import PathLike
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Bool

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.imported.named_files import check_gltf_files, require_file

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
    require_file(file, "a mesh")
    if file.suffix.lower() == ".gltf":
        check_gltf_files(file)
    try:
        mesh = _loaded(file)
    except InputError:
        raise
    except Exception as error:  # trimesh's readers raise whatever their parsers do
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{file} cannot be read as a mesh ({reason}); export it as STL, OBJ, PLY or GLB.") from error
    if isinstance(mesh, trimesh.PointCloud) or (isinstance(mesh, trimesh.Trimesh) and len(mesh.faces) == 0):
        count = len(mesh.vertices)
        if count:
            raise InputError(f"{file} has {count} points but no triangles: it is a point cloud; {_AS_A_MESH}.")
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise InputError(f"{file} has no triangles; export the scene's surfaces as a mesh.")
    _check_finite(file, mesh)
    return mesh


def _loaded(file: Path) -> object:
    scene = _scene(file)
    for part in scene.geometry.values():
        if isinstance(part, trimesh.Trimesh):
            # Left to itself, trimesh takes vertices that are not finite away with their triangles.
            _check_finite(file, part)
            part.process()
            part.update_faces(_has_three_corners(part))
    # Forced to be a mesh, a point cloud would lose its points.
    if file.suffix.lower() == ".ply" and len(scene.geometry) == 1:
        return next(iter(scene.geometry.values()))
    return scene.to_mesh()


def _scene(file: Path) -> trimesh.Scene:
    """All that a file holds, as it is."""
    suffix = file.suffix.lower()
    if suffix in (".glb", ".gltf"):
        return trimesh.load_scene(file, process=False)
    # Materials may be in other files and encodings, and names in any: neither is needed.
    content = io.BytesIO(_in_ascii(file.read_bytes(), suffix))
    if suffix == ".obj":
        return trimesh.load_scene(content, file_type="obj", skip_materials=True, process=False)
    return trimesh.load_scene(content, file_type=suffix[1:], process=False)


def _check_finite(file: Path, mesh: trimesh.Trimesh) -> None:
    if not np.isfinite(mesh.vertices).all():
        raise InputError(f"{file} has vertices that are not finite; repair the mesh.")


def _has_three_corners(mesh: trimesh.Trimesh) -> Bool[np.ndarray, " faces"]:
    """Which triangles are not just a line or a point, which are no surface to walk into."""
    first, second, third = mesh.faces.T
    return (first != second) & (second != third) & (third != first)


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

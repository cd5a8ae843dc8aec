"""Exact distances from points to a mesh, computed on the host."""

import numpy as np
import trimesh
from jaxtyping import Float

_PAIRS_AT_ONCE = 4_000_000
"""Points times triangles that are looked at together: half a gigabyte."""


def mesh_clearance(mesh: trimesh.Trimesh, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Distances [m] from points to a mesh's surface by exact closest points, never negative."""
    count = max(1, _PAIRS_AT_ONCE // len(mesh.faces))
    parts = [points[i : i + count] for i in range(0, len(points), count)]
    return np.concatenate([trimesh.proximity.closest_point_naive(mesh, part)[1] for part in parts])

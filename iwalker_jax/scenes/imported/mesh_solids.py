"""Which parts of a mesh are boxes or upright cylinders."""

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
import trimesh
from jaxtyping import Int

_MOST_PARTS = 4000
_BOX_SHARE, _CYLINDER_SHARE, _STACK_SHARE = 0.99, 0.90, 0.75
_DISC, _MOST_DISCS = 0.05, 24
_ROOM_SHARE, _ROOM_HEIGHT = 0.8, 0.5
_SECTORS, _ROUNDNESS = 24, 0.08


@dataclass
class MeshSolids:
    """Rows of `Scene.boxes` and `Scene.cylinders`, and what is neither.

    Attributes:
        boxes, cylinders: exact solids.
        discs: cylinders of which stacks approximate solids of revolution about an upright axis.
        rest: everything else.
    """

    boxes: list[list[float]] = field(default_factory=list)
    cylinders: list[list[float]] = field(default_factory=list)
    discs: list[list[float]] = field(default_factory=list)
    rest: list[trimesh.Trimesh] = field(default_factory=list)


def recognise_solids(mesh: trimesh.Trimesh) -> MeshSolids:
    """The parts of a mesh, each of which hangs together, as solids as far as possible.

    Upright boxes are exact, and cylinders too, of eight sides and more; spheres, cones and the like become stacks.
    """
    solids = MeshSolids()
    parts = _parts(mesh)
    if len(parts) > _MOST_PARTS:
        return MeshSolids(rest=[mesh])
    for part in parts:
        if part.area == 0:
            continue
        if not (part.is_watertight and part.is_winding_consistent and part.volume > 0):
            solids.rest.append(part)
            continue
        if len(parts) > 1 and _is_around(part, mesh):
            # A closed room seen from outside; turned inside out it is not filled.
            part.invert()
            solids.rest.append(part)
            continue
        plan = part.vertices[:, :2].astype(np.float32)
        (x, y), (length, width), degrees = cv2.minAreaRect(plan)
        (cx, cy), radius = cv2.minEnclosingCircle(plan)
        low, high = part.bounds[:, 2].tolist()
        middle, half = (low + high) / 2, (high - low) / 2
        if part.volume > _BOX_SHARE * 2 * half * length * width:
            solids.boxes.append([x, y, middle, length / 2, width / 2, half, math.radians(degrees)])
        elif part.volume > _CYLINDER_SHARE * 2 * half * math.pi * radius**2:
            solids.cylinders.append([cx, cy, middle, radius, half])
        elif abs(length - width) < _ROUNDNESS * length and (discs := _stack(part, cx, cy)):
            solids.discs += discs
        else:
            solids.rest.append(part)
    return solids


def _parts(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """What hangs together by shared edges."""
    groups = trimesh.graph.connected_components(
        mesh.face_adjacency, nodes=np.arange(len(mesh.faces)), min_len=1, engine="scipy"
    )
    return [_part(mesh, group) for group in groups]


def _part(mesh: trimesh.Trimesh, group: Int[np.ndarray, " n"]) -> trimesh.Trimesh:
    used, faces = np.unique(mesh.faces[group], return_inverse=True)
    return trimesh.Trimesh(mesh.vertices[used], faces.reshape(-1, 3))


def _is_around(part: trimesh.Trimesh, mesh: trimesh.Trimesh) -> bool:
    """Whether a part of a mesh is as large as the mesh in plan view and not just its floor."""
    return bool((part.extents[:2] > _ROOM_SHARE * mesh.extents[:2]).all() and part.extents[2] > _ROOM_HEIGHT)


def _stack(part: trimesh.Trimesh, x: float, y: float) -> list[list[float]] | None:
    """Discs that stand for a solid of revolution about an upright axis; None if it is not one."""
    low, high = part.bounds[:, 2]
    count = math.ceil((high - low) / _DISC)
    if count > _MOST_DISCS:
        return None
    points, _ = trimesh.remesh.subdivide_to_size(part.vertices, part.faces, _DISC / 2, max_iter=30)
    layer = np.clip(((points[:, 2] - low) / (high - low) * count).astype(int), 0, count - 1)
    angles = np.arctan2(points[:, 1] - y, points[:, 0] - x)
    radii = np.hypot(points[:, 0] - x, points[:, 1] - y)
    half, discs = (high - low) / count / 2, []
    for k in range(count):
        mine = layer == k
        sector = ((angles[mine] + math.pi) / (2 * math.pi) * _SECTORS).astype(int) % _SECTORS
        outline = np.zeros(_SECTORS)
        np.maximum.at(outline, sector, radii[mine])
        if np.ptp(outline) > _ROUNDNESS * outline.max():
            return None
        discs.append([x, y, low + (2 * k + 1) * half, outline.mean(), half])
    volume = sum(2 * half * math.pi * disc[3] ** 2 for disc in discs)
    # Hollow solids have less volume than their hull.
    return discs if part.volume > _STACK_SHARE * volume else None

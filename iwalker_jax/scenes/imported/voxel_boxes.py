"""Triangles as a few boxes: voxels in the body's height band, merged greedily and fitted to the surface."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int

from iwalker_jax.geometry import host

Band = tuple[float, float]
Bounds = tuple[float, float, float, float]

_SEEDS = 8
# Voxels that a solid barely touches do not count (depth in voxels), and a free face lies where this share of its
# layer's surface lies further in: both keep the stairs of oblique and curved surfaces from standing out.
_INSIDE, _INWARD = 0.45, 0.25
_MEASURED = 20_000
_THINNEST = 0.01


@dataclass(frozen=True, eq=False)
class VoxelBoxes:
    """Boxes that stand for surfaces.

    Attributes:
        boxes: (n, 7) rows of `Scene.boxes`.
        error: [m] largest distance from the surface in the band to the boxes, measured; boxes stand out of the surface
            by a voxel's diagonal at most.
    """

    boxes: Float[np.ndarray, "n 7"]
    error: float


class Surface(NamedTuple):
    """Points on a mesh and whether it is a solid, whose inside is to be filled.

    Attributes:
        points: (n, 3) [m].
        normals: (n, 3) outward; zero unless the mesh is a solid.
        is_solid: whether the mesh is closed and its faces look outward.
    """

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    is_solid: bool


def sample_surface(mesh: trimesh.Trimesh, spacing: float, band: Band, bounds: Bounds) -> Surface:
    """Points on a mesh at most `spacing` [m] apart, where it reaches into a height band and plan-view bounds."""
    is_solid = bool(mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0)
    low, high = _corners(band, bounds)
    corners = mesh.triangles
    inside = ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)
    # Of a solid the whole surface is needed to tell inside from outside.
    faces = mesh.faces if is_solid and inside.any() else mesh.faces[inside]
    if not len(faces):
        return Surface(np.empty((0, 3)), np.empty((0, 3)), is_solid)
    points, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, faces, spacing, max_iter=30)
    used = np.zeros(len(points), bool)
    used[faces] = True
    normals = trimesh.Trimesh(points, faces, process=False).vertex_normals if is_solid else np.zeros_like(points)
    return Surface(points[used], normals[used], is_solid)


def voxel_boxes(
    surfaces: Sequence[Surface], pitch: float, band: Band, bounds: Bounds, yaw: float = 0.0, most: int | None = None
) -> VoxelBoxes | None:
    """Boxes for everything of some surfaces that lies in a height band inside plan-view bounds.

    Flat outer faces lie where the surface's do; what reaches down to the band reaches the floor. Solids are filled,
    so that they need fewer boxes.

    Args:
        surfaces: sampled at most half a voxel apart, in the world frame.
        pitch: [m] side of a voxel.
        band: (low, high) [m] of heights that count.
        bounds: (x_min, y_min, x_max, y_max) [m].
        yaw: [rad] of the voxels' axes.
        most: give up, with None, beyond this number of boxes.
    """
    to_world = host.rotation_about_vertical(yaw)
    points, voxels, filled = [np.empty((0, 3))], [np.empty((0, 3), int)], [np.empty((0, 3), int)]
    for surface in surfaces:
        own = _voxel_of((surface.points - _INSIDE * pitch * surface.normals) @ to_world, pitch)
        inside = _inside(surface.points, band, bounds)
        points.append(surface.points[inside] @ to_world)
        voxels.append(own[inside])
        if surface.is_solid:
            core = _filled(own)
            filled.append(core[_inside(pitch * core @ to_world.T, band, bounds)])
    surface_points, surface_voxels = np.concatenate(points), np.concatenate(voxels)
    if not len(surface_points):
        return VoxelBoxes(np.empty((0, 7)), 0.0)
    cells = np.concatenate([*filled, surface_voxels])
    origin = cells.min(axis=0) - 1
    occupied = np.zeros(cells.max(axis=0) - origin + 2, bool)
    occupied[tuple((cells - origin).T)] = True
    blocks = _merged(occupied, most)
    if blocks is None:
        return None
    ranges = _fitted(occupied, blocks, surface_points, surface_voxels - origin, origin, pitch)
    ranges[:, 0, 2] = np.where(ranges[:, 0, 2] < band[0] + pitch, 0.0, ranges[:, 0, 2])
    half = np.maximum((ranges[:, 1] - ranges[:, 0]) / 2, _THINNEST / 2)
    centre = ranges.mean(axis=1)
    boxes = np.column_stack([centre @ to_world.T, half, np.full(len(half), yaw)])
    measured = surface_points[:: max(1, len(surface_points) // _MEASURED)]
    return VoxelBoxes(boxes, _shortfall(measured, centre, half))


def _corners(band: Band, bounds: Bounds) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    return np.array([*bounds[:2], band[0]]), np.array([*bounds[2:], band[1]])


def _inside(points: Float[np.ndarray, "n 3"], band: Band, bounds: Bounds) -> Bool[np.ndarray, " n"]:
    low, high = _corners(band, bounds)
    return np.logical_and.reduce((points >= low) & (points <= high), axis=1)


def _voxel_of(points: Float[np.ndarray, "n 3"], pitch: float) -> Int[np.ndarray, "n 3"]:
    return np.round(points / pitch).astype(int)


def _filled(voxels: Int[np.ndarray, "n 3"]) -> Int[np.ndarray, "m 3"]:
    """Voxels of a closed shell and of what it encloses."""
    if not len(voxels):
        return voxels
    origin = voxels.min(axis=0)
    shell = np.zeros(voxels.max(axis=0) - origin + 1, bool)
    shell[tuple((voxels - origin).T)] = True
    filled = trimesh.voxel.morphology.fill(trimesh.voxel.encoding.DenseEncoding(shell), method="holes").dense
    return np.argwhere(filled) + origin


def _merged(occupied: Bool[np.ndarray, "a b c"], most: int | None) -> Int[np.ndarray, "n 2 3"] | None:
    """Index ranges (first, last) of blocks whose union is the occupied set; each takes the most of what is left."""
    left = occupied.copy()
    blocks: list[np.ndarray] = []
    while left.any():
        if most is not None and len(blocks) == most:
            return None
        seeds = np.argwhere(left)[:: max(1, int(left.sum()) // _SEEDS)]
        grown = [_grown(occupied, seed, order) for seed in seeds for order in permutations(range(3))]
        best = max(grown, key=lambda block: int(left[_slices(block)].sum()))
        left[_slices(best)] = False
        blocks.append(best)
    return np.array(blocks)


def _slices(block: Int[np.ndarray, "2 3"]) -> tuple[slice, ...]:
    return tuple(slice(first, last + 1) for first, last in block.T)


def _grown(occupied: Bool[np.ndarray, "a b c"], seed: Int[np.ndarray, "3"], order: tuple[int, ...]) -> np.ndarray:
    """The block around a voxel that is widened as far as it stays occupied, one axis after the other."""
    block = np.array([seed, seed])
    for axis in order:
        cut = list(_slices(block))
        cut[axis] = slice(None)
        full = occupied[tuple(cut)].all(axis=tuple(other for other in range(3) if other != axis))
        gaps = np.flatnonzero(~full)
        place = np.searchsorted(gaps, seed[axis])
        # The grid has an empty margin, so there is a gap on both sides.
        block[:, axis] = gaps[place - 1] + 1, gaps[place] - 1
    return block


def _fitted(
    occupied: Bool[np.ndarray, "a b c"],
    blocks: Int[np.ndarray, "n 2 3"],
    surface: Float[np.ndarray, "points 3"],
    cells: Int[np.ndarray, "points 3"],
    origin: Int[np.ndarray, "3"],
    pitch: float,
) -> Float[np.ndarray, "n 2 3"]:
    """Ranges [m] of blocks, their free faces moved to the surface."""
    ranges = (blocks + origin + np.array([[-0.5], [0.5]])) * pitch
    lowest = np.full((*occupied.shape, 3), np.inf)
    highest = np.full((*occupied.shape, 3), -np.inf)
    where = tuple(cells.T)
    np.minimum.at(lowest, where, surface)
    np.maximum.at(highest, where, surface)
    seams = _seams(occupied, blocks)
    for k, block in enumerate(blocks):
        cut = _slices(block)
        for axis in range(3):
            for end, outermost in ((0, lowest), (1, highest)):
                layer, face = list(cut), list(cut)
                layer[axis] = slice(block[end, axis], block[end, axis] + 1)
                face[axis] = slice(block[end, axis] - 1 + end, block[end, axis] + end)
                values = outermost[tuple(layer)][..., axis]
                values = values[np.isfinite(values)]
                if len(values) and not seams[axis][tuple(face)].any():
                    ranges[k, end, axis] = np.quantile(values, (1 - _INWARD, _INWARD)[end])
    return ranges


def _seams(occupied: Bool[np.ndarray, "a b c"], blocks: Int[np.ndarray, "n 2 3"]) -> Bool[np.ndarray, "3 a b c"]:
    """For each axis, voxels that are next to another one along it without any block that holds both."""
    seams = np.stack([occupied & np.roll(occupied, -1, axis) for axis in range(3)])
    for block in blocks:
        for axis in range(3):
            inner = list(_slices(block))
            inner[axis] = slice(block[0, axis], block[1, axis])
            seams[axis][tuple(inner)] = False
    return seams


def _shortfall(
    surface: Float[np.ndarray, "points 3"], centre: Float[np.ndarray, "n 3"], half: Float[np.ndarray, "n 3"]
) -> float:
    """Largest distance [m] from surface points to the union of boxes."""
    short = np.full(len(surface), np.inf)
    for c, h in zip(centre, half, strict=True):
        short = np.minimum(short, np.linalg.norm(np.maximum(np.abs(surface - c) - h, 0), axis=1))
    return float(short.max())

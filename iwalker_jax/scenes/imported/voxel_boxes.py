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

_WIDENED = 1500
_ORDERS = tuple(permutations(range(3)))
# Voxels that a solid barely touches do not count (depth in voxels), and a free face lies where this share of its
# layer's surface lies further in: both keep the stairs of oblique and curved surfaces from standing out.
_INSIDE, _INWARD = 0.45, 0.25
_MEASURED, _MEASURED_PAIRS = 20_000, 10_000_000
_THINNEST = 0.01
_POINTS_AT_ONCE = 1_000_000


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
    if not inside.any():
        return Surface(np.empty((0, 3)), np.empty((0, 3)), is_solid)
    if not is_solid:
        points = _lattice_points(corners[inside], spacing, band, bounds)
        return Surface(points, np.zeros_like(points), is_solid)
    # Of a solid the whole surface is needed to tell inside from outside.
    points, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, spacing, max_iter=30)
    used = np.zeros(len(points), bool)
    used[faces] = True
    normals = trimesh.Trimesh(points, faces, process=False).vertex_normals
    return Surface(points[used], normals[used], is_solid)


def _lattice_points(
    triangles: Float[np.ndarray, "n 3 3"], spacing: float, band: Band, bounds: Bounds
) -> Float[np.ndarray, "m 3"]:
    """Points of triangles in rows along their longest edges, inside the band and bounds; some triangles at a time."""
    lengths = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    order = (lengths.argmax(axis=1)[:, None] + np.arange(3)) % 3
    triangles = np.take_along_axis(triangles, order[..., None], axis=1)
    longest = lengths.max(axis=1)
    double_area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    rows = np.ceil(double_area / np.maximum(longest, 1e-12) / spacing).astype(int)
    group = np.cumsum((rows + 1) * (longest / spacing / 2 + 2)) // _POINTS_AT_ONCE
    cuts = np.flatnonzero(np.diff(group)) + 1
    parts = []
    for chosen in np.split(np.arange(len(triangles)), cuts):
        points = _rows_of_points(triangles[chosen], longest[chosen], rows[chosen], spacing)
        parts.append(points[_inside(points, band, bounds)])
    return np.concatenate(parts)


def _rows_of_points(
    triangles: Float[np.ndarray, "n 3 3"],
    longest: Float[np.ndarray, " n"],
    rows: Int[np.ndarray, " n"],
    spacing: float,
) -> Float[np.ndarray, "m 3"]:
    """Points on rows parallel to each triangle's first edge, from it to the opposite corner."""
    face = np.repeat(np.arange(len(triangles)), rows + 1)
    share = _counted(rows + 1) / np.maximum(rows, 1)[face]
    segments = np.ceil(longest[face] * (1 - share) / spacing).astype(int)
    row = np.repeat(np.arange(len(face)), segments + 1)
    along = (_counted(segments + 1) / np.maximum(segments, 1)[row])[:, None]
    first, last, opposite = (triangles[face, corner] for corner in range(3))
    left = first + share[:, None] * (opposite - first)
    right = last + share[:, None] * (opposite - last)
    return left[row] + along * (right - left)[row]


def _counted(sizes: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """0, 1, ... within each of some groups of given sizes."""
    return np.arange(int(sizes.sum())) - np.repeat(np.cumsum(sizes) - sizes, sizes)


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
    count = max(1, min(_MEASURED, _MEASURED_PAIRS // len(boxes)))
    measured = surface_points[:: max(1, len(surface_points) // count)]
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
    """Index ranges (first, last) of blocks whose union is the occupied set; None if they seem to be too many.

    Runs of voxels are joined to plates and plates to blocks. If those are few, each is widened as far as it stays
    occupied, the largest are taken until everything is covered, and what others cover is dropped.
    """
    columns = _joined(np.repeat(np.argwhere(occupied)[:, None], 2, axis=1), 2)
    parts = min((_joined(_joined(columns, first), 1 - first) for first in (0, 1)), key=len)
    if len(parts) <= _WIDENED:
        widened = [_grown(occupied, seed, order) for seed in parts.mean(axis=1).astype(int) for order in _ORDERS]
        fewer = _covering(occupied, np.unique(np.concatenate([parts, np.array(widened)]), axis=0))
        parts = min(parts, fewer, key=len)
    return None if most is not None and len(parts) > most else parts


def _joined(blocks: Int[np.ndarray, "n 2 3"], axis: int) -> Int[np.ndarray, "m 2 3"]:
    """Blocks, of which those that follow each other along an axis and are alike along the others are one."""
    across = [blocks[:, end, other] for other in range(3) if other != axis for end in (0, 1)]
    blocks = blocks[np.lexsort([blocks[:, 0, axis], *across])]
    goes_on = blocks[1:, 0, axis] == blocks[:-1, 1, axis] + 1
    for other in range(3):
        if other != axis:
            goes_on &= (blocks[1:, :, other] == blocks[:-1, :, other]).all(axis=1)
    starts = np.flatnonzero(np.append(True, ~goes_on))
    joined = blocks[starts].copy()
    joined[:, 1, axis] = blocks[np.append(starts[1:], len(blocks)) - 1, 1, axis]
    return joined


def _covering(occupied: Bool[np.ndarray, "a b c"], blocks: Int[np.ndarray, "n 2 3"]) -> Int[np.ndarray, "m 2 3"]:
    """Of blocks that cover the occupied set, the larger ones, without those that others cover altogether."""
    volumes = np.prod(blocks[:, 1] - blocks[:, 0] + 1, axis=1)
    times = np.zeros(occupied.shape, np.int16)
    chosen = []
    for block in blocks[np.argsort(-volumes, kind="stable")]:
        if not times[_slices(block)].all():
            times[_slices(block)] += 1
            chosen.append(block)
    kept = []
    for block in reversed(chosen):
        if (times[_slices(block)] > 1).all():
            times[_slices(block)] -= 1
        else:
            kept.append(block)
    return np.array(kept)


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
    # Only voxels that hold surface have extremes; most of a large scene's are empty.
    flat = np.ravel_multi_index(tuple(cells.T), occupied.shape)
    own, place = np.unique(flat, return_inverse=True)
    slot = np.full(occupied.shape, len(own), np.int32)
    slot.reshape(-1)[own] = np.arange(len(own))
    lowest, highest = np.full((len(own) + 1, 3), np.inf), np.full((len(own) + 1, 3), -np.inf)
    np.minimum.at(lowest, place, surface)
    np.maximum.at(highest, place, surface)
    seams = _seams(occupied, blocks)
    for k, block in enumerate(blocks):
        cut = _slices(block)
        for axis in range(3):
            for end, outermost in ((0, lowest), (1, highest)):
                layer, face = list(cut), list(cut)
                layer[axis] = slice(block[end, axis], block[end, axis] + 1)
                face[axis] = slice(block[end, axis] - 1 + end, block[end, axis] + end)
                values = outermost[slot[tuple(layer)], axis]
                values = values[np.isfinite(values)]
                if len(values) and not seams[axis][tuple(face)].any():
                    ranges[k, end, axis] = _quantile(values, (1 - _INWARD, _INWARD)[end])
    return ranges


def _quantile(values: Float[np.ndarray, " n"], share: float) -> float:
    """NumPy's quantile, a tenth of whose time goes into its work for as few values as a face has."""
    place = share * (len(values) - 1)
    ordered = np.sort(values)
    low = int(place)
    return float(ordered[low] + (place - low) * (ordered[min(low + 1, len(values) - 1)] - ordered[low]))


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

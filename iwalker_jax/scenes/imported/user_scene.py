"""A user's own scene, an MJCF model or a mesh, as boxes and cylinders that the whole loop can walk among.

The camera's depth and the body's collisions are both computed on the converted scene, because rays and distances
compile and batch with the rest of the loop there; while the robot walks, nobody casts rays at the original or measures
distances to it. Upright boxes and cylinders are taken over as they are, round solids as stacks of discs 5 cm high, and
everything else as boxes merged from voxels of 5 cm, or up to 15 cm where finer ones do not fit. Those boxes stand out
of the original surface by a voxel's diagonal at most and leave it outside by `UserScene.error` at most; gaps narrower
than a voxel may close. What ends at `BODY.step_over` or below is floor and left out, and above 2 m whatever is
merged. How near the body came to the original itself can be measured afterwards: `surface_distance`.
"""

import math
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import get_args

import numpy as np
import trimesh
from jaxtyping import Float

from iwalker_jax.arrays import as_doubles
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY
from iwalker_jax.runtime.reading import printable
from iwalker_jax.scenes.clearance_grid import box_reach
from iwalker_jax.scenes.imported.mesh_file import MESH_SUFFIXES, UNREAD_SUFFIXES, read_mesh
from iwalker_jax.scenes.imported.mesh_frame import Up, mesh_frame
from iwalker_jax.scenes.imported.mesh_solids import MeshSolids, recognise_solids
from iwalker_jax.scenes.imported.mjcf_solids import load_mjcf, solids_of_mjcf
from iwalker_jax.scenes.imported.voxel_boxes import Bounds, VoxelBoxes, sample_surface, voxel_boxes
from iwalker_jax.scenes.scene import LARGEST, Scene

VOXELS = (0.05, 0.075, 0.10, 0.15)
"""[m] sides of voxels, tried in this order until the boxes fit."""

BAND = (BODY.step_over, 2.0)
"""[m] heights between which surfaces are kept: above what counts as floor, up to what the camera sees of walls."""

MJCF_SUFFIXES = (".xml", ".mjcf")
_MARGIN = 2.0
_SMALLEST, _LARGEST = 0.3, 100.0
_LARGEST_SOLID = 10_000.0
"""[m] half a side of floors and walls without end; a solid that is larger is a slip in units."""
_FLUSH = 0.001
_FAR_FROM_ORIGIN = 100.0
_UNEVEN = 4.5
"""Standard deviations of a scanned floor below which its bumps stay."""


@dataclass(frozen=True, eq=False)
class UserScene:
    """A converted scene and how true it is to the original.

    Attributes:
        scene: boxes, cylinders, ceiling and bounds.
        exact: number of solids that were taken over as they are.
        discs: number of cylinders in stacks that stand for spheres, cones and the like.
        merged: number of boxes that stand for everything else.
        voxel: [m] side of the voxels those were merged from; 0 without any.
        error: [m] largest distance from the original surface to those boxes, which stand out of it by a voxel's
            diagonal at most.
        T_scene_file: (4, 4) from the file's coordinates to the scene's.
        shift: (2,) [m] by which it was moved in plan view: to be added to places in the file, once that is upright.
        lowest: [m] height below which nothing counts, more than `BAND`'s where the floor is uneven.
        notes: what was assumed, changed or left out, in words.
        low: number of solids that were left out because the feet clear them.
    """

    scene: Scene
    exact: int
    discs: int
    merged: int
    voxel: float
    error: float
    T_scene_file: Float[np.ndarray, "4 4"]
    shift: Float[np.ndarray, "2"]
    lowest: float
    notes: tuple[str, ...]
    low: int = 0

    def describe(self) -> str:
        """What became of the original, in a sentence or two."""
        text = f"{self.scene.name}: {self.exact} solids taken over exactly"
        if self.discs:
            text += f", round ones stacked of {self.discs} discs"
        if self.merged:
            text += (
                f", all else approximated by {self.merged} boxes from voxels of {100 * self.voxel:.3g} cm "
                f"(surfaces at most {100 * self.error:.1f} cm outside)"
            )
        return "; ".join((text, *self.notes)) + "."


@dataclass(frozen=True, eq=False)
class _Parts:
    """What a file consists of, before anything is cut or merged: solids, the frame, and what is to be said."""

    solids: list[MeshSolids]
    T_scene_file: Float[np.ndarray, "4 4"]
    notes: tuple[str, ...]
    ceiling: float | None = None
    margin: float = 0.0
    lowest: float = BAND[0]


def convert_user_scene(path: str | PathLike, bounds: Bounds | None = None, up: Up | None = None) -> UserScene:
    """A scene from an MJCF model (.xml, .mjcf) or from a mesh, with lengths in metres.

    Boxes and cylinders that stand upright are exact, other solids of revolution about an upright axis become stacks of
    discs 5 cm high, and everything else boxes merged from voxels. Movable bodies stand where the model's reference
    puts them. A mesh is put upright, and its floor levelled at z = 0; a scene far from its origin is moved there.

    Args:
        path: of the file.
        bounds: (x_min, y_min, x_max, y_max) [m] in which the robot may walk, in the file's coordinates once it is
            upright; what lies outside is left out. By default the extent of a mesh, or of a model and two metres
            around it.
        up: which of a mesh file's axes is up; found by its floor if left out.

    Raises:
        InputError: the file is missing, unreadable or empty, is larger than `LARGEST.extent`, seems to be in other
            units than metres, has no floor, or does not fit the capacity of a scene.
    """
    file = Path(path)
    if bounds is not None:
        _check_bounds(bounds)
    if up is not None and up not in get_args(Up):
        raise InputError(f"The axis {up!r} is not known; give {', '.join(get_args(Up))} for the one that is up.")
    found = _parts_of(file, up)
    boxes = np.reshape([row for part in found.solids for row in part.boxes], (-1, 7))
    cylinders = np.reshape([row for part in found.solids for row in part.cylinders], (-1, 5))
    discs = np.reshape([row for part in found.solids for row in part.discs], (-1, 5))
    rest = [mesh for part in found.solids for mesh in part.rest]
    if not (len(boxes) or len(cylinders) or len(discs) or rest):
        raise InputError(f"{file} has nothing to walk around; add obstacles to the scene.")
    _check_sizes(file, boxes, cylinders)
    limits = bounds or _default_bounds(file, boxes, np.concatenate([cylinders, discs]), rest, found.margin)
    shift, notes = _shift_to_origin(limits), found.notes
    if shift.any():
        limits = (limits[0] + shift[0], limits[1] + shift[1], limits[2] + shift[0], limits[3] + shift[1])
        notes += (f"moved by {shift[0]:.0f}, {shift[1]:.0f} m to the origin, with start and goals",)
        for rows in (boxes, cylinders, discs):
            rows[:, :2] += shift
        rest = [mesh.copy().apply_translation((*shift, 0.0)) for mesh in rest]
    boxes, low_boxes = _kept(boxes, box_reach(boxes), boxes[:, 5], limits)
    cylinders, low_cylinders = _kept(cylinders, cylinders[:, [3, 3]], cylinders[:, 4], limits)
    discs, _ = _kept(discs, discs[:, [3, 3]], discs[:, 4], limits)
    low = low_boxes + low_cylinders
    if low:
        notes += (f"{low} that end at {100 * BAND[0]:.3g} cm or lower count as floor and were left out",)
    _check_capacity(file, len(boxes), len(cylinders) + len(discs))
    voxel, merged = _approximated(file, rest, limits, LARGEST.boxes - len(boxes), found.lowest)
    scene = Scene(
        file.stem,
        "user",
        np.concatenate([boxes, merged.boxes]),
        np.concatenate([cylinders, discs]),
        limits,
        found.ceiling,
    )
    if not (len(scene.boxes) or len(scene.cylinders)):
        raise InputError(f"{file} has nothing above its floor inside {limits}; give other bounds or add obstacles.")
    T = trimesh.transformations.translation_matrix([*shift, 0.0]) @ found.T_scene_file
    exact = len(boxes) + len(cylinders)
    return UserScene(
        scene, exact, len(discs), len(merged.boxes), voxel, merged.error, T, shift, found.lowest, notes, low
    )


def _parts_of(file: Path, up: Up | None) -> _Parts:
    suffix = file.suffix.lower()
    if suffix in MJCF_SUFFIXES:
        solids = solids_of_mjcf(*load_mjcf(file), reach=LARGEST.extent)
        parts = [recognise_solids(mesh) for mesh in solids.meshes]
        parts.append(MeshSolids(solids.boxes, solids.cylinders))
        left_out = (f"left out: {', '.join(solids.left_out)}",) if solids.left_out else ()
        return _Parts(parts, np.eye(4), left_out, solids.ceiling, _MARGIN)
    if suffix in UNREAD_SUFFIXES:
        raise InputError(f"{file} {UNREAD_SUFFIXES[suffix]}.")
    if suffix not in MESH_SUFFIXES:
        raise InputError(f"{file} has an unknown ending; give one of {', '.join((*MJCF_SUFFIXES, *MESH_SUFFIXES))}.")
    mesh = read_mesh(file)
    _check_units(file, mesh)
    frame = mesh_frame(file, mesh, up)
    mesh.apply_transform(frame.T_scene_file)
    width, depth, height = frame.size
    notes: tuple[str, ...] = (f"{width:.1f} x {depth:.1f} m and {height:.1f} m high with {frame.up} up", *frame.notes)
    lowest = max(BAND[0], _UNEVEN * frame.floor_noise)
    if lowest > BAND[0]:
        notes += (
            f"its floor is uneven by {100 * frame.floor_noise:.1f} cm, so that what ends below {100 * lowest:.0f} cm "
            "is left out",
        )
    return _Parts([recognise_solids(mesh)], frame.T_scene_file, notes, lowest=lowest)


def _shift_to_origin(bounds: Bounds) -> Float[np.ndarray, "2"]:
    """Whole metres that bring a scene to the origin if it is so far away that single precision would be coarse."""
    middle = np.array([bounds[0] + bounds[2], bounds[1] + bounds[3]]) / 2
    return -np.round(middle) + 0.0 if np.abs(middle).max() > _FAR_FROM_ORIGIN else np.zeros(2)


def _check_units(file: Path, mesh: trimesh.Trimesh) -> None:
    """Require plausible units."""
    size = float(mesh.extents.max())
    if size > _LARGEST:
        raise InputError(f"{file} spans {size:.0f} m; if it is in millimetres, scale it by 0.001, else cut it.")
    if size < _SMALLEST:
        raise InputError(f"{file} spans only {size:.3g} m; scale it to metres.")


def _check_bounds(bounds: Bounds) -> None:
    """Require a rectangle to walk in."""
    edges = as_doubles(bounds, "bounds")
    if edges.shape != (4,) or not np.isfinite(edges).all() or not (edges[:2] < edges[2:]).all():
        raise InputError(
            f"The bounds are {printable(bounds)}; give x_min, y_min, x_max, y_max [m], smaller ones first."
        )


def _check_sizes(file: Path, boxes: Float[np.ndarray, "n 7"], cylinders: Float[np.ndarray, "m 5"]) -> None:
    largest = max(boxes[:, 3:6].max(initial=0.0), cylinders[:, 3:5].max(initial=0.0))
    if not largest <= _LARGEST_SOLID:
        raise InputError(f"{file} has a solid of half size {largest:.3g} m; give its size in metres.")


def _default_bounds(
    file: Path,
    boxes: Float[np.ndarray, "n 7"],
    cylinders: Float[np.ndarray, "m 5"],
    meshes: list[trimesh.Trimesh],
    margin: float,
) -> Bounds:
    """The extent of everything that is not larger than a scene may be, and a margin.

    Raises:
        InputError: the extent is too large.
    """
    reach = box_reach(boxes)
    finite = reach.max(axis=1, initial=0.0) < LARGEST.extent
    ranges = [(boxes[finite, :2] - reach[finite], boxes[finite, :2] + reach[finite])]
    ranges.append((cylinders[:, :2] - cylinders[:, 3:4], cylinders[:, :2] + cylinders[:, 3:4]))
    ranges += [(mesh.bounds[:1, :2], mesh.bounds[1:, :2]) for mesh in meshes]
    low = np.concatenate([first for first, _ in ranges]).min(axis=0, initial=math.inf)
    high = np.concatenate([last for _, last in ranges]).max(axis=0, initial=-math.inf)
    side = float((high - low).max())
    if not side <= LARGEST.extent:
        raise InputError(f"{file} spans {side:.1f} m; give bounds with sides of at most {LARGEST.extent:.0f} m.")
    margin = min(margin, (LARGEST.extent - side) / 2)
    return (*(low - margin).tolist(), *(high + margin).tolist())


def _kept(
    solids: Float[np.ndarray, "n k"], reach: Float[np.ndarray, "n 2"], half: Float[np.ndarray, " n"], bounds: Bounds
) -> tuple[Float[np.ndarray, "m k"], int]:
    """Solids that come within a metre of the bounds and are obstacles; and how many others the feet clear."""
    low, high = np.array(bounds[:2]) - 1, np.array(bounds[2:]) + 1
    near = ((solids[:, :2] + reach >= low) & (solids[:, :2] - reach <= high)).all(axis=1)
    top = solids[:, 2] + half
    return solids[near & (top > BAND[0])], int((near & (top > _FLUSH) & (top <= BAND[0])).sum())


def _check_capacity(file: Path, boxes: int, cylinders: int) -> None:
    if boxes > LARGEST.boxes or cylinders > LARGEST.cylinders:
        raise InputError(
            f"{file} has {boxes} boxes and {cylinders} cylinders but at most {LARGEST.boxes} and {LARGEST.cylinders} "
            "fit; merge some or give smaller bounds."
        )


def _approximated(
    file: Path, meshes: list[trimesh.Trimesh], bounds: Bounds, most: int, lowest: float
) -> tuple[float, VoxelBoxes]:
    """Side [m] of the finest voxels whose boxes fit, and the boxes of what is above a height [m]."""
    if not meshes:
        return 0.0, VoxelBoxes(np.empty((0, 7)), 0.0)
    yaw, band = _grain(meshes), (lowest, BAND[1])
    surfaces = [sample_surface(mesh, VOXELS[0] / 2, band, bounds) for mesh in meshes]
    for pitch in VOXELS:
        merged = voxel_boxes(surfaces, pitch, band, bounds, yaw, most)
        if merged is not None:
            return (pitch if len(merged.boxes) else 0.0), merged
    raise InputError(
        f"{file} needs more than {most} boxes even with voxels of {100 * VOXELS[-1]:.0f} cm; simplify it or give "
        f"smaller bounds than {bounds[2] - bounds[0]:.0f} x {bounds[3] - bounds[1]:.0f} m."
    )


def _grain(meshes: list[trimesh.Trimesh]) -> float:
    """Direction [rad] of most of the upright surface, modulo a right angle."""
    normals = np.concatenate([mesh.face_normals for mesh in meshes])
    areas = np.concatenate([mesh.area_faces for mesh in meshes])
    walls = (np.abs(normals[:, 2]) < 0.1) & (areas > 0)
    degrees = np.degrees(np.arctan2(normals[walls, 1], normals[walls, 0])) % 90
    if not len(degrees):
        return 0.0
    counts = np.bincount(np.round(degrees).astype(int) % 90, weights=areas[walls], minlength=90)
    peak = int(counts.argmax())
    offset = (degrees - peak + 45) % 90 - 45
    near = np.abs(offset) < 1
    return math.radians(peak + float(np.average(offset[near], weights=areas[walls][near])))

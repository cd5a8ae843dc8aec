"""Which way is up in a mesh, where its floor is and how level and even: the frame in which it becomes a scene."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh
from jaxtyping import Float, Int

from iwalker_jax.errors import InputError

Up = Literal["x", "y", "z"]
"""Axis of a mesh that points up."""

_Y_UP_SUFFIXES = (".glb", ".gltf")
_LEVEL_FACE = math.cos(math.radians(30))
_BIN = 0.10
_LOWER_PART, _FLOOR_SHARE = 0.5, 0.2
_HIGH_ROOM, _ROOM_HEIGHT, _LARGER = 4.5, (1.9, 4.0), 1.5
_LEVEL_TILT, _MOST_TILT = math.radians(0.1), math.radians(6)
_LEVEL_OFFSET = 0.005
_EVEN = 0.003
_LEAST_REACH, _REACH, _NEAREST_REACH, _FITS = 0.3, 0.02, 0.03, 12
_TO_DEVIATION = 1.4826
"""Standard deviation of a normal distribution over its median distance from the mean."""

_ROTATIONS = {
    "x": np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]),
    "y": np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
    "z": np.eye(4),
}
"""T_upright_file for each axis that may be up."""


@dataclass(frozen=True, eq=False)
class MeshFrame:
    """How a mesh file's coordinates become a scene's.

    Attributes:
        T_scene_file: (4, 4) from the file's coordinates to the scene's, whose floor is z = 0.
        up: the file's axis that is up.
        size: (3,) [m] extents along x, y and up.
        floor_noise: [m] standard deviation of the floor's height.
        notes: what was changed or assumed, in words.
    """

    T_scene_file: Float[np.ndarray, "4 4"]
    up: Up
    size: Float[np.ndarray, "3"]
    floor_noise: float
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Floor:
    """The largest level surface in the lower half: its height [m], area [m^2] and share of the plan's area."""

    height: float
    area: float
    share: float


def mesh_frame(file: Path, mesh: trimesh.Trimesh, up: Up | None = None) -> MeshFrame:
    """The frame of a mesh: up as given or found by the floor, the floor levelled at z = 0.

    Args:
        file: that it is of; in glTF files y is up by convention, else z.
        mesh: in the file's coordinates [m].
        up: the file's axis that is up; by default the convention's, or another one if only that has a floor.

    Raises:
        InputError: no axis has a floor, or the floor slopes by more than a scan's error.
    """
    usual: Up = "y" if file.suffix.lower() in _Y_UP_SUFFIXES else "z"
    notes: list[str] = []
    if up is None:
        up = _found_up(file, mesh, usual)
        if up != usual:
            notes.append(f"its floor says that {up} is up, not {usual} as usual in {file.suffix} files")
    T = _ROTATIONS[up]
    upright = mesh.copy().apply_transform(T)
    floor, noise = _floor_of(upright, 2), 0.0
    if floor.share < _FLOOR_SHARE:
        notes.append(f"no floor was found, {up} = 0 is taken for it")
        if abs(upright.bounds[0, 2]) > _BIN:
            raise InputError(
                f"{file} has no floor and its lowest point is at {up} = {upright.bounds[0, 2]:.2f} m; move the scene "
                f"so that its floor is {up} = 0."
            )
    else:
        T_level, noise, levelled = _levelled(file, upright, floor.height)
        notes += levelled
        T = T_level @ T
        upright.apply_transform(T_level)
    return MeshFrame(T, up, upright.extents, noise, tuple(notes))


def _found_up(file: Path, mesh: trimesh.Trimesh, usual: Up) -> Up:
    """The usual axis, unless the scene would be without floor or too high and lies lower and on a floor another way."""
    floors = {axis: _floor_of(mesh, number) for number, axis in enumerate(_ROTATIONS)}
    heights = dict(zip(_ROTATIONS, mesh.extents.tolist(), strict=True))
    others: tuple[Up, ...] = ("z", "x") if usual == "y" else ("y", "x")
    lower = [axis for axis in others if heights[axis] < heights[usual] and floors[axis].share >= _FLOOR_SHARE]
    if floors[usual].share < _FLOOR_SHARE:
        if not lower:
            raise InputError(
                f"{file} has no floor by which to tell which way is up ({_sizes(mesh.extents)} along x, y and z): add "
                "one, or say with the option up which axis is up and has its floor at 0."
            )
        return lower[0]
    # Of a closed room the walls look like floors as well.
    for axis in lower:
        room_high = _ROOM_HEIGHT[0] < heights[axis] < _ROOM_HEIGHT[1] and heights[usual] > _HIGH_ROOM
        if room_high and floors[axis].area > _LARGER * floors[usual].area:
            return axis
    return usual


def _sizes(extents: Float[np.ndarray, "3"]) -> str:
    return " x ".join(f"{value:.1f}" for value in extents) + " m"


def _floor_of(mesh: trimesh.Trimesh, axis: int) -> _Floor:
    """The largest level surface in the lower half of a mesh, if an axis (0, 1, 2) is up."""
    low, high = mesh.bounds
    level = _level_faces(mesh, axis)
    heights, areas = mesh.triangles_center[level, axis] - low[axis], mesh.area_faces[level]
    if not len(heights):
        return _Floor(0.0, 0.0, 0.0)
    # A floor that slopes or is noisy spreads over several bins.
    counts = np.bincount((heights / _BIN).astype(int), weights=areas)
    around = np.convolve(counts, np.ones(3), mode="same")
    best = int(around.argmax())
    area, plan = float(around[best]), float(np.prod(np.delete(high - low, axis)))
    chosen = np.abs(heights / _BIN - best - 0.5) < 1.5
    height = _weighted_median(heights[chosen], areas[chosen]) + float(low[axis])
    return _Floor(height, area, area / plan if plan > 0 else 0.0)


def _level_faces(mesh: trimesh.Trimesh, axis: int) -> Int[np.ndarray, " n"]:
    """Level faces in the lower half that look up, or down where hardly any look up, as in rooms seen from outside."""
    low, high = mesh.bounds[:, axis]
    heights, slopes = mesh.triangles_center[:, axis] - low, mesh.face_normals[:, axis]
    lower = heights <= max(_LOWER_PART * (high - low), 2 * _BIN)
    up, down = lower & (slopes > _LEVEL_FACE), lower & (slopes < -_LEVEL_FACE)
    areas = mesh.area_faces
    return np.flatnonzero(up if areas[up].sum() >= areas[down].sum() / 2 else down)


def _weighted_median(values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"]) -> float:
    order = np.argsort(values)
    cumulative = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(cumulative, cumulative[-1] / 2)])


def _levelled(file: Path, mesh: trimesh.Trimesh, height: float) -> tuple[Float[np.ndarray, "4 4"], float, list[str]]:
    """What makes the floor z = 0, how uneven it is [m], and what is to be said of that.

    The floor is fitted by a plane to the level faces near it, again and again, each time nearer: first those that look
    up, wherever a slope has brought them, at last those within a few deviations.
    """
    level = _level_faces(mesh, 2)
    mean = (mesh.area_faces[level, None] * mesh.face_normals[level]).sum(axis=0)
    slope = math.atan2(math.hypot(mean[0], mean[1]), abs(mean[2]))
    if slope > _MOST_TILT:
        raise InputError(f"{file} has a floor that slopes by {math.degrees(slope):.0f} degrees; level the scene.")
    points, weights = mesh.triangles[level].reshape(-1, 3), np.repeat(mesh.area_faces[level] / 3, 3)
    middle = mesh.bounds[:, :2].mean(axis=0)
    design = np.column_stack([points[:, :2] - middle, np.ones(len(points))])
    plane, reach = np.array([0.0, 0.0, height]), max(_LEAST_REACH, _REACH * float(mesh.extents[:2].max()))
    deviation = 0.0
    for _ in range(_FITS):
        near = np.abs(points[:, 2] - design @ plane) < reach
        root = np.sqrt(weights[near])[:, None]
        plane = np.linalg.lstsq(design[near] * root, points[near, 2:] * root, rcond=None)[0][:, 0]
        # What stands on a floor lies above it, so that its noise shows below.
        below = design @ plane - points[:, 2]
        below_it = (below > 0) & (below < reach)
        if below_it.any():
            deviation = _TO_DEVIATION * _weighted_median(below[below_it], weights[below_it])
        reach = max(0.6 * reach, 4 * deviation, _NEAREST_REACH)
    tilt = math.atan(math.hypot(plane[0], plane[1]))
    if tilt > _MOST_TILT:
        raise InputError(f"{file} has a floor that slopes by {math.degrees(tilt):.0f} degrees; level the scene.")
    notes: list[str] = []
    T = np.eye(4)
    if tilt > _LEVEL_TILT:
        normal = np.array([-plane[0], -plane[1], 1.0]) / math.sqrt(1 + plane[0] ** 2 + plane[1] ** 2)
        axis = np.cross(normal, [0.0, 0.0, 1.0])
        T = trimesh.transformations.rotation_matrix(tilt, axis, [*middle, plane[2]])
        notes.append(f"levelled by {math.degrees(tilt):.1f} degrees")
    if abs(plane[2]) > _LEVEL_OFFSET:
        notes.append(f"its floor was at {plane[2]:.2f} m and is now at 0")
    if abs(plane[2]) > _LEVEL_OFFSET or tilt > _LEVEL_TILT:
        T = trimesh.transformations.translation_matrix([0.0, 0.0, -plane[2]]) @ T
    return T, deviation if deviation > _EVEN else 0.0, notes

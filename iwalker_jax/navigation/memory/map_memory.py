"""A short memory of what the camera saw: a window of the floor that moves with the robot, its axes the world's.

Single frames show nothing beside and behind the robot. Each frame adds evidence for occupied and for free cells; what
is seen to be free again is forgotten, so obstacles may move, and nothing else is: where the robot stands, and where
the view passes over the floor before it, is free if nobody knows better, but an obstacle that it brushes against and a
threshold before its feet are not. The window shifts by whole cells, so nothing is ever resampled twice, and by whole
cells of a route's map, so that a narrow gap on it does not open and close with the robot's place.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Int8, Num

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY, to_base
from iwalker_jax.perception import DEFAULT_GRID, FrameCells, GridSpec
from iwalker_jax.planning import MapCell

ROUTE_CELLS = 4
"""Cells of the memory along a side of a route's cell."""

LARGEST_SHIFT = 16
"""Cells between two frames; a robot that believes to have jumped farther starts afresh."""


@dataclass(frozen=True)
class MapMemoryParameters:
    """Size of the window and how evidence adds up.

    Attributes:
        resolution: [m] side of a cell, finer than the margin by which a body may pass a gap; cells: of a side of the
            window.
        body_radius: [m] about the base within which cells that are not occupied are free.
        occupied_evidence, free_evidence: of one frame that shows a cell occupied or free.
        max_evidence: largest evidence in size, so that a cell can change its state within a few frames.
        threshold: evidence from which a cell counts as occupied, or, negative, as free.
        decay: share of the evidence that is forgotten at each frame.
    """

    resolution: float = 0.025
    cells: int = 320
    body_radius: float = BODY.route_radius
    occupied_evidence: float = 1.0
    free_evidence: float = 0.7
    max_evidence: float = 4.0
    threshold: float = 0.9
    decay: float = 0.001

    def __post_init__(self) -> None:
        if self.cells < 2 * LARGEST_SHIFT or self.cells % (2 * ROUTE_CELLS) or not self.resolution > 0:
            raise InputError(
                f"The map memory needs a multiple of {2 * ROUTE_CELLS} cells, at least {2 * LARGEST_SHIFT}, and a "
                "positive resolution [m]."
            )
        if not 0 < self.threshold <= self.max_evidence or not 0 <= self.decay < 1:
            raise InputError("The map memory needs 0 < threshold <= max_evidence and 0 <= decay < 1.")
        if min(self.occupied_evidence, self.free_evidence, self.body_radius) <= 0:
            raise InputError("The map memory needs positive occupied_evidence, free_evidence and body_radius.")

    @property
    def frame_grid(self) -> GridSpec:
        """Where a frame's cells, as fine as the window's, lie in the base frame: over `DEFAULT_GRID`'s ground."""
        rows, columns = (round(n * DEFAULT_GRID.resolution / self.resolution) for n in DEFAULT_GRID.shape)
        return GridSpec(DEFAULT_GRID.x_min, DEFAULT_GRID.y_min, self.resolution, rows, columns)

    @property
    def grid(self) -> GridSpec:
        """Where the window's cells lie relative to its middle."""
        half = self.cells // 2 * self.resolution
        return GridSpec(-half, -half, self.resolution, self.cells, self.cells)

    @property
    def coarse_resolution(self) -> float:
        """[m] side of a cell of the wider maps beside the window."""
        return ROUTE_CELLS * self.resolution

    def coarse_grid(self, cells: int) -> GridSpec:
        """Where a wider map's cells, so many a side, lie relative to its middle, which is also the window's."""
        half = cells // 2 * self.coarse_resolution
        return GridSpec(-half, -half, self.coarse_resolution, cells, cells)


class MapMemory(NamedTuple):
    """Evidence about the cells of the window.

    Attributes:
        evidence: (cells, cells), positive for occupied.
        middle: (2,) int32, world cell at the window's middle (its lower corner lies there); a multiple of ROUTE_CELLS.
    """

    evidence: Float[Array, "n n"]
    middle: Int[Array, "2"]


def empty_memory(parameters: MapMemoryParameters, xy: Float[Array, "2"]) -> MapMemory:
    """Nothing known around a place [m]."""
    return MapMemory(jnp.zeros((parameters.cells, parameters.cells), xy.dtype), _cell(parameters, xy))


def window_origin(parameters: MapMemoryParameters, memory: MapMemory) -> Float[Array, "2"]:
    """World position [m] of the window's middle: subtract it from world points to sample on the memory's grid."""
    return memory.middle.astype(memory.evidence.dtype) * parameters.resolution


def moved_to(parameters: MapMemoryParameters, memory: MapMemory, xy: Float[Array, "2"]) -> MapMemory:
    """The memory with its window moved to a place [m], a frame later: what it knows has faded a little."""
    middle = _cell(parameters, xy)
    evidence = shifted(memory.evidence, middle - memory.middle, LARGEST_SHIFT) * (1 - parameters.decay)
    return MapMemory(evidence, middle)


def update_memory(
    parameters: MapMemoryParameters,
    memory: MapMemory,
    base: Float[Array, "3"],
    frame: FrameCells,
    grid: GridSpec = DEFAULT_GRID,
) -> MapMemory:
    """Memory moved to the robot's place and updated with one frame's map.

    Args:
        base: (x, y, yaw) of the base frame in the world.
        frame: its cells, on `grid` in the base frame.
    """
    memory = moved_to(parameters, memory, base[:2])
    evidence, middle = memory.evidence, memory.middle
    centres = parameters.grid.centres() + middle.astype(base.dtype) * parameters.resolution
    offsets = to_base(base, centres)
    cell = jnp.round(grid.cell_coordinates(offsets)).astype(jnp.int32)
    inside = jnp.all((cell >= 0) & (cell < jnp.asarray(grid.shape)), axis=-1)
    index = jnp.where(inside, cell[..., 0] * grid.columns + cell[..., 1], 0)
    seen = parameters.occupied_evidence * frame.occupied - parameters.free_evidence * frame.seen_free
    change = jnp.where(inside, seen.reshape(-1)[index], 0.0)
    # Under the body and below the view the floor is free, but for what is or was seen to be occupied: a threshold that
    # has left the view at the lower edge of the image is still there.
    presumed = jnp.sum(offsets**2, axis=-1) <= parameters.body_radius**2
    presumed |= inside & frame.known_free.reshape(-1)[index]
    change = jnp.where(presumed & (evidence < parameters.threshold) & (change <= 0), -parameters.free_evidence, change)
    return MapMemory(
        jnp.clip(evidence + change, -parameters.max_evidence, parameters.max_evidence).astype(memory.evidence.dtype),
        middle,
    )


def memory_cells(parameters: MapMemoryParameters, memory: MapMemory) -> tuple[Bool[Array, "n n"], Bool[Array, "n n"]]:
    """(occupied, unknown) cells of the window."""
    occupied = memory.evidence >= parameters.threshold
    return occupied, jnp.abs(memory.evidence) < min(parameters.threshold, parameters.free_evidence)


def map_cells(parameters: MapMemoryParameters, memory: MapMemory) -> Int8[Array, "n n"]:
    """The `MapCell` of every cell of the window."""
    occupied, unknown = memory_cells(parameters, memory)
    cells = jnp.where(occupied, MapCell.OCCUPIED, jnp.where(unknown, MapCell.UNSEEN, MapCell.FREE))
    return cells.astype(jnp.int8)


def recorded_window(xy: Float[np.ndarray, "2"], cells: int) -> tuple[Float[np.ndarray, "2"], float]:
    """Lower corner [m] of a window on record, in the world, and side [m] of its cells.

    The windows of all policies are as wide, in cells of different sizes.

    Args:
        xy: (2,) [m] where the robot believed to be when the window was written last.
        cells: on record along a side.
    """
    window = MapMemoryParameters()
    resolution = window.resolution * window.cells / cells
    step = ROUTE_CELLS * resolution
    return step * np.round(np.asarray(xy) / step) - cells // 2 * resolution, resolution


def _cell(parameters: MapMemoryParameters, xy: Float[Array, "2"]) -> Int[Array, "2"]:
    return ROUTE_CELLS * jnp.round(xy / (ROUTE_CELLS * parameters.resolution)).astype(jnp.int32)


def shifted(field: Num[Array, "n n"], shift: Int[Array, "2"], largest: int, fill: float = 0.0) -> Num[Array, "n n"]:
    """A map's content seen from a middle that lies `shift` cells farther on; after a larger shift, `fill` alone."""
    padded = jnp.pad(field, largest, constant_values=fill)
    start = jnp.clip(shift + largest, 0, 2 * largest)
    moved = jax.lax.dynamic_slice(padded, (start[0], start[1]), field.shape)
    return jnp.where(jnp.all(jnp.abs(shift) <= largest), moved, jnp.asarray(fill, field.dtype))


def centred(field: Num[Array, "a a"], cells: int, fill: float) -> Num[Array, "b b"]:
    """A square map in the middle of one of so many cells a side: cut, or with a margin that is filled."""
    missing = (cells - field.shape[0]) // 2
    if missing < 0:
        return field[-missing : missing or None, -missing : missing or None]
    return jnp.pad(field, missing, constant_values=fill)

"""A wide, coarse memory for a network that reads maps: what was seen of each place, and how often the robot came by.

The window of the map memory is small, and of places that look alike it does not tell which were tried. A robot that
sees where a wall went on, and where it has been, need not go to and fro before it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Int8

from iwalker_jax.checks import require_whole
from iwalker_jax.errors import InputError
from iwalker_jax.navigation.memory.map_memory import (
    LARGEST_SHIFT,
    ROUTE_CELLS,
    MapMemory,
    MapMemoryParameters,
    centred,
    map_cells,
    shifted,
    window_origin,
)
from iwalker_jax.planning import MapCell


@dataclass(frozen=True)
class WideMemoryParameters:
    """Size of the wide map, and what counts as a visit.

    Attributes:
        cells: of a side; a cell is `ROUTE_CELLS` of the map memory's wide.
        visit_spacing: [m] that the robot goes between one visit and the next: sway at a place is none.
        visit_radius: [m] about the robot that a visit covers.
    """

    cells: int = 96
    visit_spacing: float = 0.2
    visit_radius: float = 0.3

    def __post_init__(self) -> None:
        require_whole(self.cells, "WideMemoryParameters.cells")
        if self.cells < 2 or self.cells % 2 or not min(self.visit_spacing, self.visit_radius) > 0:
            raise InputError(
                "WideMemoryParameters needs an even, positive number of cells and a positive visit_spacing and "
                "visit_radius [m]."
            )


class WideMemory(NamedTuple):
    """What is known of the coarse cells, the first index along x, the second along y of the world.

    Attributes:
        cells: `MapCell`: occupied if anything in a cell is, unseen if all of it is.
        visits: how often the robot came by.
        last_visit: (2,) [m] world, where the robot was at the last one, or began.
        middle: (2,) int32, world cell at the map's middle (its lower corner lies there).
    """

    cells: Int8[Array, "n n"]
    visits: Float[Array, "n n"]
    last_visit: Float[Array, "2"]
    middle: Int[Array, "2"]


def empty_wide_memory(parameters: WideMemoryParameters, window: MapMemoryParameters, near: MapMemory) -> WideMemory:
    """Nothing known, and nowhere been, around the middle of a window."""
    shape = (parameters.cells, parameters.cells)
    here = window_origin(window, near)
    return WideMemory(jnp.zeros(shape, jnp.int8), jnp.zeros(shape, here.dtype), here, near.middle // ROUTE_CELLS)


def update_wide_memory(
    parameters: WideMemoryParameters,
    window: MapMemoryParameters,
    memory: WideMemory,
    near: MapMemory,
    xy: Float[Array, "2"],
) -> WideMemory:
    """The memory moved along with the window, with what the window shows and the robot's place.

    Args:
        parameters: of the wide map.
        window: of the fine one.
        memory: as it was.
        near: the window at this frame.
        xy: (2,) [m] of the robot, world.
    """
    middle = near.middle // ROUTE_CELLS
    shift, largest = middle - memory.middle, LARGEST_SHIFT // ROUTE_CELLS
    cells, visits = shifted(memory.cells, shift, largest), shifted(memory.visits, shift, largest)
    side = window.cells // ROUTE_CELLS
    # `MapCell` rises from unseen over free to occupied.
    coarse = map_cells(window, near).reshape(side, ROUTE_CELLS, side, ROUTE_CELLS).max(axis=(1, 3))
    # What has been walked through the window without being seen again is remembered as it was.
    coarse = centred(coarse, parameters.cells, MapCell.UNSEEN)
    cells = jnp.where(coarse == MapCell.UNSEEN, cells, coarse)

    grid = window.coarse_grid(parameters.cells)
    offsets = grid.centres() + middle.astype(xy.dtype) * grid.resolution - xy
    covered = jnp.sum(offsets**2, axis=-1) < parameters.visit_radius**2
    moved_on = jnp.sum((xy - memory.last_visit) ** 2) > parameters.visit_spacing**2
    return WideMemory(
        cells=cells,
        visits=visits + (moved_on & covered),
        last_visit=jnp.where(moved_on, xy, memory.last_visit),
        middle=middle,
    )

"""A long memory for routes: coarse cells over a wider stretch of floor than the map memory's window.

The window of the map memory is fine, and so it is small: what lies farther off than its rim would be forgotten, and a
goal just beyond it would seem to be reached in a straight line through a wall that was seen a moment ago. Here the last
that was known of each coarse cell stays until the robot has gone much farther. Near the window's rim distances are to
the obstacles inside alone, so its rim is not written.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.navigation.memory.map_memory import (
    LARGEST_SHIFT,
    ROUTE_CELLS,
    MapMemory,
    MapMemoryParameters,
    centred,
    memory_cells,
    shifted,
)
from iwalker_jax.perception import GridSpec, pool_2x2, signed_distance_field

_FAR = 10.0  # [m] clearance of cells that were never seen


@dataclass(frozen=True)
class RouteMemoryParameters:
    """Size of the coarse map.

    Attributes:
        cells: of a side; a cell is `ROUTE_CELLS` of the map memory's wide.
        rim: [m] of the map memory's window whose distances are not trusted: from where clearance no longer matters.
    """

    cells: int = 160
    rim: float = 0.5

    def __post_init__(self) -> None:
        if self.cells < 2 or self.cells % 2 or self.rim < 0:
            raise InputError("RouteMemoryParameters needs an even, positive number of cells and rim >= 0 [m].")


class RouteMemory(NamedTuple):
    """What is known of the coarse cells, the first index along x, the second along y of the world.

    Attributes:
        clearance: [m] mean over a cell; room: [m] of its best place.
        unseen: share that was not seen.
        middle: (2,) int32, world cell at the map's middle (its lower corner lies there).
    """

    clearance: Float[Array, "n n"]
    room: Float[Array, "n n"]
    unseen: Float[Array, "n n"]
    middle: Int[Array, "2"]


def route_grid(parameters: RouteMemoryParameters, window: MapMemoryParameters) -> GridSpec:
    """Where the coarse cells lie relative to the middle, which is also the window's."""
    return window.coarse_grid(parameters.cells)


def empty_route_memory(parameters: RouteMemoryParameters, cells: MapMemory) -> RouteMemory:
    """Nothing known around the middle of a window."""
    shape = (parameters.cells, parameters.cells)
    far = jnp.full(shape, _FAR, cells.evidence.dtype)
    return RouteMemory(far, far, jnp.ones(shape, cells.evidence.dtype), cells.middle // ROUTE_CELLS)


def update_route_memory(
    parameters: RouteMemoryParameters,
    window: MapMemoryParameters,
    memory: RouteMemory,
    cells: MapMemory,
) -> tuple[RouteMemory, Float[Array, "fine fine"]]:
    """The memory moved along with the window and with what the window shows, and the window's distance field [m].

    Args:
        parameters: of the coarse map.
        window: of the fine one.
        memory: as it was.
        cells: the window at this frame.
    """
    occupied, unknown = memory_cells(window, cells)
    esdf = signed_distance_field(occupied, window.resolution)
    middle = cells.middle // ROUTE_CELLS
    shift = middle - memory.middle
    written = _written(parameters, window)

    def updated(before: Float[Array, "n n"], now: Float[Array, "quarter quarter"], nothing: float) -> Array:
        moved = shifted(before, shift, LARGEST_SHIFT // ROUTE_CELLS, nothing)
        return jnp.where(written, centred(now, parameters.cells, nothing), moved)

    updated_memory = RouteMemory(
        clearance=updated(memory.clearance, _coarse(esdf), _FAR),
        room=updated(memory.room, _roomiest(esdf), _FAR),
        unseen=updated(memory.unseen, _coarse(unknown.astype(esdf.dtype)), 1.0),
        middle=middle,
    )
    return updated_memory, esdf


def _written(parameters: RouteMemoryParameters, window: MapMemoryParameters) -> Bool[Array, "n n"]:
    """The coarse cells that lie in the window but not in its rim."""
    offsets = jnp.abs(route_grid(parameters, window).centres()).max(axis=-1)
    return offsets < window.cells // 2 * window.resolution - parameters.rim


def _coarse(field: Float[Array, "n n"]) -> Float[Array, "quarter quarter"]:
    """Mean of a field of the window over each of the routes' cells."""
    return pool_2x2(pool_2x2(field))


def _roomiest(esdf: Float[Array, "n n"]) -> Float[Array, "quarter quarter"]:
    """Clearance [m] of the best place in each of the routes' cells: a gap that the body just fits is a line of fine
    cells, or lies between two of them."""
    cells = esdf.shape[0] // ROUTE_CELLS
    best = jnp.maximum(_highest_along(esdf), _highest_along(esdf.T).T)
    return best.reshape(cells, ROUTE_CELLS, cells, ROUTE_CELLS).max(axis=(1, 3))


def _highest_along(field: Float[Array, "n m"]) -> Float[Array, "n m"]:
    """A field's values, or, where it rises towards the next row from both sides, the height at which the slopes meet.

    Between an even number of free cells the middle line of a gap lies on a border of cells: their values alone would
    not tell such a gap from one that is a cell narrower.
    """
    before, here, after, beyond = field[:-3], field[1:-2], field[2:-1], field[3:]
    rise, fall = here - before, after - beyond
    ridge = (rise > 0) & (fall > 0)
    share = jnp.clip((after - here + fall) / jnp.where(ridge, rise + fall, 1.0), 0.0, 1.0)
    return field.at[1:-2].max(jnp.where(ridge, here + share * rise, here))

"""The map memories read by a network: polar, about the robot, turned to the goal."""

import math
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Int8

from iwalker_jax.geometry import angle_between, safe_norm, turn
from iwalker_jax.navigation.memory.map_memory import MapMemory, MapMemoryParameters, map_cells
from iwalker_jax.navigation.memory.wide_memory import WideMemory
from iwalker_jax.planning import MapCell, MapView, MapViewParameters


class ViewPoint(NamedTuple):
    """Where a map is read from.

    Attributes:
        base: (x, y, yaw) of the base frame in the world.
        goal: (2,) [m] world.
        course: (2,) unit vector in which the last path began, world axes; zero before the first.
    """

    base: Float[Array, "3"]
    goal: Float[Array, "2"]
    course: Float[Array, "2"]


def view_map(
    parameters: MapViewParameters, window: MapMemoryParameters, memory: MapMemory, wide: WideMemory, at: ViewPoint
) -> tuple[MapView, Float[Array, ""]]:
    """The view from a pose, and the bearing [rad] of the goal in the world, from which it is taken.

    Args:
        parameters: of the view.
        window: of the memory.
        memory: the map; wide: the wider one.
        at: from where.
    """
    offset = at.goal - at.base[:2]
    distance, bearing = safe_norm(offset), jnp.arctan2(offset[1], offset[0])
    angles = (jnp.arange(parameters.bearings) + 0.5) / parameters.bearings * 2 * math.pi - math.pi + bearing
    directions = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)

    def read(
        cells: Int8[Array, "n n"], middle: Int[Array, "2"], resolution: float, samples: int, apart: float
    ) -> Array:
        points = at.base[:2] + directions[:, None, :] * ((jnp.arange(samples) + 1.0) * apart)[:, None]
        size = cells.shape[0]
        cell = jnp.floor(points / resolution).astype(jnp.int32) - middle + size // 2
        inside = jnp.all((cell >= 0) & (cell < size), axis=-1)
        flat = jnp.where(inside, cell[..., 0] * size + cell[..., 1], 0)
        return jnp.where(inside, cells.reshape(-1)[flat], jnp.int8(MapCell.UNSEEN))

    fine = read(map_cells(window, memory), memory.middle, window.resolution, parameters.samples, parameters.spacing)
    visits = jnp.minimum(wide.visits, parameters.most_visits).astype(jnp.int8)
    coarse, visited = (
        read(cells, wide.middle, window.coarse_resolution, parameters.wide_samples, parameters.wide_spacing)
        for cells in (wide.cells, visits)
    )
    heading = angle_between(at.base[2], bearing)
    numbers = jnp.stack(
        [
            jnp.minimum(distance, parameters.far_goal) / (0.5 * parameters.far_goal) - 1.0,
            jnp.minimum(distance, parameters.near_goal) / (0.5 * parameters.near_goal) - 1.0,
            jnp.cos(heading),
            jnp.sin(heading),
            *turn(-bearing, at.course),
        ]
    )
    return MapView(fine, coarse, visited, numbers), bearing

"""The map memory read by a network: polar, about the robot, turned to the goal."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.geometry import angle_between, safe_norm
from iwalker_jax.navigation.memory.map_memory import MapMemory, MapMemoryParameters, map_cells
from iwalker_jax.planning import MapCell, MapView, MapViewParameters


def view_map(
    parameters: MapViewParameters,
    window: MapMemoryParameters,
    memory: MapMemory,
    base: Float[Array, "3"],
    goal: Float[Array, "2"],
) -> tuple[MapView, Float[Array, ""]]:
    """The view from a pose, and the bearing [rad] of the goal in the world, from which it is taken.

    Args:
        parameters: of the view.
        window: of the memory.
        memory: the map.
        base: (x, y, yaw) of the base frame in the world.
        goal: (2,) [m] world.
    """
    offset = goal - base[:2]
    distance, bearing = safe_norm(offset), jnp.arctan2(offset[1], offset[0])
    angles = (jnp.arange(parameters.bearings) + 0.5) / parameters.bearings * 2 * math.pi - math.pi + bearing
    ranges = (jnp.arange(parameters.samples) + 1.0) * parameters.spacing
    directions = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)
    points = base[:2] + directions[:, None, :] * ranges[:, None]
    cell = jnp.floor(points / window.resolution).astype(jnp.int32) - memory.middle + window.cells // 2
    inside = jnp.all((cell >= 0) & (cell < window.cells), axis=-1)
    flat = jnp.where(inside, cell[..., 0] * window.cells + cell[..., 1], 0)
    known = map_cells(window, memory).reshape(-1)[flat]
    cells = jnp.where(inside, known, jnp.int8(MapCell.UNSEEN))
    heading = angle_between(base[2], bearing)
    numbers = jnp.stack(
        [
            jnp.minimum(distance, parameters.far_goal) / (0.5 * parameters.far_goal) - 1.0,
            jnp.minimum(distance, parameters.near_goal) / (0.5 * parameters.near_goal) - 1.0,
            jnp.cos(heading),
            jnp.sin(heading),
        ]
    )
    return MapView(cells, numbers), bearing

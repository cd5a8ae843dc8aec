"""A range scan written into the map memory: a tenth of the work of counting points cell by cell."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.geometry import to_base, to_world
from iwalker_jax.navigation.memory.map_memory import MapMemory, MapMemoryParameters, moved_to
from iwalker_jax.perception import RangeScan
from iwalker_jax.perception.local_map import bearing_bin

SCAN_MEMORY = MapMemoryParameters(resolution=0.05, cells=160)
"""The window that scans are written into where a network reads it: as wide as the classical planner's, half as fine."""


def add_scan(
    parameters: MapMemoryParameters,
    memory: MapMemory,
    base: Float[Array, "3"],
    scan: RangeScan,
    camera_xy: Float[Array, "2"],
) -> MapMemory:
    """The memory moved to the robot's place, with one scan's evidence.

    What is remembered to be occupied is forgotten where the floor is seen to be free, as in `update_memory`.

    Args:
        parameters: of the memory.
        memory: as it was.
        base: (x, y, yaw) of the base frame in the world.
        scan: of an image taken there.
        camera_xy: (2,) [m] of the camera in the base frame, where the scan's bearings begin.
    """
    moved = moved_to(parameters, memory, base[:2])
    evidence = moved.evidence
    dtype = evidence.dtype
    origin = moved.middle.astype(dtype) * parameters.resolution
    grid = parameters.grid
    at_base = to_base(base, grid.centres() + origin)
    ahead, left = at_base[..., 0] - camera_xy[0], at_base[..., 1] - camera_xy[1]
    distance = jnp.sqrt(ahead**2 + left**2)
    bins = scan.first.shape[0]
    index = bearing_bin(ahead, left, distance, bins)
    # A cell that an obstacle's near edge cuts is not free.
    limit = jnp.minimum(scan.first - parameters.resolution, scan.farthest)
    in_view = distance < limit.at[index].get(mode="fill", fill_value=0.0)
    # Between the robot and the lower edge of the image a low obstacle may stand unseen.
    below_view = distance < scan.nearest.at[index].get(mode="fill", fill_value=jnp.inf)

    points = to_world(base, jnp.stack([scan.x, scan.y], axis=-1)) - origin
    cell = jnp.floor(points / parameters.resolution).astype(jnp.int32) + parameters.cells // 2
    inside = scan.surface & jnp.all((cell >= 0) & (cell < parameters.cells), axis=-1)
    flat = jnp.where(inside, cell[..., 0] * parameters.cells + cell[..., 1], parameters.cells**2).ravel()
    occupied = jnp.zeros(parameters.cells**2, bool).at[flat].set(True, mode="drop").reshape(evidence.shape)

    presumed = (jnp.sum(at_base**2, axis=-1) <= parameters.body_radius**2) | (in_view & below_view)
    free = (in_view & ~below_view) | (presumed & (evidence < parameters.threshold))
    change = jnp.where(occupied, parameters.occupied_evidence, jnp.where(free, -parameters.free_evidence, 0.0))
    limit_of = parameters.max_evidence
    return moved._replace(evidence=jnp.clip(evidence + change, -limit_of, limit_of).astype(dtype))

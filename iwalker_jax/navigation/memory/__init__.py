"""What the robot remembers of the floor: a fine window near it, and a wider, coarser map for routes."""

from iwalker_jax.navigation.memory.map_memory import (
    MapMemory,
    MapMemoryParameters,
    empty_memory,
    map_cells,
    memory_cells,
    recorded_window,
    update_memory,
    window_origin,
)
from iwalker_jax.navigation.memory.polar_view import ViewPoint, view_map
from iwalker_jax.navigation.memory.route_memory import (
    RouteMemory,
    RouteMemoryParameters,
    empty_route_memory,
    route_grid,
    update_route_memory,
)
from iwalker_jax.navigation.memory.scan_update import SCAN_MEMORY, add_scan
from iwalker_jax.navigation.memory.wide_memory import (
    WideMemory,
    WideMemoryParameters,
    empty_wide_memory,
    update_wide_memory,
)

__all__ = [
    "SCAN_MEMORY",
    "MapMemory",
    "MapMemoryParameters",
    "RouteMemory",
    "RouteMemoryParameters",
    "ViewPoint",
    "WideMemory",
    "WideMemoryParameters",
    "add_scan",
    "empty_memory",
    "empty_route_memory",
    "empty_wide_memory",
    "map_cells",
    "memory_cells",
    "recorded_window",
    "route_grid",
    "update_memory",
    "update_route_memory",
    "update_wide_memory",
    "view_map",
    "window_origin",
]

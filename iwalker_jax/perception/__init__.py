"""From one depth image to maps: clean-up, floor, occupancy, distance field, cost-to-go."""

from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.perception.cost_to_go import cost_to_go, descend
from iwalker_jax.perception.depth_png import read_depth, write_depth
from iwalker_jax.perception.distance_field import distance_transform, signed_distance_field
from iwalker_jax.perception.grid import DEFAULT_GRID, PUBLISHED_GRID, GridSpec
from iwalker_jax.perception.local_map import LocalMap, build_local_map
from iwalker_jax.perception.map_sampling import sample_bilinear, sample_smooth
from iwalker_jax.perception.traversal import TraversalParameters, traversal_cost

__all__ = [
    "DEFAULT_GRID",
    "PUBLISHED_GRID",
    "CameraMount",
    "GridSpec",
    "Intrinsics",
    "LocalMap",
    "TraversalParameters",
    "build_local_map",
    "cost_to_go",
    "descend",
    "distance_transform",
    "read_depth",
    "sample_bilinear",
    "sample_smooth",
    "signed_distance_field",
    "traversal_cost",
    "write_depth",
]

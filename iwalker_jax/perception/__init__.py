"""From one depth image to maps: clean-up, floor, occupancy, distance field, cost-to-go."""

from iwalker_jax.perception.camera import CameraMount, Intrinsics, backproject, camera_pose, strided
from iwalker_jax.perception.collision_map import DEFAULT_OBSTACLES, ObstacleParameters
from iwalker_jax.perception.cost_to_go import UNREACHABLE, CostToGo, cost_to_go, descend, trusted_cost
from iwalker_jax.perception.depth_cleanup import (
    MAX_RANGE,
    check_depth_image,
    clean_depth,
    depth_from_uint16,
    resize_depth,
)
from iwalker_jax.perception.depth_png import read_depth, write_depth
from iwalker_jax.perception.distance_field import distance_transform, signed_distance_field
from iwalker_jax.perception.floor import FloorFit, FloorParameters, MountUncertainty, align_to_floor, fit_floor
from iwalker_jax.perception.grid import DEFAULT_GRID, PUBLISHED_GRID, GridSpec, halved, pool_2x2, softened
from iwalker_jax.perception.local_map import FrameCells, LocalMap, build_local_map, frame_cells
from iwalker_jax.perception.map_sampling import sample_bilinear, sample_smooth
from iwalker_jax.perception.range_scan import RangeScan, ScanParameters, range_scan
from iwalker_jax.perception.seen_route import ROUTE_GRID, ROUTE_POINTS, Routes, best_routes
from iwalker_jax.perception.soft_map import SoftMap, SoftOccupancy, soft_map
from iwalker_jax.perception.traversal import TraversalParameters, traversal_cost

__all__ = [
    "DEFAULT_GRID",
    "DEFAULT_OBSTACLES",
    "MAX_RANGE",
    "PUBLISHED_GRID",
    "ROUTE_GRID",
    "ROUTE_POINTS",
    "UNREACHABLE",
    "CameraMount",
    "CostToGo",
    "FloorFit",
    "FloorParameters",
    "FrameCells",
    "GridSpec",
    "Intrinsics",
    "LocalMap",
    "MountUncertainty",
    "ObstacleParameters",
    "RangeScan",
    "Routes",
    "ScanParameters",
    "SoftMap",
    "SoftOccupancy",
    "TraversalParameters",
    "align_to_floor",
    "backproject",
    "best_routes",
    "build_local_map",
    "camera_pose",
    "check_depth_image",
    "clean_depth",
    "cost_to_go",
    "depth_from_uint16",
    "descend",
    "distance_transform",
    "fit_floor",
    "frame_cells",
    "halved",
    "pool_2x2",
    "range_scan",
    "read_depth",
    "resize_depth",
    "sample_bilinear",
    "sample_smooth",
    "signed_distance_field",
    "soft_map",
    "softened",
    "strided",
    "traversal_cost",
    "trusted_cost",
    "write_depth",
]

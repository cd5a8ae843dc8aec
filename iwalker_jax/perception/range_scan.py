"""A depth image as a range scan: along each bearing, how far the floor is free and where the first obstacle stands.

A light reading of an image, for a network that reads a map and for maps written at thousands of frames a second; what
single cells show, with counts of points, is `local_map.frame_cells`.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.perception.collision_map import ObstacleParameters, classify_points, point_planes
from iwalker_jax.perception.local_map import bearing_bin, bearing_bin_count, bearing_ranges


@dataclass(frozen=True)
class ScanParameters:
    """Which points of an image count.

    Attributes:
        obstacles: heights of what stands in the way.
        support: [m] and support_slope: [m/m] of range, by which a point and one above or below it in the image may
            differ in range to support each other; a point without support is noise.
        depth: [m] behind the first obstacle of a bearing, within which points are written as its surface.
    """

    obstacles: ObstacleParameters = ObstacleParameters()
    support: float = 0.15
    support_slope: float = 0.05
    depth: float = 0.08

    def __post_init__(self) -> None:
        if not min(self.support, self.depth) > 0 or self.support_slope < 0:
            raise InputError("ScanParameters needs positive support and depth [m] and support_slope >= 0.")


class RangeScan(NamedTuple):
    """What one image shows, along bearings seen from the camera and as points.

    Attributes:
        first: (bins,) [m] horizontal range to the first obstacle or drop; infinite where there is none.
        farthest: (bins,) [m] to the farthest floor or obstacle seen; nearest: to the nearest.
        x, y: (height, width) [m] of every point in the base frame; surface: which of them lie on the first obstacles.
    """

    first: Float[Array, " bins"]
    farthest: Float[Array, " bins"]
    nearest: Float[Array, " bins"]
    x: Float[Array, "height width"]
    y: Float[Array, "height width"]
    surface: Bool[Array, "height width"]


def range_scan(
    depth: Float[Array, "height width"],
    mount: Float[Array, " 5"],
    intrinsics: Intrinsics,
    parameters: ScanParameters = ScanParameters(),
) -> RangeScan:
    """The scan of a cleaned depth image.

    Args:
        depth: z-depth [m], 0 = no return (`clean_depth`).
        mount: [height, pitch, roll, forward, left] as in `CameraMount`.
        intrinsics: of this image size.
        parameters: which points count.

    Raises:
        InputError: if the image has another size than its intrinsics.
    """
    points = point_planes(depth, mount, intrinsics)
    floor, obstacle, drop = classify_points(points, parameters.obstacles)
    ranges = points.ground_range
    solid = points.valid & ~floor & ~drop  # what is too high to stand in the way supports what is not
    tolerance = parameters.support + parameters.support_slope * ranges

    def supported_by(step: int) -> Array:
        near = jnp.abs(jnp.roll(ranges, step, axis=0) - ranges) < tolerance
        return near & jnp.roll(solid, step, axis=0)

    obstacle &= supported_by(1) | supported_by(-1)
    ends = obstacle | drop
    bins = bearing_bin_count(intrinsics)
    pixel_bin = bearing_bin(points.x - mount[3], points.y - mount[4], ranges, bins)
    first, farthest, nearest = bearing_ranges(ranges, pixel_bin, bins, ends, floor | obstacle)
    end = first.at[pixel_bin].get(mode="fill", fill_value=-jnp.inf)
    return RangeScan(first, farthest, nearest, points.x, points.y, ends & (ranges < end + parameters.depth))

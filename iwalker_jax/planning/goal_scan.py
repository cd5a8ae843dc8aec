"""What stands in the way, by bearing from the goal's direction: a range scan turned so that the goal lies ahead."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.checks import require_plain_numbers
from iwalker_jax.errors import InputError
from iwalker_jax.perception import DEFAULT_OBSTACLES, ObstacleParameters


@dataclass(frozen=True)
class GoalScan:
    """Bins of the scan and what counts as an obstacle in it.

    Attributes:
        bins: number of bearings.
        half_span: [rad] the bins cover +- this angle about the goal's bearing.
        low, high: [m] heights above the floor between which a point is an obstacle.
        low_slope: [m/m] by which the lower height grows with distance from the robot, as range noise and tilt errors
            do, without the bounds that the map's obstacles have.
        nearest: [m] where inverse ranges saturate.
        reach: [m] by which seen extents are scaled.
    """

    bins: int = 80
    half_span: float = 2.1
    low: float = 0.06
    low_slope: float = 0.03
    high: float = DEFAULT_OBSTACLES.max_height
    nearest: float = 0.25
    reach: float = 6.0

    def __post_init__(self) -> None:
        require_plain_numbers(self)
        if not 4 <= self.bins <= 4096 or not 0 < self.half_span <= np.pi or not self.low < self.high:
            raise InputError("GoalScan needs 4 to 4096 bins, a half span in (0, pi] rad and low < high [m].")
        _ = self.obstacles  # which has checks of its own

    @property
    def obstacles(self) -> ObstacleParameters:
        """What counts as an obstacle, in the terms of the maps."""
        return ObstacleParameters(
            min_height=self.low,
            max_height=self.high,
            tolerance_range=0.0,
            tolerance_slope=self.low_slope,
            max_tolerance=_UNBOUNDED * self.high,
        )


SCAN_CHANNELS = 3
_UNBOUNDED = 0.999
"""Share of the upper height at which the lower one stops to grow, far beyond the depth camera's range."""


def goal_scan(
    points: Float[Array, "height width 3"],
    valid: Float[Array, "height width"],
    ahead: Float[Array, " 2"],
    scan: GoalScan,
) -> Float[Array, "bins 3"]:
    """For every bearing: inverse range of the nearest obstacle, extent of what was seen, and whether anything was.

    Rotating world, goal and robot's heading together leaves the scan as it is: an obstacle between robot and goal looks
    the same wherever the goal lies.

    Args:
        points: [m] base frame.
        valid: 1 where the pixel has a return.
        ahead: unit vector towards the goal, base frame.
        scan: bins and heights.
    """
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    forward = x * ahead[0] + y * ahead[1]
    left = y * ahead[0] - x * ahead[1]
    distance = jnp.sqrt(forward**2 + left**2 + 1e-6)
    bearing = jnp.arctan2(left, forward)
    index = jnp.floor((bearing + scan.half_span) * (scan.bins / (2 * scan.half_span))).astype(jnp.int32)
    within = (valid > 0) & (index >= 0) & (index < scan.bins) & (z < scan.obstacles.max_height)
    obstacle = within & (z > scan.obstacles.floor_band(distance)[1])
    # Bin number `bins` does not exist: what does not count is dropped there.
    inverse = (
        jnp.zeros(scan.bins)
        .at[jnp.where(obstacle, index, scan.bins)]
        .max(1.0 / jnp.maximum(distance, scan.nearest), mode="drop")
    )
    extent = (
        jnp.zeros(scan.bins)
        .at[jnp.where(within, index, scan.bins)]
        .max(jnp.minimum(distance / scan.reach, 1.0), mode="drop")
    )
    return jnp.stack([inverse, extent, (extent > 0).astype(extent.dtype)], axis=-1)

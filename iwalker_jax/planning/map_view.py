"""What a network reads of a remembered map: a polar map about the robot, turned to the goal.

Turned to the goal, the same place looks the same from wherever the robot came, whichever way it faces. Bearings lie
evenly and symmetrically about the goal's, so that the mirrored world is the map read backwards.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int8

from iwalker_jax.checks import require_whole
from iwalker_jax.errors import InputError


class MapCell(IntEnum):
    """What a cell of a remembered map is held for."""

    UNSEEN = 0
    FREE = 1
    OCCUPIED = 2


GOAL_FEATURES = 4
"""Numbers that tell of goal and heading."""


@dataclass(frozen=True)
class MapViewParameters:
    """How the polar map is sampled.

    Attributes:
        bearings: directions, evenly spaced.
        rings: of the polar map; samples_per_ring: places along each bearing, `spacing` [m] apart.
        far_goal: [m] distance from which goals look alike; near_goal: below which they are told apart finely.
    """

    bearings: int = 72
    rings: int = 16
    samples_per_ring: int = 4
    spacing: float = 0.05
    far_goal: float = 6.0
    near_goal: float = 1.6

    def __post_init__(self) -> None:
        for name, most in (("bearings", 1000), ("rings", 1000), ("samples_per_ring", 100)):
            require_whole(getattr(self, name), f"MapViewParameters.{name}")
            if not 1 <= getattr(self, name) <= most:
                raise InputError(f"MapViewParameters.{name} must lie in 1..{most}.")
        if not 0 < self.spacing < 1:
            raise InputError("MapViewParameters needs a spacing in (0, 1) m.")
        if not 0 < self.near_goal <= self.far_goal:
            raise InputError("MapViewParameters needs 0 < near_goal <= far_goal [m].")

    @property
    def samples(self) -> int:
        """Along each bearing."""
        return self.rings * self.samples_per_ring


class MapView(NamedTuple):
    """The map as seen towards the goal.

    Attributes:
        cells: (bearings, samples) `MapCell` of the place at each bearing and range, int8: it is stored by the million.
        goal: (4,) distance to the goal, coarse and fine, cosine and sine of the heading seen from the goal's bearing.
    """

    cells: Int8[Array, "*batch bearings samples"]
    goal: Float[Array, "*batch 4"]

    def mirrored(self) -> "MapView":
        """The view of the mirror-image world."""
        flip = jnp.asarray([1.0, 1.0, 1.0, -1.0], self.goal.dtype)
        return MapView(self.cells[..., ::-1, :], self.goal * flip)

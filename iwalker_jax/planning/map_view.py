"""What a network reads of a remembered map: polar maps about the robot, turned to the goal.

A fine map tells where the body fits; a wide, coarse one where walls go on, what was never seen, and where the robot
has been already. Turned to the goal, the same place looks the same from wherever the robot came, whichever way it
faces. Bearings lie evenly and symmetrically about the goal's, so that the mirrored world is the map read backwards.
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


GOAL_FEATURES = 6
"""Numbers that tell of goal, heading and course."""


@dataclass(frozen=True)
class MapViewParameters:
    """How the polar maps are sampled.

    Attributes:
        bearings: directions, evenly spaced; an even number, since the wide map is read in pairs of them.
        rings: of the fine map; samples_per_ring: places along each bearing, `spacing` [m] apart.
        wide_rings: of the wide map; wide_samples_per_ring: places along each bearing, `wide_spacing` [m] apart.
        most_visits: beyond which visits of a place are not told apart; who came by so often has lost its way.
        far_goal: [m] distance from which goals look alike; near_goal: below which they are told apart finely.
    """

    bearings: int = 72
    rings: int = 16
    samples_per_ring: int = 4
    spacing: float = 0.05
    wide_rings: int = 10
    wide_samples_per_ring: int = 4
    wide_spacing: float = 0.2
    most_visits: int = 12
    far_goal: float = 6.0
    near_goal: float = 1.6

    def __post_init__(self) -> None:
        for name, most in (
            ("bearings", 1000),
            ("rings", 1000),
            ("samples_per_ring", 100),
            ("wide_rings", 1000),
            ("wide_samples_per_ring", 100),
            ("most_visits", 100),
        ):
            require_whole(getattr(self, name), f"MapViewParameters.{name}")
            if not 1 <= getattr(self, name) <= most:
                raise InputError(f"MapViewParameters.{name} must lie in 1..{most}.")
        if self.bearings % 2:
            raise InputError("MapViewParameters needs an even number of bearings.")
        if not (0 < self.spacing < 1 and 0 < self.wide_spacing < 2):
            raise InputError("MapViewParameters needs a spacing in (0, 1) m and a wide_spacing in (0, 2) m.")
        if not 0 < self.near_goal <= self.far_goal:
            raise InputError("MapViewParameters needs 0 < near_goal <= far_goal [m].")

    @property
    def samples(self) -> int:
        """Of the fine map along each bearing."""
        return self.rings * self.samples_per_ring

    @property
    def wide_samples(self) -> int:
        """Of the wide map along each bearing."""
        return self.wide_rings * self.wide_samples_per_ring


class MapView(NamedTuple):
    """The map as seen towards the goal. Maps are int8: they are stored by the million.

    Attributes:
        cells: (bearings, samples) `MapCell` of the place at each bearing and range.
        wide: (bearings, wide_samples) the same, farther and coarser.
        visits: (bearings, wide_samples) how often the robot came by, up to `most_visits`.
        goal: (6,) distance to the goal, coarse and fine, cosine and sine of the heading seen from the goal's bearing,
            and the direction in which the last path began, zero before the first.
    """

    cells: Int8[Array, "*batch bearings samples"]
    wide: Int8[Array, "*batch bearings wide"]
    visits: Int8[Array, "*batch bearings wide"]
    goal: Float[Array, "*batch 6"]

    @property
    def heading(self) -> Float[Array, "*batch 2"]:
        """Unit vector of the robot's heading."""
        return self.goal[..., 2:4]

    @property
    def course(self) -> Float[Array, "*batch 2"]:
        """Unit vector in which the last path began; zero before the first."""
        return self.goal[..., 4:6]

    @property
    def visits_here(self) -> Int8[Array, "*batch"]:
        """How often the robot came by where it is."""
        return jnp.max(self.visits[..., 0], axis=-1)

    def mirrored(self) -> "MapView":
        """The view of the mirror-image world."""
        flip = jnp.asarray([1.0, 1.0, 1.0, -1.0, 1.0, -1.0], self.goal.dtype)
        cells, wide, visits = (polar[..., ::-1, :] for polar in (self.cells, self.wide, self.visits))
        return MapView(cells, wide, visits, self.goal * flip)

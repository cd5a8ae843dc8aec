"""Safe paths: a planned path is drawn off the remembered obstacles as an elastic band, and ends before a collision.

Source of the idea: Quinlan and Khatib, "Elastic bands: connecting path planning and control" (1993).
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY, resample_by_arc_length
from iwalker_jax.perception.grid import GridSpec
from iwalker_jax.perception.map_sampling import sample_smooth

BAND_POINTS = 48


@dataclass(frozen=True)
class BandParameters:
    """How the band moves.

    Attributes:
        wanted: [m] clearance below which obstacles push.
        least: [m] clearance that the body needs; the path ends before it gets less.
        push: share of the missing clearance that one iteration makes up; pull: share of the bend that it takes out.
        iterations: of the band.
    """

    wanted: float = 0.38
    least: float = BODY.stop_radius
    push: float = 0.3
    pull: float = 0.25
    iterations: int = 30

    def __post_init__(self) -> None:
        if not 0 < self.least < self.wanted or self.iterations < 0 or not (0 < self.push <= 1 and 0 < self.pull <= 0.5):
            raise InputError(
                "BandParameters needs 0 < least < wanted, push in (0, 1], pull in (0, 0.5], iterations >= 0."
            )


def safe_path(
    rules: BandParameters, path: Float[Array, "n 2"], esdf: Float[Array, "rows columns"], grid: GridSpec
) -> tuple[Float[Array, "k 2"], Bool[Array, ""]]:
    """The path as a band off the obstacles, cut before the first point without room; and whether it was cut.

    Args:
        path: from the robot on [m].
        esdf: signed distance [m] to the obstacles; grid: where its cells lie, in the path's frame.
    """

    def clearance(point: Float[Array, "2"]) -> Float[Array, ""]:
        return sample_smooth(esdf, grid, point)

    sense = jax.vmap(jax.value_and_grad(clearance))

    def relax(_: int, band: Float[Array, "k 2"]) -> Float[Array, "k 2"]:
        distance, slope = sense(band)
        missing = jnp.maximum(rules.wanted - distance, 0.0)
        moved = band + rules.push * missing[:, None] * slope
        bend = moved[:-2] - 2 * moved[1:-1] + moved[2:]
        moved = moved.at[1:-1].add(rules.pull * bend)
        return moved.at[0].set(band[0])

    band = jax.lax.fori_loop(0, rules.iterations, relax, resample_by_arc_length(path, BAND_POINTS))
    distance, _ = sense(band)
    # A robot that stands closer than it should must be able to walk away.
    blocked = distance < jnp.minimum(rules.least, distance[0] - 0.005)
    open_way = jnp.cumprod(~blocked).astype(bool)
    last = band[jnp.maximum(jnp.sum(open_way) - 1, 0)]
    return jnp.where(open_way[:, None], band, last), ~open_way[-1]

"""Safe paths: a planned path is drawn off the remembered obstacles as an elastic band, and ends before a collision.

Source of the idea: Quinlan and Khatib, "Elastic bands: connecting path planning and control" (1993).
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.checks import Scalar
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY, arc_length, resample_by_arc_length
from iwalker_jax.perception import GridSpec, sample_smooth

BAND_POINTS = 48


@dataclass(frozen=True)
class BandParameters:
    """How the band moves.

    Attributes:
        desired_clearance: [m] below which obstacles repel the band.
        min_clearance: [m] that the body needs; the path ends before it gets less. Which gaps are wide enough for the
            gait's sway as well is for the routes to say.
        repulsion: share of the missing clearance that one iteration makes up.
        contraction: share of the bend that one iteration takes out.
        iterations: of the band.
        escape_slope: [m/m] at which the clearance of a path that starts with less than `min_clearance` must rise.
        turning_clearance: [m] that a robot that turns on the spot shall have, for its sway and the drift of its steps.
        slack: [m] by which it may fall short of that: half a cell of the map.
    """

    desired_clearance: float = 0.38
    min_clearance: float = BODY.radius
    repulsion: float = 0.3
    contraction: float = 0.25
    iterations: int = 30
    turning_clearance: float = 0.25
    escape_slope: float = 0.1
    slack: float = 0.0125

    def __post_init__(self) -> None:
        if not 0 < self.min_clearance < self.desired_clearance or self.iterations < 0:
            raise InputError("BandParameters needs 0 < min_clearance < desired_clearance and iterations >= 0.")
        if not self.turning_clearance >= self.min_clearance:
            raise InputError("BandParameters needs turning_clearance of at least min_clearance [m].")
        if self.escape_slope < 0 or self.slack < 0:
            raise InputError("BandParameters needs escape_slope >= 0 and slack >= 0.")
        if not (0 < self.repulsion <= 1 and 0 < self.contraction <= 0.5):
            raise InputError("BandParameters needs repulsion in (0, 1] and contraction in (0, 0.5].")


def safe_path(
    parameters: BandParameters, path: Float[Array, "n 2"], esdf: Float[Array, "rows columns"], grid: GridSpec
) -> tuple[Float[Array, "k 2"], Bool[Array, ""]]:
    """The path as a band off the obstacles, cut before the first point without room; and whether it was cut.

    Args:
        path: from the robot on [m].
        esdf: signed distance [m] to the obstacles; grid: where its cells lie, in the path's frame.
    """

    def relax(_: Int[Array, ""], band: Float[Array, "k 2"]) -> Float[Array, "k 2"]:
        moved = _repelled(parameters, band, parameters.desired_clearance, esdf, grid)
        bend = moved[:-2] - 2 * moved[1:-1] + moved[2:]
        moved = moved.at[1:-1].add(parameters.contraction * bend)
        return moved.at[0].set(band[0])

    band = jax.lax.fori_loop(0, parameters.iterations, relax, resample_by_arc_length(path, BAND_POINTS))
    distance = jax.vmap(lambda point: sample_smooth(esdf, grid, point))(band)
    # A robot that stands closer than it should must be able to walk away, but not on through a gap that is too tight.
    escaping = distance[0] + parameters.escape_slope * arc_length(band) - parameters.slack
    blocked = distance < jnp.minimum(parameters.min_clearance, escaping)
    open_way = jnp.cumprod(~blocked).astype(bool)
    last = band[jnp.maximum(jnp.sum(open_way) - 1, 0)]
    return jnp.where(open_way[:, None], band, last), ~open_way[-1]


def way_to_room(
    parameters: BandParameters, place: Float[Array, "2"], esdf: Float[Array, "rows columns"], grid: GridSpec
) -> Float[Array, "2"]:
    """Offset [m] from a place to where a robot has room to turn, up the distance field; zero where it has.

    Args:
        place: of the robot [m].
        esdf: signed distance [m] to the obstacles; grid: where its cells lie, in the place's frame.
    """

    def climb(_: Int[Array, ""], at: Float[Array, "1 2"]) -> Float[Array, "1 2"]:
        return _repelled(parameters, at, parameters.turning_clearance, esdf, grid)

    return jax.lax.fori_loop(0, parameters.iterations, climb, place[None])[0] - place


def _repelled(
    parameters: BandParameters,
    points: Float[Array, "k 2"],
    wanted: Scalar,
    esdf: Float[Array, "rows columns"],
    grid: GridSpec,
) -> Float[Array, "k 2"]:
    """Points [m] moved up the distance field by a share of the clearance [m] that they miss."""
    distance, slope = jax.vmap(jax.value_and_grad(lambda point: sample_smooth(esdf, grid, point)))(points)
    missing = jnp.maximum(wanted - distance, 0.0)
    return points + parameters.repulsion * missing[:, None] * slope

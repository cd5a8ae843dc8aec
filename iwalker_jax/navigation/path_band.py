"""Safe paths: a planned path is drawn off the remembered obstacles as an elastic band, and ends before a collision.

Source of the idea: Quinlan and Khatib, "Elastic bands: connecting path planning and control" (1993).
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY, arc_length, resample_by_arc_length
from iwalker_jax.perception import GridSpec, sample_smooth

BAND_POINTS = 48

_LACK_WEIGHT = 10.0  # a centimetre of room is worth a decimetre of way


@dataclass(frozen=True)
class BandParameters:
    """How the band moves.

    Attributes:
        desired_clearance: [m] below which obstacles repel the band.
        min_clearance: [m] that the body needs; the path ends before it gets less. Which gaps are wide enough for the
            gait's sway as well is for the routes to say.
        repulsion: share of the missing clearance that the first iteration makes up; the others less and less.
        contraction: share of the bend that the first iteration takes out; the others less and less.
        iterations: of the band.
        escape_slope: [m/m] at which the clearance of a path that starts with less than `min_clearance` must rise.
        turning_clearance: [m] that a robot that turns on the spot shall have, for its sway and the drift of its steps.
        slack: [m] by which a clearance may fall short of what is asked: half a cell of the map.
        room_search: [m] about the robot, within which room to turn is looked for.
    """

    desired_clearance: float = 0.38
    min_clearance: float = BODY.radius
    repulsion: float = 0.3
    contraction: float = 0.25
    iterations: int = 30
    turning_clearance: float = 0.25
    escape_slope: float = 0.1
    slack: float = 0.0125
    room_search: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.min_clearance < self.desired_clearance or self.iterations < 0:
            raise InputError("BandParameters needs 0 < min_clearance < desired_clearance and iterations >= 0.")
        if not self.turning_clearance >= self.min_clearance:
            raise InputError("BandParameters needs turning_clearance of at least min_clearance [m].")
        if self.escape_slope < 0 or self.slack < 0 or not self.room_search > 0:
            raise InputError("BandParameters needs escape_slope >= 0, slack >= 0 and room_search > 0 [m].")
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

    def clearance(point: Float[Array, "2"]) -> Float[Array, ""]:
        return sample_smooth(esdf, grid, point)

    def relax(k: Int[Array, ""], band: Float[Array, "k 2"]) -> Float[Array, "k 2"]:
        # Between two walls nearer than the desired clearance the slope turns over on the middle line: steps of one size
        # would throw the band from side to side.
        share = (1 - k / parameters.iterations).astype(band.dtype)
        distance, slope = jax.vmap(jax.value_and_grad(clearance))(band)
        missing = jnp.maximum(parameters.desired_clearance - distance, 0.0)
        moved = band + share * parameters.repulsion * missing[:, None] * slope
        bend = moved[:-2] - 2 * moved[1:-1] + moved[2:]
        moved = moved.at[1:-1].add(share * parameters.contraction * bend)
        return moved.at[0].set(band[0])

    band = jax.lax.fori_loop(0, parameters.iterations, relax, resample_by_arc_length(path, BAND_POINTS))
    # Obstacles push its points out of narrow places, where they must not be missing.
    band = resample_by_arc_length(band, BAND_POINTS)
    distance = jax.vmap(clearance)(band)
    # A robot that stands closer than it should must be able to walk away, but not on through a gap that is too tight.
    escaping = distance[0] + parameters.escape_slope * arc_length(band) - parameters.slack
    blocked = distance < jnp.minimum(parameters.min_clearance, escaping)
    open_way = jnp.cumprod(~blocked).astype(bool)
    last = band[jnp.maximum(jnp.sum(open_way) - 1, 0)]
    return jnp.where(open_way[:, None], band, last), ~open_way[-1]


def way_to_room(
    parameters: BandParameters, place: Float[Array, "2"], esdf: Float[Array, "rows columns"], grid: GridSpec
) -> Float[Array, "2"]:
    """Offset [m] from a place to one nearby where a robot has room to turn; zero where it has.

    On the way the clearance must not fall: what is near beyond a wall or a pole is not near. Uphill alone would not do:
    in the mouth of a gap the distance field rises across the gap, and hardly towards its ends.

    Args:
        place: of the robot [m], `room_search` or more from the map's edge.
        esdf: signed distance [m] to the obstacles; grid: where its cells lie, in the place's frame.
    """
    reach = round(parameters.room_search / grid.resolution)
    size = 2 * reach + 1
    cell = jnp.round(grid.cell_coordinates(place)).astype(jnp.int32)
    corner = jnp.clip(cell - reach, 0, jnp.asarray(grid.shape) - size)
    around = jax.lax.dynamic_slice(esdf, (corner[0], corner[1]), (size, size))
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, indexing="ij"), axis=-1)
    here = around[reach, reach]
    open_way = jnp.ones((size, size), bool)
    for share in (0.25, 0.5, 0.75, 1.0):
        on_way = np.rint(share * steps).astype(int) + reach
        open_way &= around[on_way[..., 0], on_way[..., 1]] >= here - parameters.slack
    far = np.linalg.norm(steps, axis=-1) * grid.resolution
    lack = jnp.maximum(parameters.turning_clearance - around, 0.0)
    best = jnp.argmin(jnp.where(open_way & (far <= parameters.room_search), _LACK_WEIGHT * lack + far, jnp.inf))
    offset = jnp.asarray(steps.reshape(-1, 2))[best] * grid.resolution
    return jnp.where(here < parameters.turning_clearance, offset, 0.0).astype(place.dtype)

"""Where the floor is: a robust plane fit that gives the camera's height, pitch and roll from one depth image."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.checks import Scalar, require_numbers
from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.perception.depth_cleanup import check_image_size

_HYPOTHESES = 256  # at 20 % floor among the pixels drawn from, still two all-floor triples
_REWEIGHTINGS = 10
_ALIGNMENTS = 4
_SCORING_PIXELS = 1600


@dataclass(frozen=True)
class FloorParameters:
    """Which planes can be the floor below a walking robot's camera.

    Attributes:
        min_height, max_height: [m] of the camera above the floor.
        min_pitch, max_pitch: [rad] of the camera, positive looks down.
        max_roll: [rad] of the camera to either side.
        max_depth: [m] farther points are not used.
        min_inliers: fraction of the usable pixels that must lie on the floor for a valid fit.
    """

    min_height: float = 0.15
    max_height: float = 2.0
    min_pitch: float = math.radians(-20.0)
    max_pitch: float = math.radians(65.0)
    max_roll: float = math.radians(35.0)
    max_depth: float = 6.0
    min_inliers: float = 0.08

    def __post_init__(self) -> None:
        if not 0.0 < self.min_height < self.max_height:
            raise InputError(
                f"FloorParameters needs 0 < min_height < max_height, got {self.min_height}, {self.max_height} m."
            )
        if not -math.pi / 2 < self.min_pitch < self.max_pitch < math.pi / 2 or not 0.0 < self.max_roll < math.pi / 2:
            raise InputError("FloorParameters needs pitch and roll limits within 90 degrees, the smaller first.")
        if not self.max_depth > 0.0 or not 0.0 < self.min_inliers < 1.0:
            raise InputError("FloorParameters needs max_depth > 0 and min_inliers between 0 and 1.")


DEFAULT_FLOOR_PARAMETERS = FloorParameters()
"""Any mount on a small or large humanoid, down to a few tenths of floor in the picture."""


class FloorFit(NamedTuple):
    """The camera's pose over the floor; all numbers are 0 where `valid` is False.

    Attributes:
        height: [m] of the camera above the floor.
        pitch: [rad] positive looks down.
        roll: [rad] positive turns the image's right side down.
        inlier_fraction: fraction of usable pixels that lie on the floor.
        valid: whether a plausible floor was found.
    """

    height: Float[Array, ""]
    pitch: Float[Array, ""]
    roll: Float[Array, ""]
    inlier_fraction: Float[Array, ""]
    valid: Bool[Array, ""]

    def mount(self, forward: float = 0.0, left: float = 0.0) -> Float[Array, " 5"]:
        """Camera mount array [height, pitch, roll, forward, left]; the image does not tell forward and left."""
        offset = jnp.zeros_like(self.height)
        return jnp.stack([self.height, self.pitch, self.roll, offset + forward, offset + left])


def fit_floor(
    depth: Float[Array, "height width"], intrinsics: Intrinsics, parameters: FloorParameters = DEFAULT_FLOOR_PARAMETERS
) -> FloorFit:
    """Floor plane of one cleaned depth image.

    The inverse depth of a plane is linear in the pixel, 1/z = m . ray with m = n / h (n the unit normal that points
    to the floor, h the camera's height), and stereo noise is uniform in it, so the fit is linear least squares. Fixed
    triples of pixels, the same in every call, propose planes; the one with most pixels on it and fewest below it wins
    (nothing lies below a floor, which tells it from a table top) and is refined by reweighted least squares (Tukey's
    biweight).

    Args:
        depth: z-depth [m], 0 = no return (`clean_depth`).
        intrinsics: of this image size.
        parameters: which planes can be the floor.

    Raises:
        InputError: if the image has another size than its intrinsics.
    """
    check_image_size(depth.shape, intrinsics)
    rays, inverse = _scoring_pixels(depth, intrinsics, parameters.max_depth)
    usable = inverse > 0.0
    planes = _proposals(depth, intrinsics)
    plausible = _is_plausible(planes, parameters)
    residual = jnp.where(usable, inverse - planes @ rays, 0.0)
    tolerance = _tolerance(inverse)
    on = jnp.sum(usable & (jnp.abs(residual) < tolerance), axis=-1)
    # Farther than the floor along the same ray means below it.
    below = jnp.sum(usable & (residual < -3.0 * tolerance), axis=-1)
    best = planes[jnp.argmax(jnp.where(plausible, on - below, -inverse.size))]
    plane = lax.fori_loop(0, _REWEIGHTINGS, lambda _, m: _reweighted(m, rays, inverse, tolerance), best)

    on_floor = usable & (jnp.abs(inverse - plane @ rays) < tolerance)
    fraction = jnp.sum(on_floor) / jnp.maximum(jnp.sum(usable), 1)
    enough = (fraction >= parameters.min_inliers) & (jnp.sum(on_floor) >= 0.02 * inverse.size)
    valid = enough & _is_plausible(plane, parameters)
    height, pitch, roll = _height_pitch_roll(plane)
    height, pitch, roll, fraction = (jnp.where(valid, x, 0.0) for x in (height, pitch, roll, fraction))
    return FloorFit(height, pitch, roll, fraction, valid)


@dataclass(frozen=True)
class MountUncertainty:
    """How wrong a believed mount may be, for `align_to_floor`.

    Attributes:
        height: [m] standard deviation of the camera's height.
        tilt: [rad] standard deviation of its pitch and roll.
        limit: standard deviations by which the floor may correct each of them; what lies farther off the believed
            floor is none, such as a platform.
        reach: [m] of depth, from where floor is used: near, a platform's edge or a ramp is soon too high for floor.
        floor_error: [1/m] standard deviation that the floor pixels' inverse depths have in common: matching errors that
            last, and floors that are not quite plane.
    """

    height: float = 0.005
    tilt: float = math.radians(0.5)
    limit: float = 2.0
    reach: float = 1.5
    floor_error: float = 0.002

    def __post_init__(self) -> None:
        require_numbers(self)
        if min(self.height, self.tilt, self.limit, self.reach, self.floor_error) <= 0.0:
            raise InputError(
                "MountUncertainty needs positive height and reach [m], tilt [rad], limit and floor_error [1/m]."
            )


def align_to_floor(
    depth: Float[Array, "height width"],
    mount: Float[Array, " 5"],
    intrinsics: Intrinsics,
    uncertainty: MountUncertainty = MountUncertainty(),
) -> Float[Array, " 5"]:
    """A believed mount with height, pitch and roll corrected by the floor that the image shows.

    The most likely plane under a Gaussian belief about the mount: reweighted least squares as in `fit_floor`, begun at
    the believed plane, with the belief as a further term. Without floor in the image the mount stays as it is.

    Args:
        depth: z-depth [m], 0 = no return (`clean_depth`).
        mount: believed [height, pitch, roll, forward, left] as in `CameraMount`.
        intrinsics: of this image size.
        uncertainty: of the mount.

    Raises:
        InputError: if the image has another size than its intrinsics.
    """
    check_image_size(depth.shape, intrinsics)
    rays, inverse = _scoring_pixels(depth, intrinsics, uncertainty.reach)
    spread = jnp.asarray([uncertainty.height, uncertainty.tilt, uncertainty.tilt], mount.dtype)
    plane, slope = _plane_of(mount[:3]), jax.jacfwd(_plane_of)(mount[:3]) * spread
    # A pixel that the believed floor misses by more than the belief allows is none of the floor's.
    tolerance = uncertainty.limit * uncertainty.tilt / mount[0]

    def corrected(_: Int[Array, ""], errors: Float[Array, " 3"]) -> Float[Array, " 3"]:
        weight = _biweight((inverse - (plane + slope @ errors) @ rays) / (1.5 * tolerance), inverse)
        # What the pixels err in common does not average out: their mean weighs as much as one of that error.
        weight = weight / (jnp.maximum(jnp.sum(weight), 0.02 * inverse.size) * uncertainty.floor_error**2)
        seen = slope.T @ rays
        found, _ = _solve_3x3(
            (seen * weight) @ seen.T + jnp.eye(3, dtype=seen.dtype), seen @ (weight * (inverse - plane @ rays))
        )
        return jnp.clip(found, -uncertainty.limit, uncertainty.limit)

    errors = lax.fori_loop(0, _ALIGNMENTS, corrected, jnp.zeros(3, mount.dtype))
    return mount.at[:3].add(spread * errors)


def _plane_of(pose: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """m = n / h of [height, pitch, roll], the inverse of `_height_pitch_roll`."""
    height, pitch, roll = pose
    cos = jnp.cos(pitch)
    return jnp.stack([cos * jnp.sin(roll), cos * jnp.cos(roll), jnp.sin(pitch)]) / height


def _scoring_pixels(
    depth: Float[Array, "height width"], intrinsics: Intrinsics, max_depth: Scalar
) -> tuple[Float[Array, "3 n"], Float[Array, " n"]]:
    """Rays and inverse depths [1/m] of an even subset of pixels; inverse depth 0 where unusable."""
    step = max(1, round(math.sqrt(depth.size / _SCORING_PIXELS)))
    inverse = _inverse(depth[::step, ::step].ravel(), max_depth)
    rays = intrinsics.rays().astype(depth.dtype)[::step, ::step].reshape(-1, 3).T
    return rays, inverse


def _proposals(depth: Float[Array, "height width"], intrinsics: Intrinsics) -> Float[Array, "k 3"]:
    """Planes m through fixed triples of pixels of the lower 70 % of the image; 0 where degenerate or invalid."""
    rng = np.random.default_rng(0)
    rows = rng.integers(int(0.3 * intrinsics.height), intrinsics.height, (_HYPOTHESES, 3))
    columns = rng.integers(0, intrinsics.width, (_HYPOTHESES, 3))
    right = jnp.asarray((columns - intrinsics.cx) / intrinsics.fx, depth.dtype)
    down = jnp.asarray((rows - intrinsics.cy) / intrinsics.fy, depth.dtype)
    inverse = _inverse(depth[rows, columns], math.inf)
    matrix = jnp.stack([right, down, jnp.ones_like(right)], axis=-1)
    plane, determinant = _solve_3x3(matrix, inverse)
    usable = jnp.all(inverse > 0.0, axis=-1) & (jnp.abs(determinant) > 0.02)
    return jnp.where(usable[:, None], plane, 0.0)


def _inverse(depth: Float[Array, "*n"], max_depth: Scalar) -> Float[Array, "*n"]:
    """1/z [1/m], 0 for no return and beyond max_depth."""
    usable = (depth > 0.0) & (depth <= max_depth)
    return jnp.where(usable, 1.0 / jnp.where(usable, depth, 1.0), 0.0)


def _tolerance(inverse: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """[1/m] a floor pixel's deviation: stereo noise, and an unevenness of 3 % of the camera's height."""
    return 0.01 + 0.03 * inverse


def _reweighted(
    plane: Float[Array, " 3"], rays: Float[Array, "3 n"], inverse: Float[Array, " n"], tolerance: Float[Array, " n"]
) -> Float[Array, " 3"]:
    """One step of least squares weighted by Tukey's biweight; the plane stays where the weights leave it open."""
    weight = _biweight((inverse - plane @ rays) / (1.5 * tolerance), inverse) / tolerance**2
    weight = weight / jnp.maximum(jnp.sum(weight), 1e-6)
    refined, determinant = _solve_3x3((rays * weight) @ rays.T, rays @ (weight * inverse))
    return jnp.where(determinant > 1e-7, refined, plane)


def _biweight(scaled: Float[Array, " n"], inverse: Float[Array, " n"]) -> Float[Array, " n"]:
    """Tukey's weights of scaled residuals; 0 where the pixel is not usable."""
    return jnp.where((inverse > 0.0) & (jnp.abs(scaled) < 1.0), (1.0 - scaled**2) ** 2, 0.0)


def _height_pitch_roll(plane: Float[Array, "*k 3"]) -> tuple[Array, Array, Array]:
    """(height [m], pitch [rad], roll [rad]) of m = n / h, n = (cos p sin r, cos p cos r, sin p) (`camera_pose`)."""
    norm = jnp.sqrt(jnp.maximum(jnp.sum(plane**2, axis=-1), 1e-12))
    sine = jnp.clip(plane[..., 2] / norm, -1.0, 1.0)
    return 1.0 / norm, jnp.arcsin(sine), jnp.arctan2(plane[..., 0], plane[..., 1])


def _is_plausible(plane: Float[Array, "*k 3"], parameters: FloorParameters) -> Bool[Array, "*k"]:
    height, pitch, roll = _height_pitch_roll(plane)
    return (
        (height >= parameters.min_height)
        & (height <= parameters.max_height)
        & (pitch >= parameters.min_pitch)
        & (pitch <= parameters.max_pitch)
        & (jnp.abs(roll) <= parameters.max_roll)
    )


def _solve_3x3(
    matrix: Float[Array, "*k 3 3"], right_side: Float[Array, "*k 3"]
) -> tuple[Float[Array, "*k 3"], Float[Array, "*k"]]:
    """(solution, determinant) by Cramer's rule; the solution is finite but meaningless where the determinant is 0."""
    a, b, c = matrix[..., 0], matrix[..., 1], matrix[..., 2]
    determinant = jnp.sum(a * jnp.cross(b, c), axis=-1)
    safe = jnp.where(determinant == 0.0, 1.0, determinant)
    columns = [jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)]
    return jnp.stack([jnp.sum(right_side * k, axis=-1) / safe for k in columns], axis=-1), determinant

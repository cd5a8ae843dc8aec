"""Depth images as a small active-stereo camera would give them: what the ideal renderer leaves out."""

import functools
import math
import statistics
from collections.abc import Callable
from dataclasses import dataclass, fields

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import safe_sqrt
from iwalker_jax.perception import Intrinsics
from iwalker_jax.perception.depth_cleanup import check_image_size


@dataclass(frozen=True)
class DepthNoise:
    """Error model of a RealSense-like stereo camera; lengths in [px] are of an image 640 px wide and scale with it.

    The defaults reproduce a RealSense at 640 x 480: temporal standard deviation, holes and flicker.

    Attributes:
        baseline: [m] between the two imagers; sets quantisation, shadows and the dead band.
        disparity_step: [px] sub-pixel resolution of the matcher.
        near_std: [m] of the range noise at close range.
        std_at_1m: [m] of the part of the range noise that grows with distance.
        growth: exponent of that growth; 2 would be constant noise in disparity, weak texture far away adds to it.
        noise_length: [px] correlation length of the range noise (the matching window).
        surface_bias: lasting range error of a surface as a multiple of the noise that changes with each frame.
        view_distance, view_turn: [m], [rad] motions of the camera after which a surface is matched anew.
        surface_spread: spread of the noise from surface to surface, standard deviation of its logarithm.
        surface_length: [px] correlation length of surface patches and holes.
        near_holes: fraction of pixels without a match on near smooth surfaces.
        far_holes: the same at 5 m and beyond, where texture and projected pattern fade.
        edge_holes: the same beside depth edges, on both sides.
        edge_jump: [px] smallest step of disparity that counts as an edge.
        edge_width: [px] reach of an edge to either side.
        hole_persistence: correlation of the holes from frame to frame; the rest flickers.
        ghosts: fraction of pixels with a false match, anywhere from 0.3 m to max_ghost.
        max_ghost: [m] farthest false match.
        min_range: [m] nothing nearer can be matched.
        dead_band: [px] at the left edge without any return.
    """

    baseline: float = 0.05
    disparity_step: float = 1.0 / 32.0
    near_std: float = 0.0018
    std_at_1m: float = 0.0023
    growth: float = 2.55
    noise_length: float = 9.0
    surface_bias: float = 1.3
    view_distance: float = 0.3
    view_turn: float = 0.3
    surface_spread: float = 0.5
    surface_length: float = 11.0
    near_holes: float = 0.006
    far_holes: float = 0.1
    edge_holes: float = 0.45
    edge_jump: float = 1.5
    edge_width: float = 4.0
    hole_persistence: float = 0.9
    ghosts: float = 0.001
    max_ghost: float = 65.0
    min_range: float = 0.2
    dead_band: float = 6.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"DepthNoise.{field.name} must be a finite number of at least 0, got {value}.")
        if 0.0 in (self.baseline, self.disparity_step, self.noise_length, self.surface_length):
            raise InputError("DepthNoise needs baseline, disparity_step, noise_length and surface_length above 0.")
        if max(self.near_holes, self.far_holes, self.edge_holes, self.ghosts, self.hole_persistence) > 1.0:
            raise InputError("DepthNoise needs its fractions and hole_persistence to be at most 1.")
        if self.max_ghost <= 0.3:
            raise InputError(f"DepthNoise.max_ghost must lie beyond 0.3 m, got {self.max_ghost}.")


def add_depth_noise(
    key: Key[Array, ""],
    depth: Float[Array, "height width"],
    noise: DepthNoise,
    intrinsics: Intrinsics,
    surface_key: Key[Array, ""] | None = None,
    straight_through: bool = False,
) -> Float[Array, "height width"]:
    """Noisy z-depth [m] of an ideal depth image; 0 = no return. vmap over keys and frames.

    Values are rounded to the matcher's steps, so the derivative in the ideal depth is zero, unless it goes straight
    through the rounding: then it is that of the noise without it. Which pixels are lost or false is a jump either way,
    and such pixels have no derivative.

    Args:
        key: of this frame.
        depth: ideal z-depth [m], 0 = nothing hit.
        noise: the camera's error model.
        intrinsics: of the image.
        surface_key: of what lasts from frame to frame (weak texture, holes, bias). Frames of one view with different
            keys but the same surface key differ like successive frames of a real camera; None draws new surfaces.
        straight_through: differentiate as if disparity were not rounded; the values stay the same, bit for bit.

    Raises:
        InputError: if the image has another size than its intrinsics.
    """
    check_image_size(depth.shape, intrinsics)
    shape = (depth.shape[0], depth.shape[1])
    scale = intrinsics.width / 640.0
    key_range, key_holes, key_ghost, key_own_surface = jax.random.split(key, 4)
    key_weak, key_bias = jax.random.split(key_own_surface if surface_key is None else surface_key)
    seen = depth > 0.0
    inverse = jnp.where(seen, 1.0 / jnp.where(seen, depth, 1.0), 0.0)
    weak = _random_field(key_weak, shape, noise.surface_length * scale)

    # Range noise enters as a disparity error, so that far noise is skewed away from the camera as in real frames.
    wave = _random_field(key_range, shape, noise.noise_length * scale)
    wave += noise.surface_bias * _random_field(key_bias, shape, 2.0 * noise.surface_length * scale)
    std = safe_sqrt(noise.near_std**2 + (noise.std_at_1m * depth**noise.growth) ** 2)
    std *= jnp.exp(noise.surface_spread * weak)
    pixel_metres = intrinsics.fx * noise.baseline
    step = noise.disparity_step * scale / pixel_metres
    exact = (inverse - std * inverse**2 * wave) / step
    quanta = _straight_through_round(exact) if straight_through else jnp.round(exact)
    measured = jnp.where(seen, jnp.maximum(quanta, 1.0) * step, 0.0)
    disparity = measured * pixel_metres

    fresh = math.sqrt(1.0 - noise.hole_persistence**2)
    badness = noise.hole_persistence * weak + fresh * _random_field(
        key_holes, shape, 0.7 * noise.surface_length * scale
    )
    near, far, edge = (-_normal_quantile(p) for p in (noise.near_holes, noise.far_holes, noise.edge_holes))
    limit = near + (far - near) * jnp.clip(depth / 5.0, 0.0, 1.0)
    limit = jnp.where(_beside_edge(inverse * pixel_metres, noise, scale), edge, limit)
    shadow = jnp.pad(_shadow(disparity), ((0, 0), (0, 1)))
    blind = shadow | _dead_band(disparity, noise, intrinsics)
    too_near = measured * noise.min_range > 1.0
    kept = seen & ~(blind | too_near | (badness > limit))
    noisy = jnp.where(kept, 1.0 / jnp.where(kept, measured, 1.0), 0.0)
    matched, ghost_depth = _ghosts(key_ghost, shape, noise, scale)
    return jnp.where(matched & ~blind, ghost_depth, noisy).astype(depth.dtype)


@jax.custom_jvp
def _straight_through_round(values: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Nearest whole numbers, with the derivative of the values themselves."""
    return jnp.round(values)


@_straight_through_round.defjvp
def _straight_through_round_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    return jnp.round(primals[0]), tangents[0]


def _beside_edge(
    disparity: Float[Array, "height width"], noise: DepthNoise, scale: float
) -> Bool[Array, "height width"]:
    """Pixels within edge_width of a step in disparity."""
    reach = max(1, round(noise.edge_width * scale))
    nearest = farthest = disparity
    for axis in (0, 1):
        nearest = _running(jnp.maximum, nearest, reach, axis)
        farthest = _running(jnp.minimum, farthest, reach, axis)
    return nearest - farthest > noise.edge_jump * scale


def _running(
    pick: Callable[[Array, Array], Array], image: Float[Array, "height width"], reach: int, axis: int
) -> Float[Array, "height width"]:
    """Running maximum or minimum over `reach` pixels to either side along one axis."""
    size = image.shape[axis]
    padded = jnp.pad(image, [(reach, reach) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
    shifted = [jax.lax.slice_in_dim(padded, k, k + size, axis=axis) for k in range(2 * reach + 1)]
    return functools.reduce(pick, shifted)


def _shadow(disparity: Float[Array, "height width"]) -> Bool[Array, "height width-1"]:
    """Pixels that the right imager cannot see because something nearer covers them: a band left of each near edge.

    Pixel u lands at u - d(u) in the right image; it is hidden if some pixel to its right lands at or left of that. Half
    a pixel is added for the matching window. The last column is left out: nothing lies to its right.
    """
    landing = jnp.arange(disparity.shape[1]) - disparity
    covered_from = jax.lax.cummin(landing, axis=1, reverse=True)
    return covered_from[:, 1:] <= landing[:, :-1] + 0.5


def _dead_band(
    disparity: Float[Array, "height width"], noise: DepthNoise, intrinsics: Intrinsics
) -> Bool[Array, "height width"]:
    """Pixels at the left edge: the fixed band, and near surfaces that fall outside the right image."""
    column = jnp.arange(intrinsics.width) + 0.5
    return column < jnp.maximum(disparity, noise.dead_band * intrinsics.width / 640.0)


def _ghosts(
    key: Key[Array, ""], shape: tuple[int, int], noise: DepthNoise, scale: float
) -> tuple[Bool[Array, "height width"], Float[Array, "height width"]]:
    """(where, depth [m]) of false matches: small patches, each of one log-uniform depth."""
    side = max(1, round(6.0 * scale))
    rows, columns = -(-shape[0] // side), -(-shape[1] // side)
    chance = jax.random.uniform(key, (rows, columns))
    # The chance below the threshold is uniform again: one draw tells where a ghost is and how far.
    logarithm = math.log(0.3) + math.log(noise.max_ghost / 0.3) * chance / max(noise.ghosts, 1e-9)
    depth = jnp.where(chance < noise.ghosts, jnp.exp(jnp.minimum(logarithm, math.log(noise.max_ghost))), 0.0)
    patches = jnp.repeat(jnp.repeat(depth, side, 0), side, 1)[: shape[0], : shape[1]]
    return patches > 0.0, patches


def _random_field(key: Key[Array, ""], shape: tuple[int, int], length: float) -> Float[Array, "height width"]:
    """Smooth Gaussian field of zero mean and unit variance with a correlation length in pixels of this image."""
    vertical, horizontal = _kernel(shape[0], length), _kernel(shape[1], length)
    lattice = jax.random.normal(key, (vertical.shape[1], horizontal.shape[1]), jnp.float32)
    return vertical @ lattice @ horizontal.T


def _kernel(size: int, length: float) -> Float[np.ndarray, "{size} lattice"]:
    """(size, lattice) Gaussian interpolation weights; rows of unit norm keep the variance of white noise."""
    spacing = max(1.0, length)
    nodes = np.arange(-2, int(size / spacing) + 3) * spacing
    weights = np.exp(-(((np.arange(size)[:, None] - nodes) / length) ** 2))
    return (weights / np.linalg.norm(weights, axis=1, keepdims=True)).astype(np.float32)


def _normal_quantile(probability: float) -> float:
    """Value that a standard normal variable stays below with this probability."""
    return statistics.NormalDist().inv_cdf(min(max(probability, 1e-9), 1.0 - 1e-9))

"""Depth images made usable: units and types checked on the host, invalid pixels and speckles removed under jit."""

import math

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Float32, UInt16

from iwalker_jax.arrays import as_doubles
from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import Intrinsics

MAX_RANGE = 10.0
"""[m] stereo depth beyond this is a false match more often than a surface."""

_FINEST_SCALE = 1e-6  # [m] per unit; finer, 16 bits would hold no room
_MILLIMETRE_MEDIAN = 100.0  # [m] no indoor frame has a median depth of 100 m; millimetres read as metres have


def depth_from_uint16(image: UInt16[np.ndarray, "height width"], scale: float) -> Float32[np.ndarray, "height width"]:
    """Depth [m] of a 16-bit image as it lies in a PNG.

    Args:
        image: raw sensor units, 0 = no return.
        scale: [m] per unit, for example 0.001 for millimetres or 1/5000 for TUM RGB-D.

    Raises:
        InputError: if the image is not a 2-D uint16 array or the scale cannot be metres per unit.
    """
    image = np.asarray(image)
    if image.ndim != 2 or image.dtype != np.uint16:
        raise InputError(
            f"Raw depth must be a (height, width) uint16 array, got shape {image.shape} and type {image.dtype}; "
            "save depth as a single-channel 16-bit PNG."
        )
    if as_doubles(scale, "The depth scale").shape or not _FINEST_SCALE <= scale <= 0.1:
        units = isinstance(scale, (int, float)) and 0.1 < scale < math.inf
        advice = f"give 1/{scale:g} if this is units per metre" if units else "give one number from 0 to 0.1"
        raise InputError(f"The depth scale is metres per unit (0.001 for millimetres), got {scale}; {advice}.")
    return image.astype(np.float32) * np.float32(scale)


def check_depth_image(image: np.ndarray) -> None:
    """Refuse an array that cannot be a depth image in metres; invalid pixels (0, NaN, inf, negative) are allowed.

    Raises:
        InputError: on a wrong number of dimensions, an empty image, a type other than float, or millimetres.
    """
    image = np.asarray(image)
    if image.ndim != 2 or 0 in image.shape:
        raise InputError(f"A depth image must be a (height, width) array, got shape {image.shape}.")
    if not np.issubdtype(image.dtype, np.floating):
        raise InputError(
            f"A depth image must be floating-point metres, got type {image.dtype}; convert raw sensor units with "
            "depth_from_uint16."
        )
    returns = image[np.isfinite(image) & (image > 0)]
    if returns.size and float(np.median(returns)) > _MILLIMETRE_MEDIAN:
        raise InputError(
            f"The median depth is {float(np.median(returns)):.0f} m, so the image seems to be in millimetres; divide "
            "it by 1000."
        )


def check_image_size(shape: tuple[int, ...], intrinsics: Intrinsics) -> None:
    """Refuse a depth array whose shape is not the one its intrinsics name; free under jit, where shapes are static.

    Raises:
        InputError: naming both sizes.
    """
    if shape != (intrinsics.height, intrinsics.width):
        raise InputError(
            f"The depth image has shape {shape} but its intrinsics are for {intrinsics.height} rows and "
            f"{intrinsics.width} columns; give the intrinsics of this resolution, and use jax.vmap for batches."
        )


def clean_depth(
    depth: Float[Array | np.ndarray, "height width"],
    max_range: float = MAX_RANGE,
    min_agreeing: int = 2,
) -> Float32[Array, "height width"]:
    """Depth with every pixel that cannot be trusted set to 0: non-finite, negative, too far, or a lone speckle.

    A pixel is kept if at least `min_agreeing` of its eight neighbours lie at its own depth d [m] within
    0.03 + 0.02 d^2, the growth of stereo noise with distance. Two keep a chair leg that is one pixel wide (the
    pixels above and below agree) and remove lone ghosts.

    Args:
        depth: z-depth [m]; 0, negative, NaN and inf mean no return.
        max_range: [m] farther returns are dropped.
        min_agreeing: number of neighbours that must agree; 0 keeps speckles.

    Raises:
        InputError: if the image is not a 2-D array of floating-point metres.
    """
    if depth.ndim != 2 or not jnp.issubdtype(depth.dtype, jnp.floating):
        raise InputError(
            f"A depth image must be a (height, width) array of floating-point metres, got shape {depth.shape} and type "
            f"{depth.dtype}; use jax.vmap for batches and depth_from_uint16 for raw sensor units."
        )
    depth = depth.astype(jnp.float32)
    valid = (depth > 0.0) & (depth <= max_range)
    depth = jnp.where(valid, depth, 0.0)
    tolerance = 0.03 + 0.02 * depth**2
    padded = jnp.pad(depth, 1)

    def count(agreeing: Array, offset: Array) -> tuple[Array, None]:
        neighbour = lax.dynamic_slice(padded, (offset[0], offset[1]), depth.shape)
        return agreeing + ((neighbour > 0.0) & (jnp.abs(neighbour - depth) < tolerance)), None

    # A scan, because XLA would copy unrolled comparisons into everything that reads the cleaned image.
    around = jnp.asarray([(dv, du) for dv in range(3) for du in range(3) if (dv, du) != (1, 1)], jnp.int32)
    agreeing, _ = lax.scan(count, jnp.zeros(depth.shape, jnp.int32), around)
    return jnp.where(valid & (agreeing >= min_agreeing), depth, 0.0)


def resize_depth(
    depth: Float[Array | np.ndarray, "from_height from_width"], intrinsics_from: Intrinsics, intrinsics_to: Intrinsics
) -> Float[Array, "to_height to_width"]:
    """Depth image as another pinhole camera at the same place would see it.

    Each target pixel takes the source pixel nearest to its own ray, because averaging across a depth edge would invent
    surfaces in mid-air; z-depth is the same in both cameras. Rays outside the source's view give 0 (no return).

    Args:
        depth: z-depth [m] of size intrinsics_from.height x intrinsics_from.width.
        intrinsics_from: of the source image.
        intrinsics_to: of the wanted image.

    Raises:
        InputError: if the image's shape is not the one its intrinsics name.
    """
    check_image_size(depth.shape, intrinsics_from)
    columns = _nearest_source(
        intrinsics_to.width, intrinsics_to.cx, intrinsics_to.fx, intrinsics_from.cx, intrinsics_from.fx
    )
    rows = _nearest_source(
        intrinsics_to.height, intrinsics_to.cy, intrinsics_to.fy, intrinsics_from.cy, intrinsics_from.fy
    )
    columns_seen = (columns >= 0) & (columns < intrinsics_from.width)
    rows_seen = (rows >= 0) & (rows < intrinsics_from.height)
    columns = np.clip(columns, 0, intrinsics_from.width - 1)
    rows = np.clip(rows, 0, intrinsics_from.height - 1)
    sampled = depth[rows[:, None], columns[None, :]]
    return jnp.where(rows_seen[:, None] & columns_seen[None, :], sampled, 0.0)


def _nearest_source(size: int, c_to: float, f_to: float, c_from: float, f_from: float) -> np.ndarray:
    """Index of the source pixel whose ray is nearest to each target pixel's ray along one image axis."""
    tangent = (np.arange(size) - c_to) / f_to
    return np.floor(tangent * f_from + c_from + 0.5).astype(np.int64)

"""Stored depth images of a recording, 16-bit PNG or NumPy's .npy in metres, read with every check."""

import io
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, UInt16

from iwalker_jax.errors import InputError
from iwalker_jax.perception.depth_cleanup import check_depth_image
from iwalker_jax.perception.depth_png import MAX_PIXELS, depth_of_units, read_png_units
from iwalker_jax.runtime import printable
from iwalker_jax.runtime.reading import read_bytes

MILLIMETRE = 0.001
"""[m] per unit of images that were stored in metres."""

NUMPY_SUFFIX = ".npy"
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def read_stored_depth(path: Path, scale: float, size: tuple[int, int]) -> Float32[np.ndarray, "height width"]:
    """Depth [m] of one file; 0 = no return.

    Args:
        path: of the image.
        scale: [m] per unit of `read_units`.
        size: (width, height) [px] that the intrinsics belong to.

    Raises:
        InputError: saying what is wrong, in words that follow the file's name.
    """
    return depth_of_units(read_units(path, size), scale)


def read_units(path: Path, size: tuple[int, int]) -> UInt16[np.ndarray, "height width"]:
    """The units of one file: a PNG's as they are stored, a .npy file's metres in millimetres; InputError as above."""
    return millimetres(_read_metres(path, size)) if path.suffix.lower() == NUMPY_SUFFIX else read_png_units(path, size)


def millimetres(depth: Float[np.ndarray, "height width"]) -> UInt16[np.ndarray, "height width"]:
    """Depth [m] as millimetres; what is not finite, negative or beyond 65.5 m is no return, 0."""
    units = np.round(depth.astype(np.float64) / MILLIMETRE)
    fits = np.isfinite(units) & (units > 0) & (units <= np.iinfo(np.uint16).max)
    return np.where(fits, units, 0.0).astype(np.uint16)


def _read_metres(path: Path, size: tuple[int, int]) -> Float[np.ndarray, "height width"]:
    """The array of a .npy file; its header is checked before anything of its size is made, and nothing is unpickled."""
    content = read_bytes(path, 8 * MAX_PIXELS + 4096)
    stream = io.BytesIO(content)
    try:
        shape, by_columns, kind = _HEADERS[np.lib.format.read_magic(stream)](stream)
    except Exception as error:  # NumPy's parser of headers has several kinds, those of Python's tokenizer too
        raise InputError("is no .npy file, or is damaged; save it by numpy.save.") from error
    if kind.kind != "f":
        raise InputError(
            f"holds {printable(kind, 20)}; depth in .npy files is in metres, as floats. Save integers as 16-bit PNG."
        )
    if shape != size[::-1]:
        raise InputError(
            f"has the shape {printable(shape)} but the intrinsics are for {size[0]} x {size[1]} px, which is the shape "
            f"{size[::-1]}."
        )
    pixels = content[stream.tell() :]
    if len(pixels) != size[0] * size[1] * kind.itemsize:
        raise InputError("is truncated, or longer than its image; save or copy it again.")
    image = np.frombuffer(pixels, kind).reshape(shape, order="F" if by_columns else "C")
    try:
        check_depth_image(image)
    except InputError as error:
        raise InputError("seems to be in millimetres; save depth in metres.") from error
    return image

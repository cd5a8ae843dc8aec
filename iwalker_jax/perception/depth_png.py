"""16-bit PNG depth images, read with every check that tells a damaged or foreign file from a depth image."""

import struct
import zlib
from pathlib import Path

import cv2
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32
from numpy.typing import ArrayLike

from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.perception.depth_cleanup import MAX_RANGE, check_depth_image, depth_from_uint16, resize_depth
from iwalker_jax.runtime.files import atomic_write

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_MIN_VALID = 0.01  # fraction of pixels; fewer show nothing that a planner could use


def read_depth(
    file: str | Path,
    intrinsics: Intrinsics | None = None,
    depth_scale: float = 0.001,
    camera: Intrinsics = Intrinsics(),
) -> Float32[np.ndarray, "height width"]:
    """Depth [m] of a 16-bit PNG as the planner's camera would have seen it; 0 = no return.

    Args:
        file: single-channel 16-bit PNG.
        intrinsics: of the stored image; those of `camera` if left out.
        depth_scale: [m] per unit: 0.001 for millimetres, 1 / 5000 for TUM RGB-D.
        camera: that the image is wanted for, the shipped planner's by default (`planner.config.ipath.camera`).

    Raises:
        InputError: for a file that is missing, damaged or no depth image, intrinsics of another resolution, and a
            camera that sees nothing of what the image shows.
    """
    file, own = Path(file), intrinsics or camera
    try:
        depth = read_depth_png(file, depth_scale, (own.width, own.height))
    except InputError as error:
        raise InputError(f"{file} {error}") from None
    seen = np.asarray(resize_depth(jnp.asarray(depth), own, camera))
    if not seen.any():
        raise InputError(f"{file} shows nothing that the planner's camera would see; check the intrinsics.")
    return seen


def write_depth(file: str | Path, depth: ArrayLike, depth_scale: float = 0.001) -> None:
    """Write a depth image [m] as the 16-bit PNG that `read_depth` takes; what is no return or too far becomes 0.

    Args:
        file: PNG to write; its folder is created.
        depth: (height, width) z-depth [m]; 0, negative, NaN and inf: no return.
        depth_scale: [m] per unit.

    Raises:
        InputError: for an image that is not in metres, a scale that is not metres per unit, or a file that cannot be
            written.
    """
    image = np.asarray(depth)
    check_depth_image(image)
    depth_from_uint16(np.zeros((1, 1), np.uint16), depth_scale)
    units = np.where(np.isfinite(image), image, 0.0) / depth_scale
    units = np.where((units > 0) & (units <= np.iinfo(np.uint16).max), units, 0.0)
    content = cv2.imencode(".png", np.round(units).astype(np.uint16))[1].tobytes()
    try:
        with atomic_write(Path(file)) as part:
            part.write_bytes(content)
    except OSError as error:
        raise InputError(
            f"The depth image {file} cannot be written ({error.strerror}); choose another place."
        ) from error


def png_size(path: Path) -> tuple[int, int]:
    """(width, height) [px] from a PNG's header.

    Raises:
        InputError: if the file is missing or is no PNG.
    """
    header = _read(path)[:24]
    if len(header) < 24 or not header.startswith(_SIGNATURE):
        raise InputError("is not a PNG file; save depth as 16-bit PNG.")
    width, height = struct.unpack(">II", header[16:24])
    return width, height


def read_depth_png(path: Path, scale: float, size: tuple[int, int]) -> Float32[np.ndarray, "height width"]:
    """Depth [m] of one file; 0 = no return.

    Args:
        path: of a single-channel 16-bit PNG.
        scale: [m] per unit.
        size: (width, height) [px] that the intrinsics belong to.

    Raises:
        InputError: saying what is wrong: missing, empty, truncated, damaged, wrong type or size, constant, all invalid.
    """
    content = _read(path)
    _check_chunks(content)
    raw = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if raw is None:
        raise InputError("cannot be decoded; record it again.")
    if raw.ndim != 2:
        raise InputError(f"has {raw.shape[2]} channels, so it is a colour image; depth needs one 16-bit channel.")
    if raw.dtype != np.uint16:
        raise InputError(f"has type {raw.dtype}, which is a preview and not depth; depth needs uint16.")
    if (raw.shape[1], raw.shape[0]) != size:
        raise InputError(
            f"is {raw.shape[1]} x {raw.shape[0]} px but the intrinsics are for {size[0]} x {size[1]} px; give the "
            "intrinsics of this resolution."
        )
    if not raw.any():
        raise InputError("has no return in any pixel.")
    if raw.min() == raw.max():
        raise InputError(f"has the same value {int(raw[0, 0])} in every pixel.")
    depth = depth_from_uint16(raw, scale)
    in_range = np.mean((depth > 0.0) & (depth <= MAX_RANGE))
    if in_range < _MIN_VALID:
        raise InputError(
            f"has valid depth (up to {MAX_RANGE:g} m) in only {100 * in_range:.1f} % of its pixels; check the scale."
        )
    return depth


def _read(path: Path) -> bytes:
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise InputError("is missing.") from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror}).") from None
    if not content:
        raise InputError("is empty (0 bytes).")
    return content


def _check_chunks(content: bytes) -> None:
    """Walk a PNG's chunks and compare their checksums; decoders fill the rest of a damaged image with zeros instead."""
    if not content.startswith(_SIGNATURE):
        raise InputError("is not a PNG file; save depth as 16-bit PNG.")
    position = len(_SIGNATURE)
    while position + 12 <= len(content):
        (length,) = struct.unpack(">I", content[position : position + 4])
        end = position + 12 + length
        if end > len(content):
            break
        body = content[position + 4 : end - 4]
        if struct.unpack(">I", content[end - 4 : end])[0] != zlib.crc32(body):
            raise InputError("is damaged (a checksum does not match); record or copy it again.")
        if body.startswith(b"IEND"):
            return
        position = end
    raise InputError("is truncated; record or copy it again.")

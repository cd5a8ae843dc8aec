"""16-bit PNG depth images read with every check that tells a damaged or foreign file from a depth image."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32

from iwalker_jax.errors import InputError
from iwalker_jax.perception.depth_cleanup import MAX_RANGE, depth_from_uint16

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_MIN_VALID = 0.01  # fraction of pixels; fewer show nothing that a planner could use


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

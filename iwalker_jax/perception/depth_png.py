"""16-bit PNG depth images, read with every check that tells a damaged or foreign file from a depth image."""

import struct
import zlib
from pathlib import Path
from typing import NamedTuple

import cv2
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, UInt16
from numpy.typing import ArrayLike

from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.perception.depth_cleanup import MAX_RANGE, check_depth_image, depth_from_uint16, resize_depth
from iwalker_jax.runtime.files import atomic_write
from iwalker_jax.runtime.reading import printable, read_bytes

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOUR_TYPES = {2: "3 channels", 3: "a palette", 4: "2 channels", 6: "4 channels"}
_MAX_BYTES = 128 * 1024 * 1024
MAX_PIXELS = 16_000_000
"""More than any depth camera has; what claims more is not unpacked."""

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
    file, own = Path(file), camera if intrinsics is None else intrinsics
    for given in (own, camera):
        if not isinstance(given, Intrinsics):
            raise InputError(f"A camera is given as a {type(given).__name__}; give Intrinsics.")
    try:
        depth = read_depth_png(file, depth_scale, (own.width, own.height))
    except InputError as error:
        raise InputError(f"{printable(file, 300)} {error}") from None
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
    image = image.astype(np.promote_types(image.dtype, np.float32))  # half precision holds no tenths of a millimetre
    units = np.where(np.isfinite(image), image, 0.0) / depth_scale
    units = np.where((units > 0) & (units <= np.iinfo(np.uint16).max), units, 0.0)
    content = cv2.imencode(".png", np.round(units).astype(np.uint16))[1].tobytes()
    try:
        with atomic_write(Path(file)) as part:
            part.write_bytes(content)
    except (OSError, ValueError) as error:  # ValueError for what is no file's name
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"The depth image {printable(file, 300)} cannot be written ({reason}); choose another place."
        ) from error


def png_size(path: Path) -> tuple[int, int]:
    """(width, height) [px] from a PNG's header.

    Raises:
        InputError: if the file is missing or is no PNG.
    """
    header = _header(_read(path))
    return header.width, header.height


def read_depth_png(path: Path, scale: float, size: tuple[int, int]) -> Float32[np.ndarray, "height width"]:
    """Depth [m] of one file; 0 = no return.

    Args:
        path: of a single-channel 16-bit PNG.
        scale: [m] per unit.
        size: (width, height) [px] that the intrinsics belong to.

    Raises:
        InputError: saying what is wrong: missing, empty, truncated, damaged, wrong type or size, constant, all invalid.
    """
    return depth_of_units(read_png_units(path, size), scale)


def depth_of_units(raw: UInt16[np.ndarray, "height width"], scale: float) -> Float32[np.ndarray, "height width"]:
    """Depth [m] of a stored image's units, of `scale` [m] each; 0 = no return.

    Raises:
        InputError: in words that follow the file's name: constant, all invalid.
    """
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


def read_png_units(path: Path, size: tuple[int, int]) -> UInt16[np.ndarray, "height width"]:
    """The sensor's units of one file, as they are stored.

    Nothing is decoded before the header has said that the image is the one expected, and nothing that does not hold
    exactly its pixels: decoders fill the rest of a damaged image with zeros.

    Args:
        path: of a single-channel 16-bit PNG.
        size: (width, height) [px] that the intrinsics belong to.

    Raises:
        InputError: saying what is wrong: missing, empty, truncated, damaged, wrong type or size.
    """
    content = _read(path)
    header = _header(content)
    _check_header(header, size)
    _check_pixels(_compressed_pixels(content), header)
    try:
        raw = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        raw = None
    if raw is None or raw.shape != (header.height, header.width) or raw.dtype != np.uint16:
        raise InputError("cannot be decoded as 16-bit depth; record it again.")
    return raw


class _Header(NamedTuple):
    """What a PNG says about itself before its pixels."""

    width: int
    height: int
    bits: int
    colour_type: int
    compression: int
    filtering: int
    interlace: int


def _read(path: Path) -> bytes:
    content = read_bytes(path, _MAX_BYTES)
    if not content:
        raise InputError("is empty (0 bytes).")
    return content


def _header(content: bytes) -> _Header:
    if not content.startswith(_SIGNATURE):
        raise InputError("is not a PNG file; save depth as 16-bit PNG.")
    if len(content) < 33:
        raise InputError("is truncated; record or copy it again.")
    if content[8:16] != b"\0\0\0\x0dIHDR":
        raise InputError("is damaged (a PNG begins with its header); record or copy it again.")
    if struct.unpack(">I", content[29:33])[0] != zlib.crc32(content[12:29]):
        raise InputError("is damaged (the header's checksum does not match); record or copy it again.")
    return _Header(*struct.unpack(">IIBBBBB", content[16:29]))


def _check_header(header: _Header, size: tuple[int, int]) -> None:
    if header.colour_type != 0:
        kind = _COLOUR_TYPES.get(header.colour_type, "pixels of an unknown kind")
        raise InputError(f"has {kind}, so it is a colour image; depth needs one 16-bit channel.")
    if header.bits != 16:
        raise InputError(f"has {header.bits} bits a pixel, which is a preview and not depth; depth needs 16.")
    if (header.width, header.height) != size:
        raise InputError(
            f"is {header.width} x {header.height} px but the intrinsics are for {size[0]} x {size[1]} px; give the "
            "intrinsics of this resolution."
        )
    if header.width * header.height > MAX_PIXELS:
        raise InputError(f"has more than {MAX_PIXELS / 1e6:g} million pixels; record or scale it smaller.")
    if (header.compression, header.filtering) != (0, 0) or header.interlace != 0:
        raise InputError("is interlaced or packed in an unknown way; save it as a plain 16-bit PNG.")


def _compressed_pixels(content: bytes) -> bytes:
    """The joined IDAT chunks of a PNG, every chunk's checksum compared.

    A chunk that changes what its pixels mean (transparency, a second frame) is refused: depth has none.
    """
    position = len(_SIGNATURE)
    pixels: list[bytes] = []
    while position + 12 <= len(content):
        (length,) = struct.unpack(">I", content[position : position + 4])
        end = position + 12 + length
        if end > len(content):
            break
        kind, body = content[position + 4 : position + 8], content[position + 4 : end - 4]
        if struct.unpack(">I", content[end - 4 : end])[0] != zlib.crc32(body):
            raise InputError("is damaged (a checksum does not match); record or copy it again.")
        if kind == b"IEND":
            return b"".join(pixels)
        if kind in (b"tRNS", b"acTL", b"fcTL", b"fdAT"):
            raise InputError("has transparency or several frames; save depth as a plain 16-bit PNG.")
        if kind == b"IDAT":
            pixels.append(body[4:])
        elif kind == b"IHDR" and position != len(_SIGNATURE):
            raise InputError("is damaged (it has two headers); record or copy it again.")
        position = end
    raise InputError("is truncated; record or copy it again.")


def _check_pixels(compressed: bytes, header: _Header) -> None:
    """Refuse pixels that are not exactly as many as the header says, without unpacking more than those."""
    row = 1 + 2 * header.width
    unpacker = zlib.decompressobj()
    try:
        filtered = unpacker.decompress(compressed, header.height * row + 1)
        complete = unpacker.eof or (not unpacker.decompress(unpacker.unconsumed_tail, 1) and unpacker.eof)
    except zlib.error:
        raise InputError("is damaged (its pixels cannot be unpacked); record or copy it again.") from None
    if len(filtered) != header.height * row or not complete:
        raise InputError("is damaged (it does not hold as many pixels as it says); record or copy it again.")
    if max(filtered[::row]) > 4:
        raise InputError("is damaged (its rows are packed in an unknown way); record or copy it again.")

"""Depth images in messages: sensor_msgs/Image of 16UC1 or 32FC1, and sensor_msgs/CompressedImage by compressedDepth.

Encodings are those of ROS' sensor_msgs/image_encodings and REP 118 (16UC1: millimetres, 0 = no return; 32FC1: metres,
NaN = no return); the header before a compressed image is `ConfigHeader` of compressed_depth_image_transport.
"""

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt16

from iwalker_jax.data.recordings.stored_depth import millimetres
from iwalker_jax.errors import InputError
from iwalker_jax.perception.depth_png import MAX_PIXELS, png_size, read_png_units
from iwalker_jax.runtime import printable

IMAGE, COMPRESSED_IMAGE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"

_ENCODINGS = ("16UC1", "32FC1")
_HEADER = struct.Struct("<iff")  # format, and the two parameters of inverse depth
_PNG_SIGNATURE = b"\x89PNG"


def depth_encoding(message: Any) -> str | None:
    """ "16UC1" or "32FC1" of a depth image as the message states it; None for a message that is none."""
    if hasattr(message, "encoding"):
        return message.encoding if message.encoding in _ENCODINGS else None
    encoding, _, packing = message.format.partition(";")
    if encoding.strip() in _ENCODINGS and ("compressedDepth" in packing or "png" in packing):
        return encoding.strip()
    # Without an encoding the transport's older versions mean 16UC1.
    return "16UC1" if message.format.strip() == "compressedDepth" else None


def stated_kind(message: Any) -> str:
    """What the message says of its pixels, for a sentence."""
    return printable(message.encoding if hasattr(message, "encoding") else message.format, 60)


def image_size(message: Any, scratch: Path) -> tuple[int, int]:
    """(width, height) [px] of a depth image.

    Raises:
        InputError: for a compressed image that is no PNG.
    """
    if hasattr(message, "encoding"):
        return int(message.width), int(message.height)
    scratch.write_bytes(_png(message)[0])
    try:
        return png_size(scratch)
    finally:
        scratch.unlink()


def write_units(message: Any, encoding: str, metres: float, size: tuple[int, int], file: Path) -> None:
    """Write the depth image of a message as 16-bit PNG: 16UC1 unit by unit, 32FC1 in millimetres.

    Args:
        message: image or compressed image.
        encoding: that all images of the topic have.
        metres: [m] per unit of a 32FC1 image.
        size: (width, height) [px] that the intrinsics belong to.
        file: to write. One whose packed pixels are damaged is left there as it is, for the reader of PNGs to name.

    Raises:
        InputError: in words that follow the image's name.
    """
    if depth_encoding(message) != encoding:
        raise InputError(f"is {stated_kind(message)}, while the topic's first image is {encoding}.")
    if hasattr(message, "encoding"):
        image = _plain(message, encoding, size)
        write_png(file, image if encoding == "16UC1" else millimetres(image * metres))
        return
    png, quantum_a, quantum_b = _png(message)
    file.write_bytes(png)
    if encoding == "32FC1":
        units = read_png_units(file, size).astype(np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.where(units > 0, quantum_a / (units - quantum_b), np.nan)
        write_png(file, millimetres(depth * metres))


def write_png(file: Path, units: UInt16[np.ndarray, "height width"]) -> None:
    """Write an image of units, lightly packed: it is read again at once."""
    file.write_bytes(cv2.imencode(".png", units, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes())


def _plain(message: Any, encoding: str, size: tuple[int, int]) -> np.ndarray:
    width, height = int(message.width), int(message.height)
    if (width, height) != size:
        raise InputError(f"is {width} x {height} px but the intrinsics are for {size[0]} x {size[1]} px.")
    if width * height > MAX_PIXELS:
        raise InputError(f"has more than {MAX_PIXELS / 1e6:g} million pixels; record or scale it smaller.")
    pixel = np.dtype(np.uint16 if encoding == "16UC1" else np.float32).newbyteorder(
        ">" if message.is_bigendian else "<"
    )
    step, content = int(message.step), np.ascontiguousarray(message.data).view(np.uint8)
    if step < width * pixel.itemsize or content.size < height * step:
        raise InputError(
            f"is truncated: {content.size} bytes in rows of {step} are less than {width} x {height} px of {encoding}."
        )
    rows = content[: height * step].reshape(height, step)[:, : width * pixel.itemsize]
    return np.ascontiguousarray(rows).view(pixel).astype(pixel.newbyteorder("="))


def _png(message: Any) -> tuple[bytes, float, float]:
    """(PNG file, the two parameters of inverse depth) of a compressed image."""
    content = np.asarray(message.data).tobytes()
    if "compressedDepth" not in message.format and content.startswith(_PNG_SIGNATURE):
        return content, 0.0, 0.0
    if len(content) < _HEADER.size:
        raise InputError("is truncated: it has not even the 12 bytes of compressedDepth's header.")
    _, quantum_a, quantum_b = _HEADER.unpack_from(content)
    if not content[_HEADER.size :].startswith(_PNG_SIGNATURE):
        raise InputError(f"is packed as {stated_kind(message)}, of which only PNG is read; record it with png.")
    return content[_HEADER.size :], quantum_a, quantum_b

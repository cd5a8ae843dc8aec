"""sensor_msgs/CameraInfo: pinhole intrinsics, and images freed of the lens' distortion by OpenCV."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt16

from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics
from iwalker_jax.runtime import printable

_COEFFICIENTS = {"plumb_bob": (4, 5), "rational_polynomial": (8, 12, 14), "equidistant": (4,)}
"""Numbers of coefficients that each of sensor_msgs/distortion_models has."""


@dataclass(frozen=True)
class Calibration:
    """How a depth topic's pixels see.

    Attributes:
        intrinsics: of the undistorted images.
        source: column and row [px] in the recorded image of each undistorted pixel; None without distortion.
        sentence: what was done.
    """

    intrinsics: Intrinsics
    source: tuple[Float32[np.ndarray, "height width"], Float32[np.ndarray, "height width"]] | None
    sentence: str

    def undistorted(self, units: UInt16[np.ndarray, "height width"]) -> UInt16[np.ndarray, "height width"]:
        """The image of the pinhole camera; 0, no return, where the lens did not look.

        Every pixel takes the nearest recorded one: a mean across the edge of an object would be a depth at which there
        is nothing. The depth along the optical axis is the same whatever way the ray took through the lens.
        """
        if self.source is None:
            return units
        columns, rows = self.source
        return cv2.remap(units, columns, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0)


def calibration_of(info: Any, topic: str, rectified: bool) -> Calibration:
    """Calibration from a CameraInfo message of ROS 1 or 2.

    Args:
        info: with K (distorted image), D, distortion_model and P (rectified image).
        topic: of the message, for the sentences.
        rectified: whether the images were freed of distortion before they were recorded (image_rect): P is theirs.

    Raises:
        InputError: for a camera without calibration, an unknown distortion model, or images that are binned or cut.
    """
    name = printable(topic)
    size = (int(info.width), int(info.height))
    K, D, P = (_numbers(info, key) for key in ("k", "d", "p"))
    region = info.roi
    cut_out = (region.width, region.height) not in ((0, 0), size) or region.x_offset or region.y_offset
    if max(info.binning_x, info.binning_y) > 1 or cut_out:
        raise InputError(f"{name} says that images are binned or cut out; record whole images.")
    matrix = P.reshape(3, 4)[:, :3] if rectified and P.size == 12 and P[0] > 0 else K.reshape(3, 3)
    if not np.isfinite(matrix).all() or matrix[0, 0] <= 0:
        raise InputError(f"{name} holds no focal length; calibrate the camera, or give the intrinsics as arguments.")
    intrinsics = Intrinsics(*size, *(float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))))
    if rectified:
        return Calibration(
            intrinsics, None, f"The images are rectified by their topic's name, so {name}'s P is theirs."
        )
    if not D.any():
        return Calibration(intrinsics, None, f"{name} says that the images are free of distortion.")
    model = info.distortion_model
    if len(D) not in _COEFFICIENTS.get(model, ()) or not np.isfinite(D).all():
        known = ", ".join(f"{key} ({' or '.join(map(str, count))})" for key, count in _COEFFICIENTS.items())
        raise InputError(
            f"{name} has the distortion model {printable(repr(model))} with {len(D)} coefficients; known are {known}."
        )
    source = _source(matrix, D, model, size)
    return Calibration(intrinsics, source, f"The images are freed of the distortion in {name} ({model}).")


def _source(
    K: Float[np.ndarray, "3 3"], D: Float[np.ndarray, " n"], model: str, size: tuple[int, int]
) -> tuple[Float32[np.ndarray, "height width"], Float32[np.ndarray, "height width"]]:
    maps = cv2.fisheye.initUndistortRectifyMap if model == "equidistant" else cv2.initUndistortRectifyMap
    columns, rows = maps(K, D, np.eye(3), K, size, cv2.CV_32FC1)
    return columns, rows


def _numbers(info: Any, key: str) -> Float[np.ndarray, " n"]:
    """A field that is upper case in ROS 1."""
    return np.asarray(getattr(info, key, None) if hasattr(info, key) else getattr(info, key.upper()), np.float64)

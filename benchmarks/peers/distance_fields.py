"""Signed distance fields by others: positive outside of obstacles, zero at the edge of an occupied cell; in metres."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

RESOLUTION = 0.05
"""Side of a cell [m]."""


def by_scipy(occupied: np.ndarray) -> np.ndarray:
    """SciPy's exact transform, one a side."""
    from scipy.ndimage import distance_transform_edt

    signed = np.where(occupied, 0.5 - distance_transform_edt(occupied), distance_transform_edt(~occupied) - 0.5)
    return RESOLUTION * signed


def by_opencv(occupied: np.ndarray) -> np.ndarray:
    """OpenCV's precise transform, one a side."""
    import cv2

    free = 1 - occupied.astype(np.uint8)
    outside, inside = (cv2.distanceTransform(side, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for side in (free, 1 - free))
    return RESOLUTION * np.where(occupied, 0.5 - inside, outside - 0.5)


def by_edt(occupied: np.ndarray) -> np.ndarray:
    """The package edt's exact transform, one a side, on one thread."""
    import edt

    outside, inside = (edt.edt(side, black_border=False, parallel=1) for side in (~occupied, occupied))
    return RESOLUTION * np.where(occupied, 0.5 - inside, outside - 0.5)


def by_fast_marching(occupied: np.ndarray) -> np.ndarray:
    """scikit-fmm's second-order fast marching, about the same edge; approximate."""
    import skfmm

    return np.asarray(skfmm.distance(np.where(occupied, -0.5, 0.5), dx=RESOLUTION))


class Peer(NamedTuple):
    """Where a transform comes from, and how a map is handed to it."""

    module: str
    package: str
    field: Callable[[np.ndarray], np.ndarray]


PEERS = {
    "SciPy": Peer("scipy", "scipy", by_scipy),
    "OpenCV": Peer("cv2", "opencv-python-headless", by_opencv),
    "edt": Peer("edt", "edt", by_edt),
    "scikit-fmm, approximate": Peer("skfmm", "scikit-fmm", by_fast_marching),
}

PACKAGES = {peer.module: peer.package for peer in PEERS.values()}

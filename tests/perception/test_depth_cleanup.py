"""Depth clean-up against NumPy loops and OpenCV, and its host-side checks on bad input."""

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.perception.depth_cleanup import check_depth_image, clean_depth, depth_from_uint16, resize_depth


def _clean_by_loops(depth: np.ndarray, max_range: float, min_agreeing: int) -> np.ndarray:
    """The documented rule, one pixel at a time."""
    usable = np.isfinite(depth) & (depth > 0) & (depth <= max_range)
    cleaned = np.zeros(depth.shape, np.float32)
    for v, u in zip(*np.nonzero(usable)):
        agreeing = 0
        for dv in (-1, 0, 1):
            for du in (-1, 0, 1):
                row, column = v + dv, u + du
                if (dv or du) and 0 <= row < depth.shape[0] and 0 <= column < depth.shape[1] and usable[row, column]:
                    agreeing += abs(depth[row, column] - depth[v, u]) < np.float32(0.03 + 0.02 * depth[v, u] ** 2)
        if agreeing >= min_agreeing:
            cleaned[v, u] = depth[v, u]
    return cleaned


def test_clean_depth_equals_a_loop_over_pixels():
    """Oracle: the rule written as plain Python loops, on noise full of NaN, inf, negatives, zeros and ghosts."""
    rng = np.random.default_rng(0)
    depth = (2.0 + 0.08 * rng.standard_normal((24, 37))).astype(np.float32)
    for bad in (np.nan, np.inf, -np.inf, -1.0, 0.0, 65.0, 10.001):
        depth[rng.random(depth.shape) < 0.06] = bad
    depth[rng.random(depth.shape) < 0.1] = 7.0
    cleaned = jax.jit(clean_depth)(depth)
    expected = _clean_by_loops(depth, 10.0, 2)
    assert cleaned.dtype == jnp.float32
    assert 0.3 < (expected > 0).mean() < (depth > 0).mean() - 0.1
    np.testing.assert_array_equal(np.asarray(cleaned), expected)


def test_clean_depth_keeps_a_one_pixel_leg_and_drops_a_lone_ghost():
    depth = np.full((20, 20), 4.0, np.float32)
    depth[5:15, 8] = 2.0
    depth[10, 15] = 1.0
    cleaned = np.asarray(clean_depth(depth))
    assert (cleaned[6:14, 8] == 2.0).all()
    assert cleaned[10, 15] == 0.0


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf, -3.0, 50.0])
def test_clean_depth_of_a_useless_image_is_zero(value):
    np.testing.assert_array_equal(np.asarray(clean_depth(np.full((9, 16), value, np.float32))), 0.0)


@pytest.mark.parametrize("image", [np.zeros((9, 16), np.uint16), np.zeros((2, 9, 16), np.float32)])
def test_clean_depth_refuses_raw_units_and_batches(image, unchecked_types):
    with pytest.raises(InputError, match="floating-point metres"):
        jax.jit(clean_depth)(image)


def test_depth_from_uint16_is_metres():
    raw = np.array([[0, 1000], [5000, 65535]], np.uint16)
    np.testing.assert_allclose(depth_from_uint16(raw, 1 / 5000), [[0, 0.2], [1.0, 13.107]], rtol=1e-6)


@pytest.mark.parametrize(
    "image, scale, sentence",
    [
        (np.zeros((3, 3), np.uint8), 0.001, "uint16"),
        (np.zeros((3, 3, 1), np.uint16), 0.001, "single-channel"),
        (np.zeros((3, 3), np.uint16), 1000.0, "metres per unit"),
        (np.zeros((3, 3), np.uint16), -0.001, "metres per unit"),
        (np.zeros((3, 3), np.uint16), np.nan, "metres per unit"),
    ],
)
def test_depth_from_uint16_refuses_wrong_input(image, scale, sentence, unchecked_types):
    with pytest.raises(InputError, match=sentence):
        depth_from_uint16(image, scale)


@pytest.mark.parametrize(
    "image, sentence",
    [
        (np.zeros((3, 3, 1), np.float32), "height, width"),
        (np.zeros((0, 3), np.float32), "height, width"),
        (np.zeros((3, 3), np.uint16), "depth_from_uint16"),
        (np.full((3, 3), 1800.0, np.float32), "millimetres"),
    ],
)
def test_check_depth_image_refuses_wrong_input(image, sentence):
    with pytest.raises(InputError, match=sentence):
        check_depth_image(image)


def test_check_depth_image_allows_invalid_pixels():
    check_depth_image(np.array([[np.nan, np.inf], [-1.0, 0.0]], np.float32))
    check_depth_image(np.array([[np.nan, 65.0], [2.0, 1.5]], np.float64))


def test_resize_depth_equals_opencv_remap():
    """Oracle: cv2.remap with nearest sampling along the same rays, zeros outside the view."""
    rng = np.random.default_rng(1)
    source, target = Intrinsics(640, 480, 383.8, 383.8, 321.7, 236.8), Intrinsics()
    depth = rng.uniform(0.5, 9.0, (480, 640)).astype(np.float32)
    u, v = np.meshgrid(np.arange(160), np.arange(90))
    map_u = (u - target.cx) / target.fx * source.fx + source.cx
    map_v = (v - target.cy) / target.fy * source.fy + source.cy
    expected = cv2.remap(
        depth,
        np.floor(map_u + 0.5).astype(np.float32),
        np.floor(map_v + 0.5).astype(np.float32),
        cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT,
    )
    resized = np.asarray(resize_depth(depth, source, target))
    assert (expected[:, 0] == 0).all() and (expected[45] > 0).sum() > 120
    np.testing.assert_array_equal(resized, expected)


def test_resize_depth_to_the_same_camera_is_the_identity():
    depth = np.random.default_rng(2).uniform(0.0, 5.0, (90, 160)).astype(np.float32)
    np.testing.assert_array_equal(np.asarray(resize_depth(depth, Intrinsics(), Intrinsics())), depth)


def test_resize_depth_names_a_size_that_does_not_fit():
    with pytest.raises(InputError, match=r"shape \(180, 320\) but its intrinsics are for 90 rows and 160 columns"):
        resize_depth(jnp.zeros((180, 320)), Intrinsics(), Intrinsics())

"""Depth files of one image: written and read back, re-projected as a pinhole says, bad ones refused in a sentence."""

import cv2
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.perception.depth_png import read_depth, write_depth

CAMERA = Intrinsics()
TWICE = Intrinsics(320, 180, 160.0, 160.0, 159.5, 89.5)
"""The same view in four times as many pixels."""


def slanted(intrinsics: Intrinsics = CAMERA) -> np.ndarray:
    """z-depth [m] of a plane: 3 m at the image's middle, half a metre less for each metre to the right."""
    u = (np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx
    return np.broadcast_to(3.0 / (1.0 + 0.5 * u), (intrinsics.height, intrinsics.width)).astype(np.float32)


def test_what_is_written_is_read_to_half_a_unit(tmp_path):
    depth = np.where(np.arange(160) < 20, 0.0, slanted())
    write_depth(tmp_path / "new" / "depth.png", depth)
    again = read_depth(tmp_path / "new" / "depth.png")
    assert again.dtype == np.float32
    np.testing.assert_allclose(again, depth, atol=0.0005 + 1e-6)
    np.testing.assert_array_equal(again[:, :20], 0.0)


def test_scale_is_metres_per_unit(tmp_path):
    raw = np.full((90, 160), 5000, np.uint16)
    raw[0] = 10_000
    cv2.imwrite(str(tmp_path / "tum.png"), raw)
    assert read_depth(tmp_path / "tum.png", depth_scale=1 / 5000)[1, 0] == pytest.approx(1.0)
    assert read_depth(tmp_path / "tum.png", depth_scale=1 / 5000)[0, 0] == pytest.approx(2.0)


def test_a_scale_of_several_numbers_is_one_sentence(tmp_path, unchecked_types):
    with pytest.raises(InputError, match="give one number"):
        write_depth(tmp_path / "depth.png", np.ones((2, 2), np.float32), depth_scale=[1.0])


def test_another_camera_is_reprojected(tmp_path):
    write_depth(tmp_path / "depth.png", slanted(TWICE))
    seen = read_depth(tmp_path / "depth.png", TWICE)
    assert seen.shape == (90, 160)
    # The nearest pixel's ray is at most half a pixel off.
    np.testing.assert_allclose(seen, slanted(), rtol=0.01)
    wide = Intrinsics(100, 80, 50.0, 50.0, 49.5, 39.5)
    assert read_depth(tmp_path / "depth.png", TWICE, camera=wide).shape == (80, 100)


def test_no_return_and_far_away_are_zero(tmp_path):
    depth = slanted().copy()
    depth[0, :4] = np.nan, np.inf, -1.0, 70.0
    write_depth(tmp_path / "depth.png", depth)
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.png")[0, :4], 0.0)


def test_bad_files_and_images_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"missing\.png is missing\."):
        read_depth(tmp_path / "missing.png")
    write_depth(tmp_path / "large.png", slanted(TWICE))
    with pytest.raises(InputError, match=r"large\.png is 320 x 180 px but the intrinsics are for 160 x 90 px"):
        read_depth(tmp_path / "large.png")
    with pytest.raises(InputError, match="metres per unit"):
        read_depth(tmp_path / "large.png", TWICE, depth_scale=1000.0)
    with pytest.raises(InputError, match="metres per unit"):
        write_depth(tmp_path / "scale.png", slanted(), depth_scale=1000.0)
    with pytest.raises(InputError, match="in millimetres"):
        write_depth(tmp_path / "units.png", 1000.0 * slanted())
    with pytest.raises(InputError, match=r"\(height, width\)"):
        write_depth(tmp_path / "batch.png", slanted()[None])
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_depth(tmp_path / "file" / "depth.png", slanted())
    aside = Intrinsics(160, 90, 80.0, 80.0, 300.0, 44.5)
    write_depth(tmp_path / "depth.png", slanted())
    with pytest.raises(InputError, match="nothing that the planner's camera would see"):
        read_depth(tmp_path / "depth.png", CAMERA, camera=aside)

"""A depth image as a range scan, against scenes whose ranges are known by geometry."""

import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.perception import CameraMount, Intrinsics, ScanParameters, range_scan, strided
from iwalker_jax.perception.local_map import bearing_bin_count
from iwalker_jax.scenes import Scene, render_depth, world_camera_pose

CAMERA = Intrinsics(64, 36, 32.0, 32.0, 31.5, 17.5)
MOUNT = CameraMount().as_array()


def scan_of(boxes, pose=(0.0, 0.0, 0.0), change=lambda depth: depth, camera=CAMERA):
    scene = Scene(
        "scan", "test", np.asarray(boxes, float).reshape(-1, 7), np.zeros((0, 5)), (-9.0, -9.0, 9.0, 9.0), 9.0
    )
    depth = render_depth(scene.arrays(), camera, *world_camera_pose(jnp.asarray(pose), MOUNT))
    return range_scan(change(depth), MOUNT, camera)


def middle(values):
    """The bearings straight ahead."""
    half = bearing_bin_count(CAMERA) // 2
    return np.asarray(values[half - 1 : half + 1])


def test_a_wall_ahead_is_seen_at_its_distance():
    """Oracle: the wall's near face, 2 m ahead of the base; bearings begin at the camera, 2.8 cm ahead of it."""
    scan = scan_of([[2.1, 0.0, 0.5, 0.1, 3.0, 0.5, 0.0]])
    np.testing.assert_allclose(middle(scan.first), 2.0 - float(MOUNT[3]), atol=0.02)
    on_wall = np.asarray(scan.surface)
    np.testing.assert_allclose(np.asarray(scan.x)[on_wall], 2.0, atol=0.01)
    # The lowest row of the image meets the floor where its ray does.
    lowest = float(MOUNT[1]) + np.arctan((CAMERA.height - 1 - CAMERA.cy) / CAMERA.fy)
    np.testing.assert_allclose(middle(scan.nearest), float(MOUNT[0]) / np.tan(lowest), atol=0.02)


def test_what_the_body_walks_under_or_steps_over_ends_nothing():
    """Oracle: a beam above the body's height band and a strip lower than a step; one inside the band does end it."""
    over = [2.0, 0.0, 1.5, 0.1, 3.0, 0.5, 0.0]
    under = [1.5, 0.0, 0.005, 0.1, 3.0, 0.005, 0.0]
    assert not np.isfinite(middle(scan_of([over, under]).first)).any()
    inside = [2.0, 0.0, 0.55, 0.1, 3.0, 0.05, 0.0]
    np.testing.assert_allclose(middle(scan_of([inside]).first), 1.9 - float(MOUNT[3]), atol=0.02)


def test_a_pixel_without_a_neighbour_at_its_range_is_noise():
    """Oracle: one false match in mid-air before empty floor; the same range in two rows counts."""
    lone = scan_of([], change=lambda depth: depth.at[14, 32].set(0.8))
    assert not np.isfinite(np.asarray(lone.first)).any()
    pair = scan_of([], change=lambda depth: depth.at[14:16, 32].set(0.8))
    assert np.isfinite(np.asarray(pair.first)).any()


def test_an_image_without_any_return_shows_nothing():
    """Oracle: no pixel, no surface."""
    scan = scan_of([], change=jnp.zeros_like)
    assert not np.isfinite(np.asarray(scan.first)).any() and not np.asarray(scan.surface).any()
    assert float(scan.farthest.max()) == 0.0


def test_every_second_pixel_sees_the_same_world():
    """Oracle: the pixels of the strided image are pixels of the whole one, so that their points are the same."""
    whole = scan_of([[2.1, 0.3, 0.5, 0.1, 0.4, 0.5, 0.3]])
    camera = strided(CAMERA, 2)
    depth = render_depth(
        Scene(
            "scan", "test", np.array([[2.1, 0.3, 0.5, 0.1, 0.4, 0.5, 0.3]]), np.zeros((0, 5)), (-9, -9, 9, 9), 9.0
        ).arrays(),
        CAMERA,
        *world_camera_pose(jnp.zeros(3), MOUNT),
    )
    half = range_scan(depth[::2, ::2], MOUNT, camera)
    np.testing.assert_allclose(half.x, np.asarray(whole.x)[::2, ::2], atol=1e-5)
    np.testing.assert_allclose(half.y, np.asarray(whole.y)[::2, ::2], atol=1e-5)


def test_parameters_that_cannot_be_are_refused():
    """Oracle: lengths are positive."""
    with pytest.raises(InputError, match="support"):
        ScanParameters(support=0.0)
    with pytest.raises(InputError, match="depth"):
        ScanParameters(depth=-0.1)

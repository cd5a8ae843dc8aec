"""The depth noise model against figures measured on a real RealSense and against stereo geometry."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.commands.show_depth_noise import frame_statistics, quietest_stretch
from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.scenes.depth_noise import DepthNoise, add_depth_noise
from iwalker_jax.scenes.ray_casting import render_depth, world_camera_pose
from iwalker_jax.scenes.scene import Scene

REAL_SIZE = Intrinsics(640, 480, 383.8, 383.8, 319.5, 239.5)
QUIET = DepthNoise(
    near_std=0.0, std_at_1m=0.0, near_holes=0.0, far_holes=0.0, edge_holes=0.0, ghosts=0.0, dead_band=0.0
)
POSTS = [
    [1.25, -0.7, 0.5, 0.15, 0.2, 0.5, 0.0],
    [2.15, 0.4, 0.3, 0.15, 0.2, 0.3, 0.0],
    [3.35, -1.2, 0.7, 0.15, 0.3, 0.7, 0.0],
    [0.92, 0.62, 0.6, 0.03, 0.03, 0.6, 0.0],
    [2.62, -0.28, 0.55, 0.03, 0.03, 0.55, 0.0],
    [3.9, 1.85, 0.55, 0.3, 0.55, 0.55, 0.0],
    [5.1, 0.0, 1.5, 0.1, 9.0, 1.5, 0.0],
]

noisy = jax.jit(add_depth_noise, static_argnames=("noise", "intrinsics", "straight_through"))


def _furnished_room(intrinsics: Intrinsics) -> np.ndarray:
    """Ideal depth of posts and boxes before a wall 5 m away, through the mount of the real frames."""
    scene = Scene("room", "test", np.array(POSTS), np.zeros((0, 5)), (-2.0, -5.0, 5.0, 5.0)).arrays()
    mount = CameraMount(height=0.62, pitch=np.deg2rad(18.9), roll=np.deg2rad(10.4)).as_array()
    return np.asarray(render_depth(scene, intrinsics, *world_camera_pose(jnp.zeros(3), mount)), np.float32)


def _frames(depth: np.ndarray, intrinsics: Intrinsics, count: int, noise: DepthNoise) -> np.ndarray:
    keys = jax.random.split(jax.random.key(3), count)
    return np.stack([noisy(key, depth, noise, intrinsics, jax.random.key(7)) for key in keys])


@pytest.mark.parametrize("intrinsics", [REAL_SIZE, Intrinsics()], ids=["640x480", "160x90"])
def test_static_scene_has_the_statistics_of_a_real_camera(intrinsics):
    """Oracle: figures measured on real frames. Temporal std median/p95 2/5, 4/13, 27/70, 70/206 mm within 40 %;
    flicker 2.9 +- 1 %; invalid 9 +- 2.5 %; 70 +- 25 holes.
    """
    found = frame_statistics(_frames(_furnished_room(intrinsics), intrinsics, 8, DepthNoise()))
    np.testing.assert_allclose(found.std_median, [0.002, 0.004, 0.027, 0.070], rtol=0.4)
    np.testing.assert_allclose(found.std_p95, [0.005, 0.013, 0.070, 0.206], rtol=0.4)
    assert abs(found.flicker - 0.029) < 0.01
    assert abs(found.invalid - 0.09) < 0.025
    assert abs(found.holes - 70) < 25


def test_real_frames_have_these_statistics(real_depth_folder):
    """The same measurement on the quietest real frames falls within a factor of two of the model's targets."""
    import cv2

    paths = sorted(real_depth_folder.glob("*.png"))[:12]
    frames = np.stack([cv2.imread(str(p), cv2.IMREAD_UNCHANGED) for p in paths]).astype(np.float32) * 1e-3
    found = frame_statistics(quietest_stretch(frames))
    ratio = np.array(found.std_median) / [0.002, 0.004, 0.027, 0.070]
    assert ((ratio > 0.5) & (ratio < 2.0)).all()
    assert 0.015 < found.flicker < 0.045
    assert 0.05 < found.invalid < 0.18


def test_noise_is_correlated_over_the_matching_window_and_not_beyond():
    """Oracle: NumPy correlation of the temporal residual; real frames have 0.69 at 6 px and 0.31 at 12 px."""
    depth = np.full((480, 640), 1.5, np.float32)
    frames = _frames(depth, REAL_SIZE, 6, dataclasses.replace(QUIET, near_std=0.02))[:, :, 40:]
    residual = frames - frames.mean(axis=0)
    correlation = [np.corrcoef(residual[..., s:].ravel(), residual[..., :-s].ravel())[0, 1] for s in (1, 6, 40)]
    assert correlation[0] > 0.9 and 0.5 < correlation[1] < 0.9 and abs(correlation[2]) < 0.1


def test_without_noise_only_quantisation_remains():
    """Oracle: inverse depths are multiples of (1/32 px) / (f b) and the nearest such multiple."""
    depth = np.linspace(0.5, 9.0, 480 * 640, dtype=np.float32).reshape(480, 640)
    measured = np.asarray(noisy(jax.random.key(0), depth, QUIET, REAL_SIZE))
    kept = measured > 0
    assert kept.mean() > 0.9
    step = 1.0 / 32.0 / (383.8 * 0.05)
    quanta = 1.0 / measured[kept].astype(np.float64) / step
    np.testing.assert_allclose(quanta, np.round(quanta), atol=2e-3)
    assert np.abs(quanta - 1.0 / depth[kept].astype(np.float64) / step).max() < 0.502


def test_shadows_lie_left_of_near_edges_as_wide_as_the_disparity_step():
    """Oracle: f b (1/near - 1/far) pixels, the stretch of background the right imager cannot see."""
    depth = np.full((480, 640), 4.0, np.float32)
    depth[:, 300:400] = 1.0
    measured = np.asarray(noisy(jax.random.key(0), depth, QUIET, REAL_SIZE))
    width = 383.8 * 0.05 * (1 / 1.0 - 1 / 4.0)
    hidden = np.flatnonzero((measured[240] == 0)[100:600]) + 100
    assert abs(len(hidden) - width) <= 1.0
    assert hidden.min() >= 300 - width - 1.0 and hidden.max() == 299


def test_dead_band_is_six_pixels_and_wider_for_near_surfaces():
    band = dataclasses.replace(QUIET, dead_band=6.0)
    far = np.asarray(noisy(jax.random.key(0), np.full((480, 640), 9.0, np.float32), band, REAL_SIZE))
    near = np.asarray(noisy(jax.random.key(0), np.full((480, 640), 1.0, np.float32), band, REAL_SIZE))
    assert (far[:, :6] == 0).all() and (far[:, 6:] > 0).all()
    assert (near[:, :19] == 0).all() and (near[:, 20:] > 0).all()


def test_ghosts_reach_from_near_to_65_metres():
    ghostly = dataclasses.replace(QUIET, ghosts=0.05)
    depth = np.full((480, 640), 2.0, np.float32)
    measured = np.asarray(noisy(jax.random.key(0), depth, ghostly, REAL_SIZE))[:, 20:]
    ghost = (measured > 0) & (np.abs(measured - 2.0) > 0.1)
    assert abs(ghost.mean() - 0.05) < 0.01
    assert measured[ghost].min() < 0.6 and 50.0 < measured[ghost].max() <= 65.0


@pytest.mark.parametrize("value", [0.0, 0.05, 9.9])
def test_extreme_frames_stay_finite(value):
    measured = np.asarray(noisy(jax.random.key(1), np.full((90, 160), value, np.float32), DepthNoise(), Intrinsics()))
    assert measured.dtype == np.float32
    assert np.isfinite(measured).all() and (measured >= 0).all()
    if value < 0.2:
        assert (measured > 0).mean() < 0.01


def test_frames_depend_on_their_key_alone():
    """vmap equals single calls; equal keys give equal frames; surfaces differ between surface keys."""
    depth = _furnished_room(Intrinsics())
    keys = jax.random.split(jax.random.key(5), 3)
    batched = jax.vmap(lambda k, d: add_depth_noise(k, d, DepthNoise(), Intrinsics()))(keys, jnp.stack([depth] * 3))
    for key, frame in zip(keys, batched):
        single = noisy(key, depth, DepthNoise(), Intrinsics())
        assert np.mean(np.abs(np.asarray(frame) - np.asarray(single)) > 1e-3) < 1e-3
    assert np.mean((np.asarray(batched[0]) > 0) != (np.asarray(batched[1]) > 0)) > 0.05


def test_a_depth_image_of_another_size_is_refused():
    with pytest.raises(InputError, match="90 rows and 160 columns"):
        add_depth_noise(jax.random.key(0), jnp.ones((180, 320)), DepthNoise(), Intrinsics())


@pytest.mark.parametrize("bad", [{"baseline": 0.0}, {"near_std": -1.0}, {"far_holes": 1.5}, {"max_ghost": 0.1}])
def test_noise_that_cannot_be_is_refused(bad):
    with pytest.raises(InputError):
        DepthNoise(**bad)


def test_a_derivative_goes_straight_through_the_rounding_if_asked(x64):
    """Oracle: central differences of the same noise in steps too fine to matter; bits of the rounded values.

    Depths are 1 / disparity, so the two derivatives compare as those of the disparity.
    """
    small = Intrinsics(40, 30, 20.0, 20.0, 19.5, 14.5)
    key, coarse = jax.random.key(2), dataclasses.replace(DepthNoise(), ghosts=0.0)
    fine = dataclasses.replace(coarse, disparity_step=1e-9)
    depth = jnp.asarray(np.linspace(1.0, 4.0, 30)[:, None] + 0.01 * np.arange(40)).at[3, 4].set(0.0)
    values = noisy(key, depth, coarse, small)
    np.testing.assert_array_equal(noisy(key, depth, coarse, small, straight_through=True), values)

    def disparity(depth, noise, straight_through=True):
        seen = noisy(key, depth, noise, small, straight_through=straight_through)
        return jnp.where(seen > 0, 1.0 / jnp.where(seen > 0, seen, 1.0), 0.0)

    ones, step = jnp.where(depth > 0, 1.0, 0.0), 1e-4
    value, forward = jax.jvp(lambda d: disparity(d, coarse), (depth,), (ones,))
    numeric = (disparity(depth + step * ones, fine) - disparity(depth - step * ones, fine)) / (2 * step)
    kept = np.asarray((value > 0) & (disparity(depth, fine) > 0) & (jnp.abs(numeric) < 10.0))
    assert kept.mean() > 0.5
    np.testing.assert_allclose(forward[kept], numeric[kept], rtol=1e-3, atol=1e-5)
    assert np.all(np.asarray(forward)[np.asarray(value) == 0] == 0)
    # Each pixel's value feels its own depth alone, so a sum's gradient is the derivative along ones.
    reverse = jax.grad(lambda d: jnp.sum(disparity(d, coarse)))(depth)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(jax.grad(lambda d: jnp.sum(disparity(d, coarse, False)))(depth), 0)
    assert np.all(np.isfinite(jax.grad(lambda d: jnp.sum(disparity(d, QUIET)))(depth)))

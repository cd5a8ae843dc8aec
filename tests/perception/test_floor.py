"""Floor fit against mounts that are known because the scene was rendered with them."""

import jax
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.perception.floor import FloorParameters, MountUncertainty, align_to_floor, fit_floor
from tests.perception.box_scene import render

INTRINSICS = Intrinsics()
FURNITURE = [
    (2.5, 2.7, -3.0, 3.0, 0.0, 2.5),
    (1.2, 2.0, -1.2, -0.3, 0.38, 0.42),
    (1.0, 1.4, 0.4, 0.9, 0.0, 0.5),
]

fit = jax.jit(fit_floor, static_argnames=("intrinsics", "parameters"))
align = jax.jit(align_to_floor, static_argnames=("intrinsics", "uncertainty"))


def _stereo_noise(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Noise that is uniform in disparity: 5 mm at 1 m, 80 mm at 4 m; one pixel in ten without a return."""
    noisy = depth + 0.005 * depth**2 * rng.standard_normal(depth.shape)
    return np.where(rng.random(depth.shape) < 0.1, 0.0, noisy).astype(np.float32)


@pytest.mark.parametrize("seed", range(12))
def test_mount_is_recovered_from_a_furnished_noisy_room(seed):
    """Oracle: the mount the room was rendered with; heights 0.4-1.2 m, pitch 5-40 degrees, roll up to 12 degrees."""
    rng = np.random.default_rng(seed)
    mount = CameraMount(
        height=rng.uniform(0.4, 1.2), pitch=np.deg2rad(rng.uniform(5, 40)), roll=np.deg2rad(rng.uniform(-12, 12))
    )
    found = fit(_stereo_noise(render(INTRINSICS, mount, FURNITURE), rng), INTRINSICS)
    assert found.valid and 0.08 < found.inlier_fraction <= 1.0
    assert abs(found.height - mount.height) < 0.015 * max(1.0, mount.height / 0.6)
    assert abs(found.pitch - mount.pitch) < np.deg2rad(1.0)
    assert abs(found.roll - mount.roll) < np.deg2rad(1.0)


def test_noise_free_floor_is_exact():
    mount = CameraMount(height=0.62, pitch=np.deg2rad(18.9), roll=np.deg2rad(10.4))
    found = fit(render(INTRINSICS, mount, []), INTRINSICS)
    np.testing.assert_allclose([found.height, found.pitch, found.roll], [0.62, mount.pitch, mount.roll], atol=1e-4)
    assert found.inlier_fraction == 1.0
    np.testing.assert_allclose(found.mount(0.1, -0.02), [0.62, mount.pitch, mount.roll, 0.1, -0.02], atol=1e-4)


def test_a_table_that_fills_more_pixels_than_the_floor_is_not_the_floor():
    mount = CameraMount(height=1.1, pitch=np.deg2rad(35))
    depth = render(INTRINSICS, mount, [(0.4, 1.6, -0.6, 2.0, 0.68, 0.72)])
    points_on_table = np.sum((depth > 0) & (depth < 1.2))
    assert points_on_table > 0.4 * depth.size
    found = fit(depth, INTRINSICS)
    assert found.valid
    assert abs(found.height - 1.1) < 0.02


@pytest.mark.parametrize("kind", ["zero", "wall", "noise", "near"])
def test_frames_without_a_floor_are_invalid_and_finite(kind):
    rng = np.random.default_rng(0)
    depth = {
        "zero": np.zeros((90, 160)),
        "wall": np.full((90, 160), 1.5),
        "noise": rng.uniform(0.2, 9.0, (90, 160)),
        "near": np.full((90, 160), 0.05),
    }[kind].astype(np.float32)
    found = fit(depth, INTRINSICS)
    assert not found.valid
    assert np.isfinite([float(x) for x in found]).all()


def test_a_depth_image_of_another_size_is_refused():
    with pytest.raises(InputError, match="90 rows and 160 columns"):
        fit(np.ones((180, 320), np.float32), INTRINSICS)


def test_batch_equals_single_frames():
    mounts = [CameraMount(), CameraMount(height=0.9, pitch=0.5, roll=-0.1)]
    depths = np.stack([render(INTRINSICS, m, FURNITURE) for m in mounts])
    batched = jax.jit(jax.vmap(lambda d: fit_floor(d, INTRINSICS)))(depths)
    for k in range(2):
        np.testing.assert_allclose(
            [float(x[k]) for x in batched], [float(x) for x in fit(depths[k], INTRINSICS)], atol=1e-4
        )


def test_real_frames_give_the_known_mount(real_depth_folder):
    """Oracle: the documented mount, 0.62 m, 18.9 degrees down, 10.4 degrees of roll, +- a degree or two a frame."""
    import cv2

    intrinsics = Intrinsics(640, 480, 383.8, 383.8, 321.7, 236.8)
    paths = sorted(real_depth_folder.glob("*.png"))[::10]
    fits = [fit((cv2.imread(str(p), cv2.IMREAD_UNCHANGED) * 1e-3).astype(np.float32), intrinsics) for p in paths]
    assert np.mean([bool(f.valid) for f in fits]) > 0.9
    good = np.array([[f.height, np.rad2deg(f.pitch), np.rad2deg(f.roll)] for f in fits if f.valid])
    np.testing.assert_array_less(np.abs(np.median(good, axis=0) - [0.62, 18.9, 10.4]), [0.02, 1.0, 1.0])


@pytest.mark.parametrize("bad", [{"min_height": 3.0}, {"max_roll": 2.0}, {"min_inliers": 0.0}, {"max_depth": -1.0}])
def test_parameters_that_cannot_be_are_refused(bad):
    with pytest.raises(InputError):
        FloorParameters(**bad)


def _mount_errors(boxes: list, seeds: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """(seeds, 3) errors of height [m], pitch and roll [rad] of believed mounts, before and after alignment."""
    before, after = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        pitch, roll = rng.normal([0.26, 0.0], 0.02)
        mount = CameraMount(height=rng.normal(0.58, 0.004), pitch=pitch, roll=roll)
        depth = render(INTRINSICS, mount, boxes)
        depth = (depth + 0.0025 * depth**2 * rng.standard_normal(depth.shape)).astype(np.float32)
        error = np.clip(rng.standard_normal(3), -1.9, 1.9) * [0.005, np.deg2rad(0.5), np.deg2rad(0.5)]
        believed = mount.as_array() + np.append(error, [0.0, 0.0]).astype(np.float32)
        before.append(error)
        after.append(np.asarray(align(depth, believed, INTRINSICS) - mount.as_array())[:3])
    return np.array(before), np.array(after)


@pytest.mark.parametrize("boxes", [[], FURNITURE, [(1.36, 1.44, -0.8, 0.8, 0.0, 0.03)]], ids=["bare", "room", "bar"])
def test_a_believed_mount_is_corrected_by_the_floor_in_view(boxes):
    """Oracle: the mount the scene was rendered with; what is left lifts the floor 0.9 m ahead by less than 10 mm."""
    before, after = _mount_errors(boxes)
    lift = np.array([1.0, 0.9, 0.0])
    assert np.sqrt(np.mean((before @ lift) ** 2)) > 0.007
    assert np.sqrt(np.mean((after @ lift) ** 2)) < 0.0045 and np.abs(after @ lift).max() < 0.010
    assert np.sqrt(np.mean(after[:, 2] ** 2)) < 0.5 * np.sqrt(np.mean(before[:, 2] ** 2))


def test_a_platform_pulls_the_believed_floor_up_by_little():
    """Oracle: a platform of 60 mm from 0.8 m on; its height over the aligned floor stays above what is stepped over."""
    _, after = _mount_errors([(0.8, 3.0, -0.8, 0.8, 0.0, 0.06)])
    assert np.abs(after @ [1.0, 0.9, 0.0]).max() < 0.025


def test_without_floor_in_view_the_mount_stays_and_no_correction_passes_its_limit():
    """Oracle: by construction; no return, a wall alone, and a floor that lies 10 cm lower than believed."""
    mount, uncertainty = CameraMount(), MountUncertainty()
    wall = render(INTRINSICS, mount, [(0.5, 0.6, -5.0, 5.0, -1.0, 3.0)], floor=False)
    for depth in (np.zeros_like(wall), wall):
        np.testing.assert_allclose(align(depth, mount.as_array(), INTRINSICS), mount.as_array(), atol=1e-3)
    lower = render(INTRINSICS, CameraMount(height=0.68), [])
    change = np.abs(np.asarray(align(lower, mount.as_array(), INTRINSICS)) - np.asarray(mount.as_array()))
    spread = np.array([uncertainty.height, uncertainty.tilt, uncertainty.tilt, 0.0, 0.0])
    assert (change <= uncertainty.limit * spread + 1e-6).all()
    with pytest.raises(InputError, match="positive"):
        MountUncertainty(reach=0.0)

"""Recordings in three layouts against images and poses that are known because the test wrote them."""

import math
import shutil

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from iwalker_jax.data.recordings import load_recording, validate_recording
from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import CameraMount, Intrinsics, camera_pose
from tests.data.recording_folders import (
    CAMERA_HEIGHT,
    INTRINSICS,
    PITCH,
    ROLL,
    floor_image,
    write_iplanner_recording,
    write_tum_recording,
    write_yaml_recording,
)

BODY_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def _optical_quaternion(pitch: float, roll: float) -> list[float]:
    """Oracle: SciPy's quaternion of an optical frame pitched down, then rolled about its own axis."""
    level = Rotation.from_euler("y", pitch).as_matrix() @ BODY_FROM_OPTICAL
    return Rotation.from_matrix(level @ Rotation.from_euler("z", roll).as_matrix()).as_quat().tolist()


def test_yaml_recording_with_everything(tmp_path):
    """Oracle: OpenCV's remap of the image the test wrote."""
    mount = {"height": 0.6, "pitch_deg": 20.0, "roll_deg": 6.0, "forward": 0.05, "left": 0.01}
    poses, goals = [[0.0, 0.0, 0.0], [0.5, 0.1, 0.2], [1.0, 0.3, 0.4]], [[3.0, 0.0], [2.5, 0.1], [2.0, 0.2]]
    recording = load_recording(write_yaml_recording(tmp_path, mount=mount, poses=poses, goals=goals))
    frames = recording.depth_frames()
    assert frames.shape == (3, 90, 160) and frames.dtype == np.float32
    u, v = (np.arange(160) - 79.5) / 80.0 * 60.0 + 59.5, (np.arange(90) - 44.5) / 80.0 * 60.0 + 44.5
    u, v = np.meshgrid(np.floor(u + 0.5).astype(np.float32), np.floor(v + 0.5).astype(np.float32))
    for k in range(3):
        metres = (floor_image(1000.0, 0.01 * k) * 1e-3).astype(np.float32)
        np.testing.assert_allclose(frames[k], cv2.remap(metres, u, v, cv2.INTER_NEAREST), rtol=1e-6)
    np.testing.assert_allclose(recording.mounts, np.tile([0.6, PITCH, ROLL, 0.05, 0.01], (3, 1)), rtol=1e-6)
    np.testing.assert_allclose(recording.poses, poses, rtol=1e-6)
    np.testing.assert_allclose(recording.goals, goals, rtol=1e-6)
    assert recording.report.is_usable and not recording.report.problems and not recording.report.assumptions


def test_without_a_mount_the_floor_is_fitted_and_reported(tmp_path):
    recording = load_recording(write_yaml_recording(tmp_path))
    np.testing.assert_allclose(recording.mounts[:, 0], CAMERA_HEIGHT, atol=0.01)
    np.testing.assert_allclose(recording.mounts[:, 1:3], np.tile([PITCH, ROLL], (3, 1)), atol=np.deg2rad(0.5))
    assert recording.poses is None
    assert any("fitted" in text and "3 of 3" in text for text in recording.report.assumptions)
    assert recording.report.mount is not None and abs(recording.report.mount[0] - CAMERA_HEIGHT) < 0.01


def test_poses_from_a_text_file_and_a_symbolic_link_to_the_images(tmp_path):
    images = write_yaml_recording(tmp_path / "elsewhere") / "depth"
    folder = write_yaml_recording(tmp_path / "linked", poses="poses.txt")
    shutil.rmtree(folder / "depth")
    (folder / "depth").symlink_to(images)
    (folder / "poses.txt").write_text("# x y yaw\n0 0 0\n1, 2, 0.5\n[2 3 1.0]\n")
    np.testing.assert_allclose(load_recording(folder).poses, [[0, 0, 0], [1, 2, 0.5], [2, 3, 1.0]])


def test_bare_images_with_intrinsics_given(tmp_path):
    write_yaml_recording(tmp_path)
    (tmp_path / "recording.yaml").unlink()
    assert "intrinsics" in (validate_recording(tmp_path).fatal or "")
    recording = load_recording(tmp_path / "depth", intrinsics=Intrinsics(**INTRINSICS))
    assert len(recording) == 3
    assert any("1 mm" in text for text in recording.report.assumptions)


def test_tum_recording_takes_the_nearest_pose_in_time(tmp_path):
    """Oracle: SciPy rotations. Image 2 has no pose within 0.05 s and is left out."""
    heading = Rotation.from_euler("z", 0.7) * Rotation.from_quat(_optical_quaternion(PITCH, ROLL))
    quaternion = " ".join(f"{q:.9f}" for q in heading.as_quat())
    rows = [f"99.99 1.0 2.0 0.6 {quaternion}", f"100.11 1.5 2.5 0.6 {quaternion}", f"100.4 9 9 9 {quaternion}"]
    recording = load_recording(write_tum_recording(tmp_path, rows), intrinsics=Intrinsics(**INTRINSICS))
    np.testing.assert_allclose(recording.poses, [[1.0, 2.0, 0.7], [1.5, 2.5, 0.7]], atol=1e-6)
    np.testing.assert_allclose(recording.depth_frames()[0].max(), 4.0, atol=1e-3)
    assert [p.file for p in recording.report.problems] == ["depth/100.200000.png"]
    assert "pose" in recording.report.problems[0].problem


def test_tum_defaults_are_reported(tmp_path):
    report = validate_recording(write_tum_recording(tmp_path, []))
    assert report.intrinsics is not None and report.intrinsics.fx == 525.0
    assert not report.is_usable and "120 x 90 px but the intrinsics are for 640 x 480" in (report.fatal or "")
    assert any("5000" in text for text in report.assumptions)


@pytest.mark.parametrize("converted", [False, True], ids=["collected", "converted"])
def test_iplanner_recording(tmp_path, converted):
    """Oracle: SciPy rotations; both orders of the extrinsics and both sizes of the projection matrix."""
    position, quaternion = [0.3, 0.0, 0.1], _optical_quaternion(PITCH, ROLL)
    odometry = [[0.1 * k, 0.2 * k, 0.5, *Rotation.from_euler("z", 0.3 * k).as_quat()] for k in range(3)]
    odometry = [[float(x) for x in row] for row in odometry]
    extrinsics = quaternion + position if converted else position + quaternion
    recording = load_recording(write_iplanner_recording(tmp_path, odometry, extrinsics, wide_matrix=converted))
    np.testing.assert_allclose(recording.poses, [[0.1 * k, 0.2 * k, 0.3 * k] for k in range(3)], atol=1e-6)
    expected = [CAMERA_HEIGHT, PITCH, ROLL, 0.3, 0.0]
    np.testing.assert_allclose(recording.mounts, np.tile(expected, (3, 1)), atol=0.01)


def test_iplanner_camera_upside_down_is_turned(tmp_path):
    """Oracle: the same floor from an upright camera."""
    upright = [0.0, 0.0, 0.0, *_optical_quaternion(PITCH, ROLL)]
    flipped = [0.0, 0.0, 0.0, *_optical_quaternion(PITCH, ROLL + math.pi)]
    odometry = [[0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]] * 3
    expected = load_recording(write_iplanner_recording(tmp_path / "upright", odometry, upright))
    folder = write_iplanner_recording(tmp_path / "flipped", odometry, flipped)
    for path in (folder / "depth").glob("*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[::-1, ::-1])
    found = load_recording(folder)
    np.testing.assert_allclose(found.mounts, expected.mounts, atol=1e-5)
    # Half-pixel ties of nearest sampling fall to the other side in a turned image.
    assert np.mean(np.abs(found.depth_frames() - expected.depth_frames()) > 0.2) < 0.05
    assert any("upside down" in text for text in found.report.assumptions)


def test_iplanner_images_are_paired_by_number_when_one_is_missing(tmp_path):
    odometry = [[float(k), 0.0, 0.5, 0.0, 0.0, 0.0, 1.0] for k in range(3)]
    folder = write_iplanner_recording(tmp_path, odometry, [0.0, 0.0, 0.0, *_optical_quaternion(PITCH, ROLL)])
    (folder / "depth" / "1.png").unlink()
    recording = load_recording(folder)
    np.testing.assert_allclose(recording.poses[:, 0], [0.0, 2.0])
    assert {p.file for p in recording.report.problems} == {"odom_ground_truth.txt", "depth/1.png"}


def test_camera_tilt_is_the_inverse_of_camera_pose():
    from iwalker_jax.data.recordings.metadata import camera_tilt

    R_base_camera, _ = camera_pose(CameraMount(pitch=0.33, roll=-0.2).as_array())
    np.testing.assert_allclose(camera_tilt(np.asarray(R_base_camera)), [0.33, -0.2], atol=1e-6)


def test_a_recording_that_goes_bad_after_loading_says_so(tmp_path):
    recording = load_recording(write_yaml_recording(tmp_path))
    (tmp_path / "depth" / "000001.png").unlink()
    with pytest.raises(InputError, match=r"000001\.png is missing"):
        recording.depth_frames()


def test_real_recording_is_usable_with_its_fitted_mount(real_depth_folder, tmp_path):
    """Oracle: the documented mount of the real frames, 0.62 m, 18.9 degrees down, 10.4 degrees of roll."""
    (tmp_path / "depth").mkdir()
    for path in sorted(real_depth_folder.glob("*.png"))[::20]:
        (tmp_path / "depth" / path.name).symlink_to(path)
    (tmp_path / "recording.yaml").write_text(
        "intrinsics: {width: 640, height: 480, fx: 383.8, fy: 383.8, cx: 321.7, cy: 236.8}\ndepth_scale: 0.001\n"
    )
    recording = load_recording(tmp_path)
    assert len(recording) == 7 and not recording.report.problems
    median = np.median(recording.mounts, axis=0)
    np.testing.assert_array_less(np.abs(median[:3] - [0.62, np.deg2rad(18.9), np.deg2rad(10.4)]), [0.02, 0.02, 0.02])

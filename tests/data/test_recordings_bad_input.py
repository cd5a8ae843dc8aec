"""Damaged recordings: every file that is wrong is named with what is wrong, and the rest stays usable."""

import subprocess
import sys

import cv2
import numpy as np
import pytest

from iwalker_jax.data.recordings import load_recording, validate_recording
from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import Intrinsics
from tests.data.recording_folders import (
    INTRINSICS,
    floor_image,
    write_iplanner_recording,
    write_tum_recording,
    write_yaml_recording,
)


def _truncate(path):
    path.write_bytes(path.read_bytes()[:-300])


def _flip_a_byte(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(bytes(content))


DAMAGE = {
    "truncated": _truncate,
    "damaged": _flip_a_byte,
    "empty": lambda path: path.write_bytes(b""),
    "not a PNG": lambda path: path.write_bytes(b"\xff\xd8\xff" + b"0" * 500),
    "colour image": lambda path: cv2.imwrite(str(path), np.full((90, 120, 3), 9, np.uint16)),
    "preview": lambda path: cv2.imwrite(str(path), (floor_image(1000.0) // 20).astype(np.uint8)),
    "80 x 60 px but": lambda path: cv2.imwrite(str(path), floor_image(1000.0)[:60, :80]),
    "no return in any": lambda path: cv2.imwrite(str(path), np.zeros((90, 120), np.uint16)),
    "same value 1500": lambda path: cv2.imwrite(str(path), np.full((90, 120), 1500, np.uint16)),
    "check the scale": lambda path: cv2.imwrite(str(path), np.maximum(floor_image(1000.0), 700) * 15),
}


@pytest.mark.parametrize("sentence", DAMAGE)
def test_one_bad_image_is_named_and_left_out(tmp_path, sentence):
    folder = write_yaml_recording(tmp_path)
    DAMAGE[sentence](folder / "depth" / "000001.png")
    report = validate_recording(folder)
    assert report.found == 3 and report.usable == ("depth/000000.png", "depth/000002.png")
    assert [p.file for p in report.problems] == ["depth/000001.png"]
    assert sentence in report.problems[0].problem
    assert load_recording(folder).depth_frames().shape[0] == 2


@pytest.mark.parametrize(
    "content, sentence",
    [
        ({"intrinsics": None}, "intrinsics are unknown"),
        ({"intrinsics": INTRINSICS | {"fx": -1.0}}, "positive"),
        ({"intrinsics": INTRINSICS | {"fx": 6000.0, "fy": 6000.0}}, "field of view"),
        ({"intrinsics": INTRINSICS | {"fy": 140.0}}, "differ too much"),
        ({"intrinsics": INTRINSICS | {"cx": 150.0}}, "principal point"),
        ({"intrinsics": INTRINSICS | {"fx": "wide"}}, "finite number"),
        ({"intrinsics": {"width": 120}}, "intrinsics needs"),
        ({"depth_scale": 1000.0}, "metres per unit"),
        ({"depth_scale": 0.0}, "metres per unit"),
        ({"mount": {"height": 600.0, "pitch_deg": 20.0}}, "cannot be"),
        ({"mount": {"pitch": 20.0}}, "mount needs"),
        ({"pose": []}, "unknown keys pose"),
        ({"poses": "nowhere.txt"}, "nowhere.txt"),
        ({"poses": [[0.0, 0.0]]}, "rows of 3 numbers"),
        ({"depth": "nowhere"}, "no depth images"),
    ],
)
def test_a_yaml_that_cannot_be_is_explained(tmp_path, content, sentence):
    folder = write_yaml_recording(tmp_path, **content)
    report = validate_recording(folder)
    assert not report.is_usable and sentence in (report.fatal or "")
    with pytest.raises(InputError, match="cannot be used"):
        load_recording(folder)


def test_broken_yaml_is_explained(tmp_path):
    folder = write_yaml_recording(tmp_path)
    (folder / "recording.yaml").write_text("intrinsics: {width: 120,\n")
    assert "not valid YAML" in (validate_recording(folder).fatal or "")


def test_pose_count_mismatch_and_a_pose_that_is_not_finite(tmp_path):
    report = validate_recording(write_yaml_recording(tmp_path, poses=[[0.0, 0.0, 0.0], [float("nan"), 0.0, 0.0]]))
    assert report.usable == ("depth/000000.png",)
    assert any("2 poses for 3 images" in p.problem for p in report.problems)
    assert {p.file for p in report.problems} == {"recording.yaml", "depth/000001.png", "depth/000002.png"}


def test_tum_listing_and_missing_file(tmp_path):
    folder = write_tum_recording(tmp_path, [])
    (folder / "groundtruth.txt").unlink()
    (folder / "depth" / "100.100000.png").unlink()
    report = validate_recording(folder, intrinsics=Intrinsics(**INTRINSICS))
    assert len(report.usable) == 2
    assert {p.file: p.problem for p in report.problems}["depth/100.100000.png"] == "is missing."
    assert any("lists 3 images but the folder holds 2" in p.problem for p in report.problems)


def test_tum_without_any_usable_pose_keeps_its_frames(tmp_path):
    report = validate_recording(write_tum_recording(tmp_path, []), intrinsics=Intrinsics(**INTRINSICS))
    assert len(report.usable) == 3
    assert any(p.file == "poses" for p in report.problems)


def test_iplanner_extrinsics_of_the_housing_are_refused(tmp_path):
    """An identity rotation is a camera housing (x forward), whose z axis would be an optical axis that looks up."""
    odometry = [[0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]] * 3
    folder = write_iplanner_recording(tmp_path, odometry, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    assert "optical frame" in (validate_recording(folder).fatal or "")
    (folder / "camera_extrinsic.txt").write_text("[0, 0, 0, 0, 0, 0, 0.3]")
    assert "unit quaternion" in (validate_recording(folder).fatal or "")
    (folder / "camera_extrinsic.txt").unlink()
    assert "camera_extrinsic.txt" in (validate_recording(folder).fatal or "")


def test_iplanner_odometry_that_is_not_finite_falls_back_to_fitted_mounts(tmp_path):
    quaternion = [0.5, -0.5, 0.5, -0.5]
    folder = write_iplanner_recording(tmp_path, [[0.0] * 7] * 3, [0.0, 0.0, 0.0, *quaternion])
    recording = load_recording(folder)
    assert recording.poses is None and np.isfinite(recording.mounts).all()
    assert abs(recording.mounts[0, 0] - 0.6) < 0.02


@pytest.mark.parametrize("kind", ["absent", "no images"])
def test_a_folder_that_is_no_recording(tmp_path, kind):
    folder = tmp_path / "absent" if kind == "absent" else tmp_path
    report = validate_recording(folder)
    assert report.layout == "unknown" and not report.is_usable
    assert ("no such folder" if kind == "absent" else "known layouts") in (report.fatal or "")


def test_command_prints_the_report_and_exits_nonzero_when_unusable(tmp_path):
    folder = write_yaml_recording(tmp_path / "some")
    _truncate(folder / "depth" / "000002.png")
    command = [sys.executable, "-m", "experiments.validate_recording"]
    good = subprocess.run([*command, str(folder)], capture_output=True, text=True, timeout=120, check=False)
    assert good.returncode == 0, good.stderr
    assert "2 usable of 3" in good.stdout and "truncated" in good.stdout
    bad = subprocess.run([*command, str(tmp_path)], capture_output=True, text=True, timeout=120, check=False)
    assert bad.returncode == 1 and "unusable" in bad.stdout

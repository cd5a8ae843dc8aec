"""Bags of both versions of ROS: what was written is what is read, and what is wrong with one is said."""

import builtins
import shutil
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from iwalker_jax.data import load_recording, validate_recording
from iwalker_jax.data.recordings.bag.calibration import calibration_of
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics
from iwalker_jax.perception.depth_png import read_png_units
from tests.data.bags import (
    DISTORTION,
    FRAMES,
    KINDS,
    P_BODY_CAMERA,
    POSES,
    BagDraft,
    K,
    floor_depth,
    rays,
    recorded_pixels,
)
from tests.data.recording_folders import CAMERA_HEIGHT, HEIGHT, INTRINSICS, PITCH, WIDTH


def stored(recording, row: int) -> np.ndarray:
    """[m] an unpacked image, before it is re-projected."""
    return read_png_units(recording.metadata.images[row], (WIDTH, HEIGHT)) * recording.metadata.depth_scale


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("compressed", [False, True], ids=["plain", "compressedDepth"])
@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_depth_without_distortion_is_what_was_written(tmp_path, kind, compressed, encoding):
    """Oracle: the images that the test wrote; half a unit of rounding, in packed inverse depth one more of its own."""
    draft = BagDraft(encoding, compressed, distortion=None)
    recording = load_recording(draft.write(tmp_path / "walk", kind))
    assert len(recording) == FRAMES
    for row, depth in enumerate(draft.images()):
        # One unit of inverse depth a / depth + b is depth^2 / a metres, a = 10100.
        quantum = 0.0005 + (depth**2 / 10100.0 if compressed and encoding == "32FC1" else 0.0)
        assert (np.abs(stored(recording, row) - depth) <= 1.01 * quantum).all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_of_a_distorting_camera_is_a_recording(tmp_path, kind):
    """Oracle: the floor seen by a pinhole camera, from images rendered through OpenCV's lens; the poses written."""
    recording = load_recording(BagDraft(compressed=True).write(tmp_path / "walk", kind))
    assert recording.report.layout == "bag" and not recording.report.problems
    assert recording.metadata.intrinsics == Intrinsics(**INTRINSICS)
    np.testing.assert_allclose(recording.poses, POSES, atol=1e-5)
    expected = [CAMERA_HEIGHT, PITCH, 0.0, *P_BODY_CAMERA[:2]]
    np.testing.assert_allclose(recording.mounts, np.tile(expected, (FRAMES, 1)), atol=0.01)
    depth = stored(recording, 0)
    seen = depth > 0
    assert seen.mean() > 0.9
    x, y = rays()
    # The nearest recorded pixel lies within half a pixel aside, at depths as from a little more than that.
    shifted = [floor_depth(x + dx / K[0, 0], y + dy / K[1, 1]) for dx in (-0.75, 0.75) for dy in (-0.75, 0.75)]
    low, high = np.min(shifted, axis=0) - 0.001, np.max(shifted, axis=0) + 0.001
    assert ((low <= depth) & (depth <= high))[seen].all()
    distorted = floor_depth(*rays(DISTORTION))
    assert ((distorted < low) | (distorted > high)).mean() > 0.2, "the lens must matter for this to be a test"


def test_undistorted_pixels_are_recorded_ones(tmp_path):
    """Oracle: cv2.projectPoints says where the lens puts each ray; no depth is new, though objects have edges."""
    rng = np.random.default_rng(0)
    images = [np.where(floor_depth(*rays()) < 1.5, floor_depth(*rays()), rng.choice([2.0, 4.0], (HEIGHT, WIDTH)))]
    recording = load_recording(BagDraft(depth=images * FRAMES, odometry=False).write(tmp_path / "walk"))
    x, y = rays()
    at = recorded_pixels(np.column_stack([x.ravel(), y.ravel()]), DISTORTION).reshape(HEIGHT, WIDTH, 2)
    inside = ((at > -0.45) & (at < [WIDTH - 0.55, HEIGHT - 0.55])).all(axis=-1)
    clear = inside & (np.abs(at % 1.0 - 0.5) > 0.05).all(axis=-1)  # OpenCV finds pixels to 1/32
    columns, rows = np.round(at[clear]).astype(int).T
    depth = stored(recording, 0)
    np.testing.assert_allclose(depth[clear], images[0][rows, columns], atol=0.00051)
    assert set(np.unique(depth)) <= {0.0} | set(np.round(images[0] * 1000).astype(np.uint16).ravel() * 0.001)


@pytest.mark.parametrize(
    "model, D", [("rational_polynomial", [0.1, 0.02, 0, 0, 0, 0.2, 0, 0]), ("equidistant", [0.05, 0.01, 0, 0])]
)
def test_other_lenses(model, D):
    """Oracle: OpenCV's own projection of a ray, by the model's function."""
    matrix, region = K, SimpleNamespace(width=0, height=0, x_offset=0, y_offset=0)
    info = SimpleNamespace(
        width=WIDTH, height=HEIGHT, k=matrix.ravel(), d=np.array(D), p=np.zeros(12), distortion_model=model,
        binning_x=0, binning_y=0, roi=region,
    )  # fmt: skip
    columns, rows = calibration_of(info, "/camera_info", rectified=False).source
    ray = np.array([[[0.4, -0.3, 1.0]]])
    project = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
    given = (np.zeros(3), np.zeros(3), matrix, np.array(D, float))
    u, v = project(ray, *given)[0].ravel()
    pixel = matrix @ ray.ravel()
    at = (round(pixel[1]), round(pixel[0]))
    # The pinhole pixel of this ray is (83.5, 26.5); its neighbours' sources lie within a pixel or so.
    assert abs(columns[at] - u) < 1.0 and abs(rows[at] - v) < 1.0


def test_rectified_images_take_the_projection_matrix(tmp_path):
    """Property: by ROS' convention K and D belong to image_raw, P to image_rect."""
    matrix = np.array([[66.0, 0.0, 58.0, 0.0], [0.0, 66.0, 44.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    draft = BagDraft(name="/camera/depth/image_rect", changes={"p": matrix.ravel()}, odometry=False)
    report = validate_recording(draft.write(tmp_path / "walk"))
    assert report.intrinsics == Intrinsics(WIDTH, HEIGHT, 66.0, 66.0, 58.0, 44.0)
    assert any("rectified" in sentence for sentence in report.assumptions)


def test_without_odometry_poses_are_those_of_tf(tmp_path):
    recording = load_recording(BagDraft(odometry=False, tf=True).write(tmp_path / "walk", "ros1"))
    np.testing.assert_allclose(recording.poses, POSES, atol=1e-5)
    assert any("base_link in odom by tf" in sentence for sentence in recording.report.assumptions)


def test_without_the_cameras_frame_it_looks_ahead_and_its_mount_is_fitted(tmp_path):
    recording = load_recording(BagDraft(camera_frame=False).write(tmp_path / "walk"))
    np.testing.assert_allclose(recording.poses, POSES, atol=1e-5)
    np.testing.assert_allclose(recording.mounts[0], [CAMERA_HEIGHT, PITCH, 0.0, 0.0, 0.0], atol=0.02)
    assert any("look where the body faces" in sentence for sentence in recording.report.assumptions)


def test_without_poses_it_is_a_recording_without_poses(tmp_path):
    recording = load_recording(BagDraft(odometry=False).write(tmp_path / "walk"))
    assert recording.poses is None and len(recording) == FRAMES


def test_intrinsics_given_win_over_the_bags(tmp_path):
    place = BagDraft(info=False, distortion=None).write(tmp_path / "walk")
    assert "no calibration (expected on /camera/depth/camera_info)" in (validate_recording(place).fatal or "")
    assert load_recording(place, Intrinsics(**INTRINSICS)).metadata.intrinsics == Intrinsics(**INTRINSICS)


def test_a_topic_can_be_chosen_and_every_topic_is_listed(tmp_path):
    place = BagDraft(compressed=True).write(tmp_path / "walk")
    topics = {topic.name: topic for topic in validate_recording(place).topics}
    depth = "/camera/depth/image_raw/compressedDepth"
    assert topics[depth].use == "depth (16UC1): the only depth topic" and topics[depth].messages == FRAMES
    assert topics["/odom"].use == "poses of the body" and topics["/camera/depth/camera_info"].use.startswith("calib")
    assert "chosen by you" in {t.name: t.use for t in validate_recording(place, topic=depth).topics}[depth]
    refused = validate_recording(place, topic="/camera/color/image_raw")
    assert "no depth topic '/camera/color/image_raw'; its depth topics: " + depth in (refused.fatal or "")


def test_unpacked_images_go_with_the_recording(tmp_path):
    recording = load_recording(BagDraft(odometry=False).write(tmp_path / "walk"))
    folder = recording.metadata.folder
    assert folder.is_dir() and recording.depth_frames().shape == (FRAMES, 90, 160)
    recording.metadata.scratch.cleanup()
    assert not folder.exists()


@pytest.mark.parametrize(
    "draft, words",
    [
        (BagDraft(encoding="mono8"), "no topic with depth images"),
        (BagDraft(model="thin_prism"), "distortion model 'thin_prism' with 5 coefficients; known are plumb_bob"),
        (BagDraft(changes={"k": np.zeros(9)}), "holds no focal length"),
        (BagDraft(changes={"width": 64}), "is for 64 x 90 px, but the images"),
        (BagDraft(changes={"binning_x": 2}), "binned or cut out"),
        (BagDraft(depth=[]), "no topic with depth images"),
    ],
)
def test_a_bag_that_cannot_be_used_says_why(tmp_path, draft, words):
    report = validate_recording(draft.write(tmp_path / "walk"))
    assert not report.is_usable and words in (report.fatal or "")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("damage", ["truncated", "empty", "none"])
def test_a_damaged_bag_is_one_sentence(tmp_path, kind, damage):
    place = BagDraft().write(tmp_path / "walk", kind)
    file = place if place.is_file() else next(f for f in place.iterdir() if f.suffix in (".db3", ".mcap"))
    content = file.read_bytes()
    file.write_bytes({"truncated": content[: len(content) // 2], "empty": b"", "none": b"not a bag " * 99}[damage])
    fatal = validate_recording(place).fatal or ""
    assert "cannot be read as a bag" in fatal and "record it again" in fatal


def test_images_that_are_damaged_are_left_out_and_named(tmp_path):
    """Property: the third image is cut by the test, in its message of a bag that is otherwise whole."""
    images = BagDraft().images()
    images[2] = images[2][:50]
    report = validate_recording(BagDraft(depth=images).write(tmp_path / "walk"))
    assert len(report.usable) == FRAMES - 1
    assert [(p.file, p.problem) for p in report.problems] == [
        ("000002.png", "is 120 x 50 px but the intrinsics are for 120 x 90 px.")
    ]


def test_without_the_extra_its_name_is_said(tmp_path, monkeypatch):
    place = BagDraft().write(tmp_path / "walk")
    real = builtins.__import__

    def absent(name, *rest):
        if name.startswith("rosbags"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", absent)
    assert "pip install 'iwalker-jax[ros]'" in (validate_recording(place).fatal or "")


def test_a_topic_of_a_folder_is_refused(tmp_path):
    (tmp_path / "recording.yaml").write_text("{}")
    assert "no bag" in (validate_recording(tmp_path, topic="/depth").fatal or "")


def test_a_bag_that_is_gone(tmp_path):
    place = BagDraft().write(tmp_path / "walk")
    shutil.rmtree(place)
    with pytest.raises(InputError, match="no such folder, and no bag"):
        load_recording(place)


def test_drafts_are_what_they_say():
    """The writer itself: a lens without distortion sees as a pinhole camera does."""
    np.testing.assert_allclose(rays(np.zeros(5)), rays(), atol=1e-9)
    assert replace(BagDraft(), distortion=None).images()[0].shape == (HEIGHT, WIDTH)

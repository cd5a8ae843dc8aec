"""Folders of .npy frames: equal to the same frames as PNG, and every damage is named with its file."""

import io
from pathlib import Path

import numpy as np
import pytest
import yaml

from iwalker_jax.data.from_recording import frames_from_recording
from iwalker_jax.data.recordings import load_recording, validate_recording
from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import Intrinsics
from tests.data.recording_folders import HEIGHT, INTRINSICS, WIDTH, floor_image, write_yaml_recording

NEAR = 0.9005  # [m], no millimetre
POSES = [[0.0, 0.0, 0.0], [0.5, 0.1, 0.2], [1.0, 0.3, 0.4]]


def metres(k: int) -> np.ndarray:
    return floor_image(1000.0, 0.01 * k) / 1000.0


def saved(array: np.ndarray, **options) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, **options)
    return stream.getvalue()


def write_numpy_recording(folder: Path, frames: list[bytes], **content) -> Path:
    (folder / "depth").mkdir(parents=True)
    for number, frame in enumerate(frames):
        (folder / "depth" / f"{number:06d}.npy").write_bytes(frame)
    (folder / "recording.yaml").write_text(yaml.safe_dump({"intrinsics": INTRINSICS} | content))
    return folder


@pytest.mark.parametrize(
    "stored",
    [
        lambda depth: depth.astype(np.float32),
        lambda depth: depth.astype(">f8"),
        lambda depth: np.asfortranarray(depth),
        lambda depth: np.where(depth < NEAR, np.nan, depth),
    ],
    ids=["float32", "big-endian", "by columns", "NaN"],
)
def test_frames_in_metres_are_the_same_recording_as_images(stored, tmp_path):
    """Oracle: the same floor as 16-bit PNG in millimetres, without what is near where the frames are NaN."""
    frames = [stored(metres(k)) for k in range(3)]
    recording = load_recording(write_numpy_recording(tmp_path / "arrays", [saved(f) for f in frames], poses=POSES))
    images = load_recording(write_yaml_recording(tmp_path / "images", poses=POSES))
    seen, wanted = recording.depth_frames(), images.depth_frames()
    if np.isnan(frames[0]).any():
        wanted = np.where(wanted < NEAR, 0.0, wanted)
    np.testing.assert_array_equal(seen, wanted)
    np.testing.assert_array_equal(recording.poses, images.poses)
    assert recording.report.usable == tuple(f"depth/{k:06d}.npy" for k in range(3))
    assert any("metres" in text for text in recording.report.assumptions)


def test_they_train_and_need_no_description_where_the_camera_is_given(tmp_path):
    for number in range(3):
        np.save(tmp_path / f"{number}.npy", metres(number))
    camera = Intrinsics(**INTRINSICS)
    assert len(load_recording(tmp_path, camera)) == 3
    (tmp_path / "recording.yaml").write_text(yaml.safe_dump({"intrinsics": INTRINSICS}))
    frames = frames_from_recording(tmp_path, seed=0, say=lambda sentence: None, camera=Intrinsics())
    assert len(frames) == 3 and (frames.depth > 0).any()


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (b"", "no .npy file"),
        (b"hello", "no .npy file"),
        (saved(metres(1))[:-8], "truncated"),
        (saved(metres(1)) + b"12345678", "longer than its image"),
        (saved(metres(1)).replace(b"(90, 120)", b"(90, 1e9)"), "no .npy file"),
        (saved(metres(1)).replace(b"(90, 120)", b"(9 * 10,)"), "no .npy file"),
        (saved(metres(1)).replace(b"(90, 120)", b"(9999999)"), "no .npy file"),
        (saved(metres(1).T), f"has the shape ({WIDTH}, {HEIGHT})"),
        (saved(np.stack([metres(1)] * 2)), "has the shape (2, 90, 120)"),
        (saved(floor_image(1000.0)), "holds uint16"),
        (saved(1000.0 * metres(1)), "in millimetres"),
        (saved(np.zeros((HEIGHT, WIDTH))), "no return in any pixel"),
        (saved(np.full((HEIGHT, WIDTH), np.nan)), "no return in any pixel"),
        (saved(np.array([{"a": 1}], object), allow_pickle=True), "holds object"),
    ],
)
def test_a_bad_frame_is_left_out_and_named(frame, words, tmp_path):
    folder = write_numpy_recording(tmp_path / "walk", [saved(metres(0)), frame, saved(metres(2))])
    report = validate_recording(folder)
    assert report.usable == ("depth/000000.npy", "depth/000002.npy")
    (problem,) = report.problems
    assert problem.file == "depth/000001.npy" and words in problem.problem


def test_another_scale_than_metres_is_refused(tmp_path):
    folder = write_numpy_recording(tmp_path / "walk", [saved(metres(0))], depth_scale=0.001)
    with pytest.raises(InputError, match=r"is in metres, but depth_scale is 0\.001; save metres and leave it out"):
        load_recording(folder)
    assert len(load_recording(write_numpy_recording(tmp_path / "other", [saved(metres(0))], depth_scale=1))) == 1


def test_images_go_before_arrays(tmp_path):
    folder = write_yaml_recording(tmp_path / "walk")
    np.save(folder / "depth" / "000003.npy", metres(3))
    assert len(load_recording(folder)) == 3

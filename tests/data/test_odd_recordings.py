"""What may go wrong with a recording: found, named, and never taken for right."""

import numpy as np
import pytest

from iwalker_jax.data.recordings import depth_images, validate_recording
from iwalker_jax.data.recordings.plain_yaml import parse_plain_yaml
from iwalker_jax.errors import InputError
from tests.malformed.drafts import FLOORS, MOUNT, image_name, png, yaml_draft


@pytest.mark.parametrize("scale", [0.0002, 0.00025, 0.0001, 0.01])
@pytest.mark.parametrize("mount", [False, True])
def test_the_right_depth_scale_is_named(tmp_path, scale, mount):
    """Oracle: the scale by which the images were made."""
    draft = yaml_draft(np.random.default_rng(0), mount=mount)
    units = [np.round(image * (0.001 / scale)).astype(np.uint16) for image in FLOORS]
    draft.files = {image_name(k): png(unit) for k, unit in enumerate(units)}
    fatal = validate_recording(draft.write(tmp_path / "wrong")).fatal or ""
    assert f"depth scale seems to be {scale:g} m per unit, not 0.001" in fatal
    draft.content["depth_scale"] = scale
    assert validate_recording(draft.write(tmp_path / "right")).is_usable


@pytest.mark.parametrize(
    "turn, words", [(1, "90 degrees clockwise"), (2, "upside down"), (3, "90 degrees anticlockwise")]
)
def test_the_turn_that_shows_the_floor_is_named(tmp_path, turn, words):
    """Oracle: NumPy's quarter turns of the images, which the named turn undoes."""
    draft = yaml_draft(np.random.default_rng(0), mount=turn == 2)
    K = draft.content["intrinsics"]
    if turn != 2:
        draft.content["intrinsics"] = K | {"width": K["height"], "height": K["width"], "cx": K["cy"], "cy": K["cx"]}
    draft.files = {image_name(k): png(np.rot90(image, turn)) for k, image in enumerate(FLOORS)}
    fatal = validate_recording(draft.write(tmp_path / "turned")).fatal or ""
    assert "found in 0 of 5 frames" in fatal and words in fatal


def test_what_is_wrong_with_each_file_is_said_when_nothing_is_left(tmp_path):
    """Oracle: the test cuts every image."""
    draft = yaml_draft(np.random.default_rng(0), mount=True)
    draft.files = dict.fromkeys(draft.files, png(FLOORS[0])[:-50])
    report = validate_recording(draft.write(tmp_path / "cut"))
    assert not report.is_usable and report.found == 5
    assert [problem.file for problem in report.problems] == [image_name(k) for k in range(5)]


@pytest.mark.parametrize("key, value", [("height", 0.75), ("pitch_deg", 31.0), ("pitch_deg", 0.35), ("roll_deg", -6.0)])
def test_a_written_mount_that_the_floor_contradicts_is_refused(tmp_path, key, value):
    """Oracle: the mount from which the images were computed."""
    draft = yaml_draft(np.random.default_rng(0), mount=True)
    assert validate_recording(draft.write(tmp_path / "right")).is_usable
    draft.content["mount"] = MOUNT | {key: value}
    report = validate_recording(draft.write(tmp_path / "wrong"))
    assert "recording.yaml says" in (report.fatal or "") and "height of 0.6" in report.fatal


@pytest.mark.parametrize(
    "names",
    [
        ["depth_0.png", "depth_2.png", "depth_10.png", "depth_11.PNG"],
        ["9.png", "10.png", "100.png"],
        ["1_a.png", "2_a.png", "10_a.png"],
        ["99.95.png", "100.05.png", "100.1.png", "100.25.png"],
        ["-2.png", "-1.5.png", "0.png", "3.png"],
        ["run1_9.png", "run1_10.png", "run2_1.png"],
    ],
)
def test_images_come_in_the_order_of_their_numbers(tmp_path, names):
    """Oracle: the order in which the names stand here."""
    for name in [*reversed(names), "._0.png", ".hidden.png", "notes.txt"]:
        (tmp_path / name).touch()
    assert [path.name for path in depth_images(tmp_path)[0]] == names


def test_names_that_leave_the_order_open_are_said(tmp_path):
    for name in ("1.9.png", "1.10.png"):
        (tmp_path / name).touch()
    assert "1.10.png comes before 1.9.png" in depth_images(tmp_path)[1][0]
    (tmp_path / "01.9.png").touch()
    with pytest.raises(InputError, match="the same number"):
        depth_images(tmp_path)


def test_plain_yaml_is_yaml_1_2():
    """Oracle: the core schema of YAML 1.2."""
    text = "{a: 1e-3, b: 0640, c: 1:30, d: yes, e: .inf, f: ~, g: '1', h: [1, -2.5], i: True, j: 0x1F}"
    assert parse_plain_yaml(text) == {
        "a": 0.001,
        "b": 640,
        "c": "1:30",
        "d": "yes",
        "e": float("inf"),
        "f": None,
        "g": "1",
        "h": [1, -2.5],
        "i": True,
        "j": "0x1F",
    }

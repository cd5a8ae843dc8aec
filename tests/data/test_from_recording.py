"""Frames of a user's recording: goals on ground that the frame shows, the recording's end, and what is left out."""

import cv2
import numpy as np
import pytest

from iwalker_jax.data.frame_set import FrameSet
from iwalker_jax.data.from_recording import frames_from_recording
from iwalker_jax.errors import InputError
from tests.data.recording_folders import (
    CAMERA_HEIGHT,
    FOCAL,
    HEIGHT,
    PITCH,
    ROLL,
    WIDTH,
    floor_image,
    write_yaml_recording,
)

POSES = [[0.0, 0.0, 0.0], [0.5, 0.1, 0.3], [1.0, 0.2, np.pi / 2]]


def blocked_image() -> np.ndarray:
    """A wall half a metre ahead, grooved so that it does not look like a stuck sensor."""
    wall = np.full((HEIGHT, WIDTH), 500, np.uint16)
    wall[:, ::8] += 12
    return np.minimum(wall, np.maximum(floor_image(1000.0), 1))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> tuple[FrameSet, list[str]]:
    said: list[str] = []
    folder = write_yaml_recording(tmp_path_factory.mktemp("walk"), poses=POSES)
    return frames_from_recording(folder, goals_per_frame=40, say=said.append), said


def test_goals_lie_on_floor_that_the_frame_shows(recorded):
    """Oracle: the pinhole view of the floor before a wall 4 m along the optical axis, by trigonometry."""
    frames, _ = recorded
    goals = frames.goals[:, 1:].reshape(-1, 2).astype(np.float64)
    distance = np.linalg.norm(goals, axis=1)
    assert distance.min() >= 0.6 and distance.max() <= 6.0
    # Column of a floor point in a camera pitched and rolled about its optical axis.
    along = goals[:, 0] * np.cos(PITCH) + CAMERA_HEIGHT * np.sin(PITCH)
    right, down = -goals[:, 1], CAMERA_HEIGHT * np.cos(PITCH) - goals[:, 0] * np.sin(PITCH)
    column = (right * np.cos(ROLL) + down * np.sin(ROLL)) / along * FOCAL
    assert (np.abs(column) < WIDTH / 2 + 3).all()
    assert along.max() < 4.0
    assert len(np.unique(goals, axis=0)) > 30
    assert distance.min() < 1.5 and distance.max() > 2.0


def test_with_poses_the_first_goal_is_the_recordings_end(recorded):
    """Oracle: complex numbers turn the last position into each frame."""
    frames, _ = recorded
    place = np.array([complex(x, y) for x, y, _ in POSES])
    local = (place[-1] - place) * np.exp(-1j * np.array([yaw for _, _, yaw in POSES]))
    np.testing.assert_allclose(frames.goals[:, 0], np.stack([local.real, local.imag], axis=1), atol=1e-5)
    np.testing.assert_allclose(frames.poses, POSES, atol=1e-6)


def test_assumptions_are_said_and_images_kept(recorded):
    frames, said = recorded
    assert any("mount" in sentence for sentence in said)
    assert frames.depth.shape == (3, 90, 160)
    np.testing.assert_allclose(frames.mounts[:, 0], CAMERA_HEIGHT, atol=0.02)
    # The floor at the lower right corner of the 160 x 90 px image with 80 px of focal length.
    normal = [np.cos(PITCH) * np.sin(ROLL), np.cos(PITCH) * np.cos(ROLL), np.sin(PITCH)]
    nearest = CAMERA_HEIGHT / np.dot(normal, [79.5 / 80, 44.5 / 80, 1.0])
    assert frames.depth[frames.depth > 0].min() / 1000.0 == pytest.approx(nearest, abs=0.01)


def test_without_poses_every_goal_is_sampled_and_seeds_decide(tmp_path):
    folder = write_yaml_recording(tmp_path, count=2)
    one, same, other = (frames_from_recording(folder, seed=seed, say=lambda _: None) for seed in (0, 0, 1))
    assert one.goals.shape == (2, 6, 2)
    assert np.isnan(one.poses).all()
    np.testing.assert_array_equal(one.goals, same.goals)
    assert (one.goals != other.goals).any()
    assert (np.linalg.norm(one.goals, axis=-1) > 0.6).all()


def test_frames_without_free_ground_are_left_out_and_counted(tmp_path):
    folder = write_yaml_recording(tmp_path, poses=POSES)
    assert cv2.imwrite(str(folder / "depth" / "000001.png"), blocked_image())
    said = []
    frames = frames_from_recording(folder, say=said.append)
    assert "1 of 3 frames show no free ground ahead and were left out." in said
    np.testing.assert_allclose(frames.poses, np.array(POSES)[[0, 2]], atol=1e-6)


def test_a_recording_without_any_free_ground_is_one_sentence(tmp_path):
    folder = write_yaml_recording(tmp_path, count=1, mount={"height": 0.6, "pitch_deg": 20.0})
    assert cv2.imwrite(str(folder / "depth" / "000000.png"), blocked_image())
    with pytest.raises(InputError, match="shows free ground") as caught:
        frames_from_recording(folder, say=lambda _: None)
    assert "validate_recording" in str(caught.value)


def test_a_damaged_image_is_said_and_the_rest_is_used(tmp_path):
    folder = write_yaml_recording(tmp_path, count=2)
    image = folder / "depth" / "000000.png"
    image.write_bytes(image.read_bytes()[:-300])
    said = []
    assert len(frames_from_recording(folder, say=said.append)) == 1
    assert any("000000.png" in sentence and "truncated" in sentence for sentence in said)

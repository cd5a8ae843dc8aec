"""The frame cache: used when whole, made anew when not, and done without when it cannot be written."""

import dataclasses

import numpy as np
import pytest

from iwalker_jax.data import sources
from iwalker_jax.data.frame_set import FrameSet, save_frames
from iwalker_jax.data.sources import DataConfig, cache_file, load_training_frames
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics
from iwalker_jax.runtime.config_dict import config_from_dict

SOURCE, CAMERA = DataConfig(frames=3, seed=7), Intrinsics(6, 4, 3.0, 3.5, 2.5, 1.5)


@pytest.fixture
def generated(monkeypatch):
    """Replaces the generator by a quick one; returns the list of its calls."""
    calls = []

    def generate(count, seed, intrinsics, on_progress):
        calls.append((count, seed))
        on_progress(count)
        depth = np.random.default_rng([seed, len(calls)]).integers(0, 9000, (count, 4, 6)).astype(np.uint16)
        zeros = np.zeros((count, 5), np.float32)
        return FrameSet(
            depth,
            zeros,
            np.zeros((count, 2, 2), np.float32),
            zeros[:, :3],
            np.zeros(count, np.int32),
            ("one",),
            intrinsics,
        )

    monkeypatch.setattr(sources, "generate_training_frames", generate)
    return calls


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("IWALKER_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_the_second_time_comes_from_the_cache(generated, cache):
    heard, said = [], []
    first = load_training_frames(SOURCE, CAMERA, lambda done, total: heard.append((done, total)), said.append)
    second = load_training_frames(SOURCE, CAMERA, say=said.append)
    assert generated == [(3, 7)]
    assert heard == [(3, 3)]
    assert said == []
    np.testing.assert_array_equal(first.depth, second.depth)
    assert cache in cache_file(SOURCE, CAMERA).parents


def test_another_recipe_is_another_file(generated, cache):
    others = {
        cache_file(source, CAMERA) for source in (SOURCE, DataConfig(frames=4, seed=7), DataConfig(frames=3, seed=8))
    }
    assert len(others | {cache_file(SOURCE, Intrinsics())}) == 4
    load_training_frames(SOURCE, CAMERA)
    load_training_frames(DataConfig(frames=3, seed=8), CAMERA)
    assert generated == [(3, 7), (3, 8)]


def test_another_generator_makes_the_frames_anew(generated, cache, monkeypatch):
    load_training_frames(SOURCE, CAMERA)
    monkeypatch.setattr(sources, "GENERATOR", sources.GENERATOR + 1)
    load_training_frames(SOURCE, CAMERA)
    assert len(generated) == 2


@pytest.mark.parametrize("damage", ["truncated", "no checksum"])
def test_a_damaged_cache_is_said_and_made_anew(generated, cache, damage):
    load_training_frames(SOURCE, CAMERA)
    file = cache_file(SOURCE, CAMERA)
    if damage == "truncated":
        file.write_bytes(file.read_bytes()[:-10])
    else:
        with np.load(file) as stored:
            np.savez(file, **{name: stored[name] for name in stored.files if name != "sha256"})
    said = []
    again = load_training_frames(SOURCE, CAMERA, say=said.append)
    assert len(generated) == 2
    assert len(said) == 1
    assert file.stem in said[0]
    assert "anew" in said[0]
    assert "\n" not in said[0]
    np.testing.assert_array_equal(load_training_frames(SOURCE, CAMERA, say=said.append).depth, again.depth)
    assert len(generated) == 2


def test_an_unwritable_cache_is_said_and_done_without(generated, tmp_path, monkeypatch):
    """The cache folder's name is taken by a file, which stops every user, even an administrator, from writing."""
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("IWALKER_CACHE", str(tmp_path / "file"))
    said = []
    assert len(load_training_frames(SOURCE, CAMERA, say=said.append)) == 3
    assert len(said) == 1
    assert "Cannot write" in said[0]
    assert "without the cache" in said[0]


def test_a_recording_is_read_and_never_cached(generated, cache, tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        load_training_frames(DataConfig(folder=tmp_path / "absent"), CAMERA)
    assert generated == []
    assert not cache.exists()


def test_a_configuration_that_named_the_file_of_episodes_otherwise_is_refused_with_a_sentence():
    """Configurations of earlier versions called it `walks`."""
    with pytest.raises(InputError, match=r"^DataConfig has no field walks; .* another version of iwalker_jax\.$"):
        config_from_dict(DataConfig, {"folder": None, "frames": 3, "seed": 7, "walks": "runs/walks.npz"})


def test_frames_are_made_through_the_wanted_camera(generated, cache):
    assert load_training_frames(SOURCE, CAMERA).camera == CAMERA
    wider = dataclasses.replace(CAMERA, fx=2.0)
    assert load_training_frames(SOURCE, wider).camera == wider
    assert len(generated) == 2


def test_episodes_seen_through_another_camera_are_refused(generated, cache, tmp_path):
    save_frames(load_training_frames(SOURCE, dataclasses.replace(CAMERA, fx=2.0)), tmp_path / "episodes.npz")
    source = dataclasses.replace(SOURCE, episodes=tmp_path / "episodes.npz")
    with pytest.raises(InputError, match="cannot be trained on together"):
        load_training_frames(source, CAMERA)


def test_frames_of_episodes_that_cannot_be_read_are_refused_before_others_are_made(tmp_path):
    """Property: a sentence, and no progress of frames that would be thrown away."""
    (tmp_path / "episodes.npz").write_bytes(b"no frames")
    source = DataConfig(frames=100_000, episodes=tmp_path / "episodes.npz")
    with pytest.raises(InputError, match=r"episodes\.npz"):
        load_training_frames(source, Intrinsics(), lambda done, total: pytest.fail("frames are made"))

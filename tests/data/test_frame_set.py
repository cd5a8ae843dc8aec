"""Frame sets: checks on construction, exact round trip, and one sentence for every way a file can be bad."""

import dataclasses
import errno
from pathlib import Path

import numpy as np
import pytest

from iwalker_jax.data.frame_set import (
    FrameSet,
    concatenate,
    depth_to_millimetres,
    load_frames,
    save_frames,
)
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics
from iwalker_jax.runtime.files import write_npz

CAMERA = Intrinsics(6, 4, 3.0, 3.5, 2.5, 1.5)
FIELDS = ("depth", "mounts", "goals", "poses", "scene_index")


def make_frames(**changes) -> FrameSet:
    rng = np.random.default_rng(3)
    fields = {
        "depth": rng.integers(0, 9000, (5, 4, 6)).astype(np.uint16),
        "mounts": rng.normal(size=(5, 5)).astype(np.float32),
        "goals": rng.normal(size=(5, 3, 2)).astype(np.float32),
        "poses": np.full((5, 3), np.nan, np.float32),
        "scene_index": np.array([0, 0, 1, 1, 1], np.int32),
        "scene_names": ("kitchen-1", 'a "quoted" name, with comma'),
        "camera": CAMERA,
    }
    return FrameSet(**(fields | changes))


@pytest.fixture
def saved(tmp_path):
    file = tmp_path / "deep" / "frames.npz"
    save_frames(make_frames(), file)
    return file


def test_frame_sets_are_put_together_in_order():
    """Oracle: by hand; rows one after the other, scenes numbered on."""
    first, second = make_frames(), make_frames(scene_index=np.zeros(5, np.int32), scene_names=("lobby-3",))
    both = concatenate([first, second, first])
    assert both.scene_names == (*first.scene_names, "lobby-3", *first.scene_names)
    assert both.scene_index.tolist() == [0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 3, 3, 4, 4, 4]
    assert both.scene_index.dtype == np.int32
    for name in ("depth", "mounts", "goals", "poses"):
        np.testing.assert_array_equal(getattr(both, name), np.concatenate([getattr(first, name)] * 3))


def test_frame_sets_of_other_cameras_are_not_put_together():
    with pytest.raises(InputError, match=r"with 3 goals .* frames with 2 goals"):
        concatenate([make_frames(), make_frames(goals=np.zeros((5, 2, 2), np.float32))])
    with pytest.raises(InputError, match=r"fx=3\.0, .* fx=4\.0, .* cannot be trained on together"):
        concatenate([make_frames(), make_frames(camera=dataclasses.replace(CAMERA, fx=4.0))])
    with pytest.raises(InputError, match=r"\(4, 6\) px do not belong to a camera of \(90, 160\) px"):
        make_frames(camera=Intrinsics())
    with pytest.raises(InputError, match="no frames to put together"):
        concatenate([])


def is_one_sentence(text: str) -> bool:
    return "\n" not in text and text.endswith(".")


def test_round_trip_keeps_every_bit(saved):
    frames, loaded = make_frames(), load_frames(saved)
    for name in FIELDS:
        before, after = getattr(frames, name), getattr(loaded, name)
        assert before.dtype == after.dtype
        np.testing.assert_array_equal(before, after)
    assert loaded.scene_names == frames.scene_names
    assert sorted(path.name for path in saved.parent.iterdir()) == ["frames.npz"]


def _truncate(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-40])


def _alter(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(bytes(content))


def _edit(**changes):
    """Other arrays in the file, written by NumPy itself."""

    def edit(file: Path) -> None:
        with np.load(file) as stored:
            arrays = dict(stored) | changes
        np.savez(file, **{name: array for name, array in arrays.items() if array is not None})

    return edit


def _others(**arrays):
    return lambda file: write_npz(file, arrays)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (_truncate, "damaged"),
        (_alter, "damaged"),
        (lambda file: file.write_bytes(b""), "damaged"),
        (_edit(mounts=np.zeros((5, 5), np.float32)), "checksum"),
        (_edit(sha256=np.array("0" * 64)), "checksum"),
        (_edit(sha256=None), "no checksum"),
        (_edit(depth=np.array([None])), "damaged"),
        (lambda file: file.unlink(), "No such file"),
        (lambda file: file.write_bytes(b"these are no frames"), "damaged, or no .npz file"),
        (_others(depth=np.zeros((1, 2, 2), np.uint16)), "not a frame set"),
        (_others(**{name: np.zeros(3) for name in FIELDS}, scene_names='["a"]', camera="{}"), "not a frame set"),
        (_others(**{name: np.zeros(3) for name in FIELDS}, scene_names='["a"]', camera="[]"), "not a frame set"),
    ],
)
def test_a_bad_file_is_one_sentence(saved, damage, words):
    damage(saved)
    with pytest.raises(InputError, match=words) as caught:
        load_frames(saved)
    assert is_one_sentence(str(caught.value))
    assert "make it anew" in str(caught.value)


def test_a_full_disk_is_one_sentence_and_leaves_nothing_behind(tmp_path, monkeypatch):
    def full(self, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError, match="No space left on device") as caught:
        save_frames(make_frames(), tmp_path / "frames.npz")
    assert is_one_sentence(str(caught.value))
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_keeps_the_earlier_file(saved, monkeypatch):
    """The write that fails must not harm the earlier frames."""
    monkeypatch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(OSError(errno.ENOSPC, "No space left")))
    with pytest.raises(InputError, match="No space left"):
        save_frames(make_frames(goals=np.ones((5, 3, 2), np.float32)), saved)
    np.testing.assert_array_equal(load_frames(saved).goals, make_frames().goals)


def test_a_folder_that_cannot_be_made_is_one_sentence(tmp_path):
    (tmp_path / "taken").write_text("a file where a folder should be")
    with pytest.raises(InputError, match="Cannot write") as caught:
        save_frames(make_frames(), tmp_path / "taken" / "deeper" / "frames.npz")
    assert is_one_sentence(str(caught.value))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"depth": np.zeros((0, 4, 6), np.uint16)}, "at least one frame"),
        ({"depth": np.zeros((5, 4, 6), np.float32)}, "uint16"),
        ({"depth": np.zeros((5, 4), np.uint16)}, "uint16"),
        ({"mounts": np.zeros((4, 5), np.float32)}, "mounts"),
        ({"poses": np.zeros((5, 2), np.float32)}, "poses"),
        ({"goals": np.zeros((5, 2), np.float32)}, "goals"),
        ({"goals": np.zeros((4, 3, 2), np.float32)}, "goals"),
        ({"goals": np.zeros((5, 0, 2), np.float32)}, "goals"),
        ({"scene_index": np.zeros(4, np.int32)}, "scene_index"),
        ({"scene_index": np.full(5, 2, np.int32)}, "scene_index"),
        ({"scene_index": np.full(5, -1, np.int32)}, "scene_index"),
        ({"mounts": np.full((5, 5), np.nan, np.float32)}, "finite"),
        ({"goals": np.full((5, 3, 2), np.inf, np.float32)}, "finite"),
    ],
)
def test_frames_that_cannot_be_are_refused(changes, words):
    with pytest.raises(InputError, match=words):
        make_frames(**changes)


def test_millimetres_round_and_drop_what_is_no_depth():
    """Oracle: values worked out by hand."""
    depth = np.array([[0.0, 1.2344, 1.2346, 64.9], [np.nan, np.inf, -1.0, 65.6]], np.float32)
    millimetres = depth_to_millimetres(depth)
    np.testing.assert_array_equal(millimetres, [[0, 1234, 1235, 64900], [0, 0, 0, 0]])
    assert millimetres.dtype == np.uint16


def test_selected_frames_keep_their_fields_together():
    frames = make_frames()
    chosen = frames.select(np.array([4, 1]))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(chosen, name), getattr(frames, name)[[4, 1]])
    np.testing.assert_allclose(chosen.depth_metres(), frames.depth[[4, 1]] / 1000.0, rtol=1e-6)

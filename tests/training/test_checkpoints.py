"""Checkpoints: complete round trip, and damage, foreign networks and full disks answered in one sentence."""

import errno
import json

import numpy as np
import pytest

from iwalker_jax.errors import CheckpointError, InputError
from iwalker_jax.runtime.config_dict import config_from_dict, config_to_dict
from iwalker_jax.training.checkpoints import CheckpointStore
from iwalker_jax.training.config import PRESETS, TrainConfig
from iwalker_jax.training.train_step import initial_state, make_optimiser
from tests.training.conftest import assert_trees_equal

FLIPS = 100


@pytest.fixture(scope="module")
def state(small_config):
    return initial_state(small_config, make_optimiser(small_config, 6))


@pytest.fixture
def store(tmp_path):
    store = CheckpointStore(tmp_path / "checkpoints", keep=2)
    yield store
    store.close()


def test_round_trip_keeps_every_bit_and_the_configuration(store, state, small_config):
    store.save(state, small_config, frames=8)
    assert_trees_equal(store.restore(0).state, state)
    assert store.restore(0)[1:] == (small_config, 8, {})


def test_old_checkpoints_are_removed(store, state, small_config):
    for step in (1, 2, 3):
        store.save(state._replace(step=state.step + step), small_config, frames=8)
    assert store.steps() == [2, 3]


def test_a_damaged_checkpoint_falls_back_to_the_one_before(store, state, small_config):
    for step in (1, 2):
        store.save(state._replace(step=state.step + step), small_config, frames=8)
    for file in (store.folder / "2" / "state").rglob("*"):
        if file.is_file():
            file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    said = []
    found = store.restore_latest(on_damage=said.append)
    assert found is not None
    assert int(found[0].step) == 1
    assert len(said) == 1
    assert "Checkpoint 2" in said[0]
    assert "cannot be read" in said[0]


def test_only_damaged_checkpoints_raise_one_sentence(store, state, small_config):
    store.save(state, small_config, frames=8)
    for file in (store.folder / "0").rglob("*"):
        if file.is_file():
            file.write_bytes(b"")
    with pytest.raises(CheckpointError, match="cannot be read"):
        store.restore_latest()


def test_flipped_bits_are_noticed_or_harmless(store, state, small_config):
    """Oracle: the state that was saved. Single bits, in files drawn by their size, so most in the leaves."""
    store.save(state, small_config, frames=8)
    files = sorted(file for file in (store.folder / "0").rglob("*") if file.is_file() and file.stat().st_size)
    contents = {file: file.read_bytes() for file in files}
    rng = np.random.default_rng(0)
    noticed = 0
    for number in range(FLIPS):
        # Every fourth in any of the files, however small.
        sizes = np.array([len(contents[file]) if number % 4 else 1.0 for file in files])
        file = files[rng.choice(len(files), p=sizes / sizes.sum())]
        damaged = bytearray(contents[file])
        bit = int(rng.integers(8 * len(damaged)))
        damaged[bit // 8] ^= 1 << (bit % 8)
        file.write_bytes(bytes(damaged))
        try:
            found = store.restore(0)
        except CheckpointError as error:
            assert "\n" not in str(error)
            noticed += 1
        else:
            assert_trees_equal(found.state, state)
            assert found[1:] == (small_config, 8, {})
        file.write_bytes(contents[file])
    assert noticed > FLIPS / 2
    assert_trees_equal(store.restore(0).state, state)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda meta: meta["config"].update(seed=1), "checksum"),
        (lambda meta: meta.update(frames=9), "cannot be read|checksum"),
        (lambda meta: meta["content"].update(depth="0"), "checksum"),
        (lambda meta: meta.pop("checksum"), "cannot be read"),
        (lambda meta: meta["config"].update(batch_size=-1), "batch_size"),
    ],
)
def test_edited_settings_are_noticed(store, state, small_config, edit, words):
    store.save(state, small_config, frames=8)
    (file,) = store.folder.glob("0/meta/metadata")
    meta = json.loads(file.read_text())
    edit(meta)
    file.write_text(json.dumps(meta))
    with pytest.raises(CheckpointError, match=words):
        store.restore(0)


def test_a_half_written_checkpoint_is_not_seen(store, state, small_config):
    """A killed process leaves a temporary folder; the store must not offer it."""
    store.save(state, small_config, frames=8)
    (store.folder / "5.orbax-checkpoint-tmp-123").mkdir()
    reopened = CheckpointStore(store.folder)
    assert reopened.steps() == [0]
    reopened.close()


def test_a_full_disk_is_said_and_loses_nothing(store, state, small_config, monkeypatch):
    store.save(state, small_config, frames=8)

    def full(step, **__):
        (store.folder / f"{step}.orbax-checkpoint-tmp" / "state").mkdir(parents=True)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(store._manager, "save", full)
    with pytest.raises(CheckpointError, match=r"No space left.*\[0\] are intact"):
        store.save(state._replace(step=state.step + 1), small_config, frames=8)
    assert_trees_equal(store.restore(0).state, state)
    assert [entry.name for entry in store.folder.iterdir()] == ["0"]


@pytest.mark.parametrize("preset", PRESETS)
def test_configurations_survive_json(preset):
    config = PRESETS[preset]()
    assert config_from_dict(TrainConfig, config_to_dict(config)) == config


def test_unknown_fields_name_themselves():
    values = config_to_dict(TrainConfig()) | {"colour": "blue"}
    with pytest.raises(InputError, match="colour"):
        config_from_dict(TrainConfig, values)

"""Training: a resumed run equals an uninterrupted one, two devices equal one, broken batches are survived, and the
optimiser with its clipping fused into Adam equals optax's own."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from iwalker_jax.data.sources import DataConfig
from iwalker_jax.errors import CheckpointError, InputError
from iwalker_jax.training import loop
from iwalker_jax.training.batches import frame_order, gather_batch
from iwalker_jax.training.checkpoints import Checkpoint
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.loop import batch_mesh, train
from iwalker_jax.training.resume import differences
from iwalker_jax.training.run_log import MetricsFile, read_metrics
from iwalker_jax.training.train_step import initial_state, make_optimiser, make_train_step
from tests.training.conftest import assert_trees_equal


@pytest.fixture(scope="module")
def uninterrupted(small_config, small_data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("uninterrupted")
    return folder, train(small_config, small_data, folder, say=lambda text: None)


def test_every_epoch_visits_every_frame_once():
    for epoch in range(3):
        seen = np.concatenate([frame_order(0, 12, 4, 3 * epoch + k) for k in range(3)])
        np.testing.assert_array_equal(np.sort(seen), np.arange(12))
    assert len(frame_order(0, 3, 8, 0)) == 8


def test_a_resumed_run_equals_an_uninterrupted_one_bit_for_bit(uninterrupted, small_config, small_data, tmp_path):
    folder, whole = uninterrupted
    train(small_config, small_data, tmp_path, stop_after=3, say=lambda text: None)
    said = []
    resumed = train(small_config, small_data, tmp_path, say=said.append)
    assert any("Resuming at step 3" in sentence for sentence in said)
    assert_trees_equal(whole.state, resumed.state)
    one, other = (read_metrics(path / "metrics.jsonl") for path in (folder, tmp_path))
    assert [line["step"] for line in other] == list(range(len(one)))
    assert [line["total"] for line in one] == [line["total"] for line in other]


def test_losses_are_finite_and_written(uninterrupted):
    folder, result = uninterrupted
    lines = read_metrics(folder / "metrics.jsonl")
    assert len(lines) == 6
    assert all(np.isfinite(list(line.values())).all() for line in lines)
    assert {"U_path", "U_step", "total", "converged", "gradient_norm", "frames_per_second"} <= set(lines[0])
    assert not result.interrupted
    assert result.unsaved is None


def test_ctrl_c_keeps_what_was_done(small_config, small_data, tmp_path):
    def interrupt(progress):
        if progress.step == 3:
            raise KeyboardInterrupt

    result = train(small_config, small_data, tmp_path, on_progress=interrupt, say=lambda text: None)
    assert result.interrupted
    resumed = []
    train(small_config, small_data, tmp_path, stop_after=4, say=resumed.append)
    assert "Resuming at step 3" in resumed[0]


def _near_the_straight_line(state):
    """The state with waypoints drawn close to the straight line: wild paths have several unicycle optima of nearly
    equal cost, between which a rounding error chooses."""
    scaled = jax.tree_util.tree_map_with_path(
        lambda path, x: 0.05 * x if "waypoints" in jax.tree_util.keystr(path) else x, state.params
    )
    return state._replace(params=scaled)


def test_two_devices_equal_one(small_config, small_data):
    """Oracle: the same step on a single device; only the order of the gradient's sums may differ."""
    optimiser = make_optimiser(small_config, 6)
    index = jnp.asarray(frame_order(0, 8, 4, 0))
    (one, report_one), (two, report_two) = (
        make_train_step(small_config, optimiser, mesh)(
            _near_the_straight_line(initial_state(small_config, optimiser)), small_data, index
        )
        for mesh in (None, batch_mesh(2))
    )
    assert float(report_one.converged) == float(report_two.converged) == 1.0
    for name, value in report_one.losses.items():
        assert float(report_two.losses[name]) == pytest.approx(float(value), rel=1e-4, abs=1e-6), name
    assert float(report_two.gradient_norm) == pytest.approx(float(report_one.gradient_norm), rel=1e-4)
    for a, b in zip(jax.tree.leaves(one.params), jax.tree.leaves(two.params), strict=True):
        np.testing.assert_allclose(a, b, atol=2e-5)


def test_uneven_batches_and_missing_devices_are_refused(config_with):
    with pytest.raises(InputError, match="multiple"):
        config = config_with(batch_size=3)
        make_train_step(config, make_optimiser(config, 6), batch_mesh(2))
    with pytest.raises(InputError, match="present"):
        batch_mesh(64)


def test_a_broken_batch_is_skipped_kept_and_said(small_config, small_data, tmp_path):
    """A frame whose distance field is NaN must change neither the parameters nor the optimiser."""
    broken = small_data._replace(esdf=small_data.esdf.at[:].set(jnp.nan))
    said = []
    result = train(small_config, broken, tmp_path, stop_after=2, say=said.append)
    optimiser = make_optimiser(small_config, 6)
    assert_trees_equal(result.state.params, initial_state(small_config, optimiser).params)
    assert "not finite" in said[0]
    with np.load(tmp_path / "broken_batch_000000.npz") as kept:
        np.testing.assert_array_equal(kept["frame_index"], frame_order(0, 8, 4, 0))


def test_a_run_that_only_breaks_gives_up(small_config, small_data, tmp_path, monkeypatch):
    monkeypatch.setattr(loop, "MAX_BROKEN_STEPS", 2)
    broken = small_data._replace(esdf=small_data.esdf.at[:].set(jnp.nan))
    with pytest.raises(FloatingPointError, match="not finite"):
        train(small_config, broken, tmp_path, say=lambda text: None)


def test_mirroring_flips_everything_together(small_config, small_data):
    """Property: a mirrored row's image, goal and maps are the flipped originals."""
    arguments = (jnp.arange(4), jax.random.key(3))
    planner = small_config.planner
    plain = gather_batch(small_data, *arguments, False, planner)
    mirrored = gather_batch(small_data, *arguments, True, planner)
    flipped = np.flatnonzero(np.asarray(plain.goal[:, 1]) != np.asarray(mirrored.goal[:, 1]))
    assert 0 < len(flipped) < 4
    for row in flipped:
        np.testing.assert_array_equal(mirrored.depth[row], plain.depth[row][:, ::-1])
        np.testing.assert_array_equal(mirrored.maps.esdf[row], plain.maps.esdf[row][:, ::-1])
        np.testing.assert_array_equal(mirrored.maps.route[row], plain.maps.route[row] * np.array([1.0, -1.0]))


def test_another_configuration_does_not_resume_and_the_field_is_named(uninterrupted, config_with, small_data):
    folder, _ = uninterrupted
    with pytest.raises(
        CheckpointError, match=r"another configuration.*: learning_rate is 0.0015 there and 0.0005 here"
    ):
        train(config_with(learning_rate=5e-4), small_data, folder, say=lambda text: None)


def test_data_is_compared_by_its_content_not_by_its_place(uninterrupted, config_with, small_data):
    """The same frames by another path, and another rhythm of checkpoints, go on (here: have nothing left to do)."""
    folder, whole = uninterrupted
    moved = config_with(source=DataConfig(folder=Path("elsewhere")), checkpoint_every=5, keep_checkpoints=3)
    assert_trees_equal(train(moved, small_data, folder, say=lambda text: None).state, whole.state)


@pytest.mark.parametrize("field", ["depth", "mounts", "goals"])
def test_other_data_of_the_same_size_does_not_resume(uninterrupted, small_config, small_data, field):
    """At the same place: a single number of one array is another."""
    folder, _ = uninterrupted
    array = np.array(getattr(small_data, field))
    array[(3,) + (0,) * (array.ndim - 1)] += 1
    before = sorted((folder / "checkpoints").iterdir())
    with pytest.raises(CheckpointError, match=f"the frames' {field} are others there"):
        train(small_config, small_data._replace(**{field: jnp.asarray(array)}), folder, say=lambda text: None)
    assert sorted((folder / "checkpoints").iterdir()) == before


def test_without_known_content_the_source_must_be_the_same(small_config, config_with, tmp_path, monkeypatch):
    """A path may be spelt in any way; the number of frames and the folder are named if they differ."""
    monkeypatch.chdir(tmp_path)
    state = initial_state(small_config, make_optimiser(small_config, 6))
    saved = Checkpoint(state, config_with(source=DataConfig(folder=Path("walk"))), 8, {})
    same = config_with(source=DataConfig(folder=tmp_path / "other" / ".." / "walk"))
    assert differences(saved, same, 8, {}) == []
    (sentence,) = differences(saved, config_with(source=DataConfig(folder=Path("ride"))), 8, {})
    assert "source.folder" in sentence and "walk" in sentence and "ride" in sentence
    assert differences(saved._replace(frames=7), same, 8, {}) == ["the data has 7 frames there and 8 here"]


def test_metrics_survive_a_half_written_line(tmp_path):
    file = tmp_path / "metrics.jsonl"
    log = MetricsFile(tmp_path)
    log.write(0, {"total": 1.0})
    log.close()
    file.write_text(file.read_text() + '{"step": 1, "tot')
    log = MetricsFile(tmp_path, first_step=1)
    log.write(1, {"total": 0.5})
    log.close()
    assert [line["step"] for line in read_metrics(file)] == [0, 1]


@pytest.mark.parametrize("size", [0.1, 100.0])
@pytest.mark.parametrize("known_norm", [False, True])
def test_clipping_equals_optax(size, known_norm):
    """Oracle: `optax.clip_by_global_norm` before `optax.adam`, below and above the largest norm, over three steps."""
    config = TrainConfig(clip=10.0, learning_rate=1e-3, final_learning_rate=0.02)
    schedule = optax.warmup_cosine_decay_schedule(1e-4, 1e-3, 10, 100, 2e-5)
    ours, oracle = make_optimiser(config, 100), optax.chain(optax.clip_by_global_norm(10.0), optax.adam(schedule))
    params = {"a": jnp.ones((3, 4)), "b": jnp.ones(5)}
    state, expected_state = ours.init(params), oracle.init(params)
    for key in jax.random.split(jax.random.key(0), 3):
        gradient = jax.tree.map(lambda leaf, k=key: size * jax.random.normal(k, leaf.shape), params)
        known = {"norm": optax.global_norm(gradient)} if known_norm else {}
        updates, state = ours.update(gradient, state, params, **known)
        expected, expected_state = oracle.update(gradient, expected_state, params)
        jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-5), updates, expected)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-5), state, expected_state)

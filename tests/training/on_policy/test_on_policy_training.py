"""On-policy training: it learns, goes on bit for bit after a stop, and says what is wrong with its files."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import CheckpointError
from iwalker_jax.planning import MapViewParameters, MemoryIPathConfig, split_module
from iwalker_jax.surrogate import FieldParameters
from iwalker_jax.training.on_policy import (
    OnPolicyConfig,
    load_memory_ipath,
    proposal_loss,
    save_memory_ipath,
    train_on_policy,
)
from iwalker_jax.training.on_policy.loop import first_state, practice_scenes, walk_round
from iwalker_jax.training.run_log import read_metrics

SMALL = OnPolicyConfig(
    network=MemoryIPathConfig(view=MapViewParameters(bearings=36, rings=8, samples_per_ring=8), hidden=64, judging=32),
    grids=FieldParameters(goals=2),
    scenes=16,
    robots=32,
    steps=16,
    rounds=6,
    epochs=4,
    batch=64,
    seed=3,
)


def leaves_of(network):
    return [np.asarray(leaf) for leaf in jax.tree.leaves(split_module(network).params)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run from start to end."""
    folder = tmp_path_factory.mktemp("whole")
    return train_on_policy(SMALL, folder, say=lambda text: None).network, folder


def test_a_few_rounds_lower_what_proposals_cost(whole):
    """Oracle: the network that has learnt nothing, at the same places."""
    fields = practice_scenes(SMALL)
    state = first_state(SMALL, fields)
    visits = jax.jit(lambda state: walk_round(SMALL, fields, state.network, state.robots, jnp.asarray(0.0))[1])(state)
    report = jax.jit(lambda network: proposal_loss(network.merge(), SMALL, fields, visits, jnp.asarray(0.0))[1])
    before, after = report(state.network), report(split_module(whole[0]))
    assert after.best < 0.8 * before.best
    assert after.cost_error < 0.8 * before.cost_error
    lines = read_metrics(whole[1] / "metrics.jsonl")
    assert len(lines) == SMALL.rounds
    for line in lines:
        assert 0.999 < line["reached"] + line["collided"] + line["timed_out"] < 1.001 or line["reached"] == 0


def test_a_stopped_run_goes_on_to_the_same_parameters(whole, tmp_path):
    """Oracle: the run that was not stopped, bit for bit."""
    said = []
    assert train_on_policy(SMALL, tmp_path, stop_after=2, say=said.append).rounds == 2
    network, rounds = train_on_policy(SMALL, tmp_path, say=said.append)
    assert rounds == SMALL.rounds
    assert any("Resuming at round 2" in text for text in said)
    for a, b in zip(leaves_of(network), leaves_of(whole[0]), strict=True):
        np.testing.assert_array_equal(a, b)
    assert [line["step"] for line in read_metrics(tmp_path / "metrics.jsonl")] == list(range(SMALL.rounds))


def test_another_configuration_and_damage_are_said(whole, tmp_path):
    """Oracle: one sentence that names the file."""
    (tmp_path / "checkpoint.npz").write_bytes((whole[1] / "checkpoint.npz").read_bytes())
    with pytest.raises(CheckpointError, match="another configuration"):
        train_on_policy(dataclasses.replace(SMALL, learning_rate=0.5), tmp_path, say=lambda text: None)
    content = bytearray((tmp_path / "checkpoint.npz").read_bytes())
    content[len(content) // 2] ^= 1
    (tmp_path / "checkpoint.npz").write_bytes(content)
    with pytest.raises(CheckpointError, match="no training that can go on"):
        train_on_policy(SMALL, tmp_path, say=lambda text: None)


def test_a_saved_network_comes_back(whole, tmp_path):
    """Oracle: the parameters, rounded to half precision, and the configuration."""
    file = tmp_path / "network.npz"
    save_memory_ipath(file, whole[0], SMALL)
    network, config = load_memory_ipath(file)
    assert config == SMALL
    for a, b in zip(leaves_of(network), leaves_of(whole[0]), strict=True):
        np.testing.assert_array_equal(a, b.astype(np.float16).astype(np.float32))
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(CheckpointError, match="no iPath with a memory"):
        load_memory_ipath(file)

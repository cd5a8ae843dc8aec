"""The command that trains iPath with a memory, from arguments to files; the training itself has tests of its own."""

import json

import pytest
from flax import nnx

from iwalker_jax.commands import train_memory
from iwalker_jax.planning import MemoryIPath, MemoryIPathConfig
from iwalker_jax.training.on_policy import NETWORK_FILE, OnPolicyConfig, OnPolicyResult, load_memory_ipath
from tests.experiments.commands import fails_with_one_sentence


@pytest.fixture
def asked(monkeypatch):
    """What the training was asked for; it ends at once."""
    asked = []

    def train(config, folder, **options):
        asked.append((config, options))
        return OnPolicyResult(MemoryIPath(config.network, nnx.Rngs(0)), config.rounds if options["resume"] else 1)

    monkeypatch.setattr(train_memory, "train_on_policy", train)
    quick = OnPolicyConfig(network=MemoryIPathConfig(hidden=8, judging=8), scenes=96, robots=96, rounds=12)
    monkeypatch.setitem(train_memory.PRESETS, "quick", quick)
    return asked


def test_options_override_the_preset_and_the_network_is_kept(asked, tmp_path):
    """Oracle: the configuration that the training hears of, and the files."""
    assert train_memory.main(["--preset", "quick", "--rounds", "3", "--seed", "7", "--out", str(tmp_path)]) == 0
    config, options = asked[0]
    assert (config.rounds, config.seed, config.scenes) == (3, 7, 96) and options["resume"]
    network, read = load_memory_ipath(tmp_path / NETWORK_FILE)
    assert read == config and network.config == config.network
    assert json.loads((tmp_path / "config.json").read_text())["rounds"] == 3


def test_a_stopped_training_keeps_no_network(asked, tmp_path):
    """Oracle: the shell's status of a command that Ctrl-C ended."""
    assert train_memory.main(["--preset", "quick", "--fresh", "--out", str(tmp_path)]) == 130
    assert not (tmp_path / NETWORK_FILE).exists()


@pytest.mark.parametrize(
    "options, word",
    [(["--seed", "-1"], "seed"), (["--rounds", "0"], "rounds"), (["--robots", "1000000000"], "robots"),
     (["--learning-rate", "0"], "learning_rate"), (["--checkpoint-every", "0"], "checkpoint")],
)  # fmt: skip
def test_bad_options_are_one_sentence(asked, tmp_path, capsys, options, word):
    """Oracle: the option's name in the sentence."""
    command = lambda: train_memory.main(["--preset", "quick", *options, "--out", str(tmp_path)])  # noqa: E731
    assert word in fails_with_one_sentence(command, capsys)
    assert not asked

"""Configuration files: options override them, they override defaults, and bad ones are said with file and field."""

import dataclasses
import json
import typing
from pathlib import Path

import pytest

from iwalker_jax.commands import collect, evaluate, train
from iwalker_jax.commands.shared.config_file import parse_options, write_options
from iwalker_jax.errors import InputError
from iwalker_jax.runtime.config_dict import config_from_dict, config_to_dict
from iwalker_jax.training.config import PRESETS, TrainConfig
from tests.experiments.commands import fails_with_one_sentence


def written(folder: Path, values) -> str:
    """A configuration file of these values."""
    file = folder / "config.json"
    file.write_text(values if isinstance(values, str) else json.dumps(values))
    return str(file)


def test_options_override_the_file_and_the_file_the_defaults(tmp_path):
    file = written(tmp_path, {"epochs": 3, "clip": None, "planner": {"ipath": {"hidden": 32}}, "start_from": "runs/a"})
    command = train.parse(["--config", file, "--epochs", "5", "--planner.ipath.trunk-width", "8"])
    assert (command.training.epochs, command.training.clip, command.start_from) == (5, None, Path("runs/a"))
    ipath = dataclasses.replace(TrainConfig().planner.ipath, hidden=32, trunk_width=8)
    assert command.training == dataclasses.replace(
        TrainConfig(epochs=5, clip=None), planner=dataclasses.replace(TrainConfig().planner, ipath=ipath)
    )
    assert command.out == Path("runs") / f"{tmp_path.name}-again"
    assert train.parse([f"--config={file}", "--out", "there"]).out == Path("there")
    assert train.parse(["--config", file, "--data", "walk"]).training.source.folder == Path("walk")


@pytest.mark.parametrize("preset", PRESETS)
def test_the_file_of_every_preset_is_that_preset(preset, tmp_path):
    file = written(tmp_path, config_to_dict(PRESETS[preset]()))
    assert train.parse(["--config", file]).training == PRESETS[preset]()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"colour": 1}, "has no field colour"),
        ({"planner": {"ipath": {"colour": 1}}}, "has no field planner.ipath.colour"),
        ({"epochs": "many"}, "epochs is 'many'; give a whole number"),
        ({"epochs": 2.5}, "epochs is 2.5; give a whole number"),
        ({"epochs": True}, "epochs is True; give a whole number"),
        ({"epochs": None}, "epochs is None; give a whole number"),
        ({"epochs": 0}, "at least 1"),
        ({"mirror": 1}, "mirror is 1; give true or false"),
        ({"method": "magic"}, "method is 'magic'; give one of iwalker, iplanner, finetuned, ppo"),
        ({"weights": {"tracking": [1]}}, "weights.tracking is [1]; give a number"),
        ({"source": {"folder": 3}}, "source.folder is 3; give a path as a text"),
        ({"source": [1]}, "source is [1]; give its fields by their names"),
        ({"devices": "two"}, "devices is 'two'; give a whole number"),
        ({"learning_rate": float("nan")}, "positive"),
        ([1], "holds no options"),
        ("{", "holds no options"),
    ],
)
def test_a_bad_file_is_one_sentence_that_names_file_and_field(values, words, tmp_path, capsys):
    file = written(tmp_path, values)
    sentence = fails_with_one_sentence(lambda: train.main(["--config", file, "--out", str(tmp_path / "run")]), capsys)
    assert words in sentence and file in sentence
    assert not (tmp_path / "run").exists()


def test_a_file_that_is_not_there_and_a_preset_beside_it_are_refused(tmp_path, capsys):
    absent = str(tmp_path / "absent.json")
    assert f"{absent} is missing" in fails_with_one_sentence(lambda: train.main(["--config", absent]), capsys)
    file = written(tmp_path, {})
    both = fails_with_one_sentence(lambda: train.main(["--config", file, "--preset", "quick"]), capsys)
    assert "give one of them" in both


@pytest.mark.parametrize("module", [collect, evaluate])
def test_what_other_commands_write_is_read_back(module, tmp_path):
    """Oracle: the command as it was parsed from its options alone."""
    command = parse_options(module.Command, ["--seed", "7", "--run", "runs/mine", "--width", "3"])
    file = tmp_path / "config.json"
    write_options(file, command, ("config", "out", "group"))
    again = parse_options(module.Command, ["--config", str(file), "--width", "4"])
    assert dataclasses.replace(again, config=None, width=3) == command


@dataclasses.dataclass(frozen=True)
class Sample:
    """A field of every kind that a file can hold."""

    words: tuple[str, ...] = ("a",)
    count: int | None = None
    kind: typing.Literal["x", "y"] = "x"
    place: Path = Path("here")


def test_lists_are_tuples_and_their_entries_are_checked():
    sample = Sample(("b", "c"), 2, "y", Path("there"))
    assert config_from_dict(Sample, json.loads(json.dumps(config_to_dict(sample)))) == sample
    with pytest.raises(InputError, match=r"^words\[1\] is 2; give a text\.$"):
        config_from_dict(Sample, {"words": ["b", 2]})
    with pytest.raises(InputError, match=r"^words is 'b'; give a list\.$"):
        config_from_dict(Sample, {"words": "b"})

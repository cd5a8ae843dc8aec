"""The run's record and the loggers beside it: all hear the same, resumptions go on, missing packages are a sentence."""

import importlib.util
import re
import struct
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from iwalker_jax.commands import train
from iwalker_jax.errors import InputError
from iwalker_jax.runtime.config_dict import config_to_dict
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.run_log import LOGGERS, RunLog, read_metrics, require_loggers

STEPS = {0: {"total": 2.0, "U_path": 0.5}, 1: {"total": 1.5, "U_path": 0.25}}
EXTRA_OF = {name: (package, extra) for name, (package, extra, _) in LOGGERS.items()}


def log_steps(folder: Path, names, first_step: int = 0) -> None:
    log = RunLog(folder, TrainConfig(), first_step, names)
    for step, values in STEPS.items():
        if step >= first_step:
            log.write(step, {name: np.float32(value) for name, value in values.items()})
    log.close()


def test_every_logger_hears_what_the_file_holds(tmp_path, monkeypatch):
    """Oracle: the metrics file, read back."""
    heard = []

    class Logger:
        def __init__(self, folder, config, first_step):
            heard.append((folder, config, first_step))

        def write(self, step, values):
            heard.append({"step": step, **values})

        def close(self):
            heard.append("closed")

    monkeypatch.setitem(LOGGERS, "wandb", ("json", "wandb", Logger))
    log_steps(tmp_path, ("wandb", "wandb"))
    assert heard == [(tmp_path, TrainConfig(), 0), *read_metrics(tmp_path / "metrics.jsonl"), "closed"]


@pytest.mark.parametrize("name", LOGGERS)
def test_a_missing_package_is_a_sentence_with_its_extra(name, tmp_path, monkeypatch, capsys):
    package, extra = EXTRA_OF[name]
    monkeypatch.setattr(importlib.util, "find_spec", lambda wanted: None)
    with pytest.raises(InputError, match=re.escape(f"the package {package}; run: pip install 'iwalker-jax[{extra}]'.")):
        require_loggers((name,))
    with pytest.raises(SystemExit, match="1"):
        train.main(["--out", str(tmp_path / "run"), "--log", name])
    assert "pip install" in capsys.readouterr().err
    assert not (tmp_path / "run" / "metrics.jsonl").exists()


def tensorboard_scalars(folder: Path) -> dict[tuple[int, str], float]:
    """Scalars of the event files in a folder, later ones over earlier ones; frames as TensorFlow's records."""
    from tensorboardX.proto.event_pb2 import Event

    found = {}
    for file in sorted(folder.glob("events.*")):
        content, at = file.read_bytes(), 0
        while at < len(content):
            (length,) = struct.unpack_from("<Q", content, at)
            event = Event.FromString(content[at + 12 : at + 12 + length])
            at += 16 + length
            found |= {(event.step, value.tag): value.simple_value for value in event.summary.value}
    return found


def test_tensorboard_events_hold_the_metrics(tmp_path):
    pytest.importorskip("tensorboardX")
    log_steps(tmp_path, ("tensorboard",))
    wanted = {(step, name): value for step, values in STEPS.items() for name, value in values.items()}
    assert tensorboard_scalars(tmp_path / "tensorboard") == wanted


class PretendedWandb(ModuleType):
    """The few calls of wandb that are made; what was begun and logged."""

    def __init__(self):
        super().__init__("wandb")
        self.begun, self.logged = [], []
        self.Settings = lambda **settings: settings

    def init(self, **options):
        if options["mode"] == "sideways":
            raise ValueError("no such mode")
        self.begun.append(options)
        return SimpleNamespace(log=lambda values, step: self.logged.append((step, values)), finish=lambda: None)


@pytest.fixture
def pretended_wandb(monkeypatch):
    module = PretendedWandb()
    monkeypatch.setitem(sys.modules, "wandb", module)
    monkeypatch.setattr(importlib.util, "find_spec", lambda wanted: object())
    monkeypatch.delenv("WANDB_MODE", raising=False)
    return module


def test_a_run_of_wandb_is_offline_and_goes_on_when_training_does(pretended_wandb, tmp_path, monkeypatch):
    log_steps(tmp_path, ("wandb",))
    log_steps(tmp_path, ("wandb",), first_step=1)
    log_steps(tmp_path, ("wandb",))
    monkeypatch.setenv("WANDB_MODE", "online")
    log_steps(tmp_path, ("wandb",), first_step=1)
    begun = pretended_wandb.begun
    one, same, other, same_as_other = (run["id"] for run in begun)
    assert one == same != other == same_as_other
    assert [run["resume"] for run in begun] == [None, "allow", None, "allow"]
    assert [run["mode"] for run in begun] == ["offline", "offline", "offline", "online"]
    assert all(run["config"] == config_to_dict(TrainConfig()) and run["dir"] == str(tmp_path) for run in begun)
    assert pretended_wandb.logged[:3] == [(0, STEPS[0]), (1, STEPS[1]), (1, STEPS[1])]


def test_a_run_of_wandb_that_cannot_begin_is_a_sentence(pretended_wandb, tmp_path, monkeypatch):
    monkeypatch.setenv("WANDB_MODE", "sideways")
    with pytest.raises(InputError, match=r"cannot begin a run \(ValueError: no such mode\); set WANDB_MODE=offline"):
        log_steps(tmp_path, ("wandb",))


def test_an_offline_run_of_wandb_is_on_the_disk(tmp_path, monkeypatch):
    """With the package itself, no network and no account."""
    pytest.importorskip("wandb")
    for name in ("WANDB_MODE", "WANDB_API_KEY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    log_steps(tmp_path, ("wandb",))
    (file,) = tmp_path.glob("wandb/offline-run-*/run-*.wandb")
    assert (tmp_path / "wandb" / "id.txt").read_text().strip() in file.name
    content = file.read_bytes()
    assert all(name in content for name in (b"U_path", b"total", b"learning_rate"))

"""Where a run begins: at its newest checkpoint, if that belongs to the same training, or at its start."""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
import optax

from iwalker_jax.errors import CheckpointError, InputError
from iwalker_jax.planning import Planner
from iwalker_jax.runtime.config_dict import config_to_dict
from iwalker_jax.runtime.processes import broadcast, is_first
from iwalker_jax.training.checkpoints import Checkpoint, CheckpointStore
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.train_step import TrainState, initial_state, with_planner

_FREE = ("checkpoint_every", "keep_checkpoints")
"""Fields of a configuration that do not change what is learnt."""


def starting_state(
    store: CheckpointStore,
    config: TrainConfig,
    optimiser: optax.GradientTransformationExtraArgs,
    frames: int,
    content: Mapping[str, str],
    resume: bool,
    start_from: Planner | None,
    say: Callable[[str], None],
) -> TrainState:
    """The state that process 0 resumes from or starts with, in every process.

    Raises:
        CheckpointError: if the checkpoints cannot be read, or belong to another training.
        InputError: if this process has other data than process 0.
    """
    state = _restored(store, config, frames, content, say) if resume and is_first() else None
    if state is None:
        state = initial_state(config, optimiser)
        if start_from is not None:
            params = with_planner(config, state.params, start_from)
            state = state._replace(params=params, opt_state=optimiser.init(params))
    if jax.process_count() == 1:
        return state
    own = np.frombuffer(bytes.fromhex("".join(content.values())), np.uint8)
    state, theirs = broadcast((state, own))
    if not np.array_equal(own, theirs):
        raise InputError("This process has other frames than process 0; give all the same data.")
    return state


def _restored(
    store: CheckpointStore,
    config: TrainConfig,
    frames: int,
    content: Mapping[str, str],
    say: Callable[[str], None],
) -> TrainState | None:
    found = store.restore_latest(on_damage=say)
    if found is None:
        return None
    differing = differences(found, config, frames, content)
    if differing:
        raise CheckpointError(
            f"{store.folder} holds a run with another configuration or data set: {'; '.join(differing)}. Use what it "
            "was made with, or choose another output folder."
        )
    store.delete_after(int(found.state.step))
    return found.state


def differences(saved: Checkpoint, config: TrainConfig, frames: int, content: Mapping[str, str]) -> list[str]:
    """What makes a training another one than the checkpoint's, each with its name; empty if it may go on.

    Data is compared by its content, wherever it lies; only of a checkpoint that does not know its data's content it is
    the source that must be the same.
    """
    there, here = (_flat(config_to_dict(_comparable(made, bool(saved.content)))) for made in (saved.config, config))
    found = [
        f"{name} is {there.get(name)} there and {here.get(name)} here"
        for name in sorted({**there, **here})
        if there.get(name) != here.get(name)
    ]
    if saved.frames != frames:
        found.append(f"the data has {saved.frames} frames there and {frames} here")
    elif saved.content:
        other = [name for name in content if saved.content.get(name) != content[name]]
        if other:
            found.append(f"the frames' {', '.join(other)} are others there, though as many")
    return found


def _comparable(config: TrainConfig, content_known: bool) -> TrainConfig:
    """The configuration with what may differ at its default."""
    default = TrainConfig()
    config = dataclasses.replace(config, **{name: getattr(default, name) for name in _FREE})
    source = config.source
    if content_known:
        source = default.source
    else:
        source = dataclasses.replace(source, folder=_absolute(source.folder), episodes=_absolute(source.episodes))
    return dataclasses.replace(config, source=source)


def _absolute(place: Path | None) -> Path | None:
    return None if place is None else place.expanduser().resolve()


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Values of nested dictionaries by their dotted names, as the command's options are called."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            # A file holds lists where a configuration has tuples.
            flat[prefix + name] = list(value) if isinstance(value, tuple) else value
    return flat

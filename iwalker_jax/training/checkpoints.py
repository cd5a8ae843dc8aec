"""Checkpoints (orbax): parameters, optimiser state, random key, step and configuration, written atomically.

A checksum over the named leaves and the configuration tells a damaged or edited checkpoint from a whole one: the format
itself returns most flipped bits as other numbers.
"""

import contextlib
import errno
import hashlib
import io
import json
import logging
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as ocp

from iwalker_jax.errors import CheckpointError
from iwalker_jax.runtime.config_dict import config_from_dict, config_to_dict
from iwalker_jax.runtime.files import digest, first_line
from iwalker_jax.runtime.reading import printable
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.train_step import TrainState, initial_state, make_optimiser

_LEAVES, _META, _CHECKSUM = "state", "meta", "checksum"
_BESIDE = 1_000_000  # [bytes] of names, settings and the disk's own blocks


class Checkpoint(NamedTuple):
    """What a checkpoint holds.

    Attributes:
        state: of the training.
        config: that it was made with.
        frames: number of frames of the data.
        content: digests of the data by the names of its arrays; empty if they were not given.
    """

    state: TrainState
    config: TrainConfig
    frames: int
    content: dict[str, str]


class CheckpointStore:
    """The checkpoints of one run, in one folder.

    A checkpoint appears under its step number only once it is complete, so an interrupted write leaves the earlier
    ones intact. Leaves are stored by name: a checkpoint of another network size is refused with the differing names.
    Of several processes any may read, and process 0 writes, without waiting for the others.
    """

    def __init__(self, folder: Path, keep: int = 2):
        self.folder = Path(folder).absolute()
        # Orbax logs every save; what a user must know is said by this class.
        logging.getLogger("absl").setLevel(logging.CRITICAL)
        process = jax.process_index()
        alone = ocp.options.MultiprocessingOptions(
            primary_host=process, active_processes={process}, barrier_sync_key_prefix=f"process_{process}"
        )
        options = ocp.CheckpointManagerOptions(
            max_to_keep=keep, create=False, enable_async_checkpointing=False, multiprocessing_options=alone
        )
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._manager = ocp.CheckpointManager(self.folder, options=options)
        except OSError as error:
            raise CheckpointError(
                f"Cannot use {self.folder} for checkpoints: {error.strerror}; choose a writable folder."
            ) from error

    def steps(self) -> list[int]:
        """Steps of the complete checkpoints, oldest first."""
        return sorted(self._manager.all_steps())

    def save(
        self, state: TrainState, config: TrainConfig, frames: int, content: Mapping[str, str] | None = None
    ) -> None:
        """Write a checkpoint of the state; older ones beyond the number to keep are removed afterwards.

        Args:
            state: of the training.
            config: of the run.
            frames: number of frames of the data.
            content: digests of the data by the names of its arrays, to tell other data of the same size.

        Raises:
            CheckpointError: if it cannot be written (a full disk, say); the earlier checkpoints stay intact.
        """
        step = int(state.step)
        leaves = jax.device_get(_named_leaves(state))
        meta = {"config": config_to_dict(config), "frames": frames, "content": dict(content or {}), "step": step}
        meta[_CHECKSUM] = _checksum(leaves, meta)
        arguments = ocp.args.Composite(**{_LEAVES: ocp.args.StandardSave(leaves), _META: ocp.args.JsonSave(meta)})
        try:
            _require_space(self.folder, sum(np.asarray(leaf).nbytes for leaf in leaves.values()))
            # A write that fails prints a traceback for every leaf beside the one error that it raises.
            with contextlib.redirect_stderr(io.StringIO()):
                self._manager.save(step, args=arguments, force=True)
                self._manager.wait_until_finished()
        except Exception as error:  # orbax and tensorstore raise many kinds; each means "not written"
            for part in self.folder.glob(f"{step}.orbax-checkpoint-tmp*"):
                shutil.rmtree(part, ignore_errors=True)
            raise CheckpointError(
                f"Could not write the checkpoint of step {step} in {self.folder} ({first_line(error)}); earlier "
                f"checkpoints {self.steps_on_disk()} are intact. Free some space and resume."
            ) from error

    def steps_on_disk(self) -> list[int]:
        """Steps of the complete checkpoints as the folder shows them, oldest first."""
        return sorted(int(entry.name) for entry in self.folder.glob("[0-9]*") if entry.name.isdigit())

    def restore(self, step: int) -> Checkpoint:
        """The checkpoint of a step.

        Raises:
            CheckpointError: if it is missing, damaged, edited, or belongs to another version or network size.
        """
        advice = "use an earlier checkpoint, or start the run afresh"
        parts = ocp.args.Composite(**{_LEAVES: ocp.args.StandardRestore(), _META: ocp.args.JsonRestore()})
        try:
            stored = self._manager.restore(step, args=parts)
            leaves, meta = dict(stored[_LEAVES]), dict(stored[_META])
            # An earlier version's field is named before the checksum that an editor did not mind.
            config: TrainConfig = config_from_dict(TrainConfig, meta["config"])
            wanted = meta.pop(_CHECKSUM)
            if wanted != _checksum(leaves, meta) or meta["step"] != step:
                raise ValueError("it does not match its checksum: it is damaged or was edited")
            state = _state_of(leaves, config, meta["frames"])
        except Exception as error:  # orbax and tensorstore raise many kinds; each means "not readable"
            raise CheckpointError(
                f"Checkpoint {step} in {self.folder} cannot be read ({first_line(error)}); {advice}."
            ) from error
        if not all(np.isfinite(leaf).all() for leaf in leaves.values() if np.issubdtype(leaf.dtype, np.floating)):
            raise CheckpointError(f"Checkpoint {step} in {self.folder} holds values that are not finite; {advice}.")
        return Checkpoint(state, config, meta["frames"], meta["content"])

    def restore_latest(self, on_damage: Callable[[str], None] = lambda sentence: None) -> Checkpoint | None:
        """The newest readable checkpoint, or None if there is none at all; `on_damage` hears of each unreadable one.

        Raises:
            CheckpointError: if there are checkpoints and none can be read.
        """
        last_error: CheckpointError | None = None
        for step in reversed(self.steps()):
            try:
                return self.restore(step)
            except CheckpointError as error:
                last_error = error
                on_damage(str(error))
        if last_error is not None:
            raise last_error
        return None

    def delete_after(self, step: int) -> None:
        """Remove the checkpoints newer than a step (damaged ones that a resumed run will write again)."""
        for other in self.steps():
            if other > step:
                self._manager.delete(other)

    def close(self) -> None:
        """Release orbax's threads."""
        self._manager.close()


def load_run(
    run: Path, checkpoint: int | None = None, say: Callable[[str], None] = print
) -> tuple[TrainState, TrainConfig]:
    """State and configuration of a run's checkpoint (the newest readable one by default); damage is said.

    Raises:
        CheckpointError: if the run has no checkpoint, or it cannot be read.
    """
    folder = run / "checkpoints"
    if not os.path.isdir(folder):
        shown = printable(run, 300)
        raise CheckpointError(f"{shown} holds no checkpoints; run `iwalker-train --out {shown}` first.")
    store = CheckpointStore(folder)
    try:
        if checkpoint is not None and checkpoint not in store.steps():
            raise CheckpointError(f"{run} has no checkpoint {checkpoint}; it has {store.steps()}.")
        found = store.restore_latest(on_damage=say) if checkpoint is None else store.restore(checkpoint)
    finally:
        store.close()
    if found is None:
        raise CheckpointError(f"{run} holds no complete checkpoint; run `iwalker-train --out {run}`.")
    return found.state, found.config


def _named_leaves(state: TrainState) -> dict[str, Any]:
    """Leaves of a state by their path; orbax needs plain containers, and names make damage reports readable."""
    return {_name(path): leaf for path, leaf in jax.tree_util.tree_flatten_with_path(state)[0]}


def _state_of(leaves: Mapping[str, np.ndarray], config: TrainConfig, frames: int) -> TrainState:
    """The state that the named leaves make.

    Raises:
        ValueError: if they are not those of this version's networks, with the differing names.
    """
    optimiser = make_optimiser(config, config.total_steps(frames))
    template = jax.eval_shape(lambda: initial_state(config, optimiser))
    wanted = {name: (leaf.shape, leaf.dtype) for name, leaf in _named_leaves(template).items()}
    found = {name: (leaf.shape, leaf.dtype) for name, leaf in leaves.items()}
    if found != wanted:
        names = sorted(name for name in {**wanted, **found} if wanted.get(name) != found.get(name))
        raise ValueError(f"its arrays are not those of this version's networks: {', '.join(names)}")
    return jax.tree.unflatten(jax.tree.structure(template), [jnp.asarray(leaves[name]) for name in wanted])


def _name(path: tuple) -> str:
    return jax.tree_util.keystr(path, simple=True, separator="_")


def _require_space(folder: Path, size: int) -> None:
    """Raise OSError if a checkpoint of so many bytes, uncompressed, and what lies beside it would fill the disk."""
    if shutil.disk_usage(folder).free < size + _BESIDE:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _checksum(leaves: Mapping[str, Any], meta: Mapping[str, Any]) -> str:
    """SHA-256 over named leaves and what is kept beside them."""
    named = dict(sorted(leaves.items()))
    return hashlib.sha256(f"{digest(named)} {json.dumps(meta, sort_keys=True)}".encode()).hexdigest()

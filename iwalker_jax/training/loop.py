"""The training loop: resumes, reports progress, checkpoints, and survives Ctrl-C, full disks and broken batches."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
from jax.sharding import Mesh

from iwalker_jax.errors import CheckpointError
from iwalker_jax.planning import Planner
from iwalker_jax.runtime.devices import chosen_devices
from iwalker_jax.runtime.locks import exclusive
from iwalker_jax.runtime.processes import device_put, is_first
from iwalker_jax.training.batches import frame_order
from iwalker_jax.training.checkpoints import CheckpointStore
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.maps import TrainingData, data_content
from iwalker_jax.training.resume import starting_state
from iwalker_jax.training.run_log import LoggerName, RunLog, save_broken_batch
from iwalker_jax.training.train_step import (
    StepReport,
    TrainState,
    make_optimiser,
    make_train_step,
)

MAX_BROKEN_STEPS = 10
"""Consecutive steps without a finite gradient after which a run gives up."""


@dataclass
class TrainingProgress:
    """What a progress display needs after each step."""

    step: int
    total: int
    losses: dict[str, float]
    frames_per_second: float


@dataclass
class TrainResult:
    """How a run ended: its state, whether it was interrupted, and what could not be saved (None if all was)."""

    state: TrainState
    interrupted: bool
    unsaved: str | None


def batch_mesh(devices: int | None = None) -> Mesh | None:
    """Mesh over the first `devices` devices (all by default) of every process; None for a single one in all.

    Raises:
        InputError: if fewer devices are present.
    """
    count = len(chosen_devices(devices))
    chosen = [device for k in range(jax.process_count()) for device in jax.local_devices(process_index=k)[:count]]
    return None if len(chosen) == 1 else Mesh(np.array(chosen), ("batch",))


def train(
    config: TrainConfig,
    data: TrainingData,
    folder: Path,
    *,
    resume: bool = True,
    start_from: Planner | None = None,
    mesh: Mesh | None = None,
    loggers: Sequence[LoggerName] = (),
    stop_after: int | None = None,
    on_progress: Callable[[TrainingProgress], None] = lambda progress: None,
    say: Callable[[str], None] = print,
) -> TrainResult:
    """Train a planner; checkpoints and metrics go to `folder`.

    Several processes train one planner together; each has a folder of its own, and process 0's holds the checkpoints.

    Args:
        config: of the run. A resumed run must have the configuration it began with, but for where its data lies and
            how often it saves.
        data: frames and maps; the same in every process.
        folder: of the run.
        resume: continue from the newest readable checkpoint in the folder, if there is one; otherwise remove them.
        start_from: planner to start from instead of a fresh initialisation (fine-tuning).
        mesh: devices for data parallelism, see `batch_mesh`.
        loggers: that hear of the metrics beside the run's own file.
        stop_after: stop after this many steps of the schedule, as if interrupted.
        on_progress: hears of every step.
        say: hears the sentences a user must read.

    Raises:
        CheckpointError: if the folder's checkpoints cannot be read, or belong to another configuration or other data.
        InputError: if another process trains in the folder, or other processes of the group have other data.
        FloatingPointError: after `MAX_BROKEN_STEPS` consecutive steps without a finite gradient.
    """
    # Another process in the folder would interleave its checkpoints and metrics.
    with exclusive(run_lock(folder), folder):
        frames = data.depth.shape[0]
        total = config.total_steps(frames)
        optimiser = make_optimiser(config, total)
        store = CheckpointStore(folder / "checkpoints", config.keep_checkpoints)
        if not resume:
            store.delete_after(-1)
        content = data_content(data)
        state = starting_state(store, config, optimiser, frames, content, resume, start_from, say)
        first = int(state.step)
        if 0 < first < total:
            say(f"Resuming at step {first} of {total}.")
        # The step donates its state: never hand it the caller's own arrays.
        state = device_put(state, mesh)
        data = device_put(data, mesh)
        checkpoints = _Checkpoints(store, config, content, frames, say, first if first in store.steps() else -1)
        broken = _BrokenSteps(folder, say)
        log = RunLog(folder, config, first, loggers, say)
        step_function = make_train_step(config, optimiser, mesh)
        last = min(total, total if stop_after is None else stop_after)
        interrupted = False
        done = first
        clock = time.perf_counter()
        try:
            for step in range(first, last):
                index = frame_order(config.seed, frames, config.batch_size, step)
                state, report = step_function(state, data, device_put(index, mesh, "batch"))
                losses = _as_floats(report)
                done = step + 1
                broken.count(report, step, index, losses, state)
                now = time.perf_counter()
                speed = config.batch_size / max(now - clock, 1e-9)
                clock = now
                log.write(step, losses | {"frames_per_second": speed})
                on_progress(TrainingProgress(done, total, losses, speed))
                if done % config.checkpoint_every == 0 or done == total:
                    checkpoints.save(state)
                    clock = time.perf_counter()
        except KeyboardInterrupt:
            interrupted = True
        finally:
            log.close()
        # A step that Ctrl-C cut short has donated its state; only a state that is still there can be saved.
        alive = not any(leaf.is_deleted() for leaf in jax.tree.leaves(state))
        if alive and checkpoints.saved != int(state.step):
            checkpoints.save(state)
        if interrupted:
            say(f"Interrupted after step {done}; the same command resumes from checkpoint {store.steps()[-1:]}.")
        store.close()
        # Whole on one device, so that this process can use it alone.
        return TrainResult(device_put(state, None) if alive else state, interrupted, checkpoints.unsaved)


def run_lock(folder: Path) -> Path:
    """The file that whoever trains in a folder has locked."""
    return folder / ".lock"


class _Checkpoints:
    """Saves states in process 0; a failure is said and training goes on, because the next attempt may succeed.

    Attributes:
        saved: step of the newest state that was saved.
        unsaved: why the last attempt failed; None if it did not.
    """

    def __init__(
        self,
        store: CheckpointStore,
        config: TrainConfig,
        content: dict[str, str],
        frames: int,
        say: Callable[[str], None],
        saved: int,
    ) -> None:
        self._store, self._config, self._content, self._frames, self._say = store, config, content, frames, say
        self.saved = saved
        self.unsaved: str | None = None

    def save(self, state: TrainState) -> None:
        """Write a checkpoint."""
        try:
            if is_first():
                self._store.save(state, self._config, self._frames, self._content)
        except CheckpointError as error:
            self.unsaved = str(error)
            self._say(self.unsaved)
            return
        self.unsaved = None
        self.saved = int(state.step)


class _BrokenSteps:
    """Counts consecutive steps without a finite gradient; each is kept in a file and said."""

    def __init__(self, folder: Path, say: Callable[[str], None]) -> None:
        self._folder, self._say = folder, say
        self._consecutive = 0

    def count(
        self, report: StepReport, step: int, index: np.ndarray, losses: dict[str, float], state: TrainState
    ) -> None:
        """Take note of a step.

        Raises:
            FloatingPointError: if it is the last of `MAX_BROKEN_STEPS` in a row.
        """
        if report.finite:
            self._consecutive = 0
            return
        self._consecutive += 1
        file = save_broken_batch(self._folder, step, index, losses, state)
        self._say(f"Step {step} gave a loss or gradient that is not finite; it was skipped and kept in {file}.")
        if self._consecutive >= MAX_BROKEN_STEPS:
            raise FloatingPointError(
                f"{self._consecutive} steps in a row were not finite; lower the learning rate or inspect {file}."
            )


def _as_floats(report: StepReport) -> dict[str, float]:
    values = jax.device_get(report)
    return {name: float(value) for name, value in values.losses.items()} | {
        "gradient_norm": float(values.gradient_norm),
        "converged": float(values.converged),
    }

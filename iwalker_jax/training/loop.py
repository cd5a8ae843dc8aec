"""The training loop: resumes, reports progress, checkpoints, and survives Ctrl-C, full disks and broken batches."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
from jax.sharding import Mesh

from iwalker_jax.errors import CheckpointError, InputError
from iwalker_jax.planning.planner import Planner
from iwalker_jax.runtime.devices import chosen_devices
from iwalker_jax.runtime.processes import broadcast, device_put, is_first
from iwalker_jax.training.batches import frame_order
from iwalker_jax.training.checkpoints import CheckpointStore
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.maps import TrainingData
from iwalker_jax.training.run_log import MetricsLog, save_broken_batch
from iwalker_jax.training.train_step import (
    StepReport,
    TrainState,
    initial_state,
    make_optimiser,
    make_train_step,
    with_planner,
)

MAX_BROKEN_STEPS = 10
"""Consecutive steps without a finite gradient after which a run gives up."""


@dataclass
class Progress:
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
    tensorboard: bool = False,
    stop_after: int | None = None,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    say: Callable[[str], None] = print,
) -> TrainResult:
    """Train a planner; checkpoints and metrics go to `folder`.

    Several processes train one planner together; each has a folder of its own, and process 0's holds the checkpoints.

    Args:
        config: of the run. A resumed run must have the configuration it began with.
        data: frames and maps; the same in every process.
        folder: of the run.
        resume: continue from the newest readable checkpoint in the folder, if there is one; otherwise remove them.
        start_from: planner to start from instead of a fresh initialisation (fine-tuning).
        mesh: devices for data parallelism, see `batch_mesh`.
        tensorboard: also write TensorBoard events.
        stop_after: stop after this many steps of the schedule, as if interrupted.
        on_progress: hears of every step.
        say: hears the sentences a user must read.

    Raises:
        CheckpointError: if the folder's checkpoints cannot be read, or belong to another configuration.
        InputError: if other processes have other data.
        FloatingPointError: after `MAX_BROKEN_STEPS` consecutive steps without a finite gradient.
    """
    frames = data.depth.shape[0]
    total = config.total_steps(frames)
    optimiser = make_optimiser(config, total)
    store = CheckpointStore(folder / "checkpoints", config.keep_checkpoints)
    if not resume:
        store.delete_after(-1)
    state = _restored(store, config, frames, say) if resume and is_first() else None
    if state is None:
        state = initial_state(config, optimiser)
        if start_from is not None:
            params = with_planner(config, state.params, start_from)
            state = state._replace(params=params, opt_state=optimiser.init(params))
    state, theirs = broadcast((state, np.int32(frames)))
    if frames != theirs:
        raise InputError(f"This process has {frames} frames and process 0 has {theirs}; give all the same data.")
    first = int(state.step)
    if 0 < first < total:
        say(f"Resuming at step {first} of {total}.")
    # The step donates its state: never hand it the caller's own arrays.
    state = device_put(state, mesh)
    data = device_put(data, mesh)
    log = MetricsLog(folder, first, tensorboard)
    step_function = make_train_step(config, optimiser, mesh)
    last = min(total, total if stop_after is None else stop_after)
    interrupted, unsaved, broken = False, None, 0
    done = first
    saved = first if first in store.steps() else -1
    clock = time.perf_counter()
    try:
        for step in range(first, last):
            index = frame_order(config.seed, frames, config.batch_size, step)
            state, report = step_function(state, data, device_put(index, mesh, "batch"))
            losses = _as_floats(report)
            done = step + 1
            if report.finite:
                broken = 0
            else:
                broken += 1
                file = save_broken_batch(folder, step, index, losses, state)
                say(f"Step {step} gave a loss or gradient that is not finite; it was skipped and kept in {file}.")
                if broken >= MAX_BROKEN_STEPS:
                    raise FloatingPointError(
                        f"{broken} steps in a row were not finite; lower the learning rate or inspect {file}."
                    )
            now = time.perf_counter()
            speed = config.batch_size / max(now - clock, 1e-9)
            clock = now
            log.write(step, losses | {"frames_per_second": speed})
            on_progress(Progress(done, total, losses, speed))
            if done % config.checkpoint_every == 0 or done == total:
                unsaved = _save(store, state, config, frames, say)
                saved = done if unsaved is None else saved
                clock = time.perf_counter()
    except KeyboardInterrupt:
        interrupted = True
    finally:
        log.close()
    # A step that Ctrl-C cut short has donated its state; only a state that is still there can be saved.
    alive = not any(leaf.is_deleted() for leaf in jax.tree.leaves(state))
    if alive and saved != int(state.step):
        unsaved = _save(store, state, config, frames, say)
    if interrupted:
        say(f"Interrupted after step {done}; the same command resumes from checkpoint {store.steps()[-1:]}.")
    store.close()
    # Whole on one device, so that this process can use it alone.
    return TrainResult(device_put(state, None) if alive else state, interrupted, unsaved)


def _restored(
    store: CheckpointStore, config: TrainConfig, frames: int, say: Callable[[str], None]
) -> TrainState | None:
    found = store.restore_latest(on_damage=say)
    if found is None:
        return None
    state, saved_config, saved_frames = found
    store.delete_after(int(state.step))
    if saved_config != config or saved_frames != frames:
        raise CheckpointError(
            f"{store.folder} holds a run with another configuration or data set; choose another output folder, or "
            "delete this one to start afresh."
        )
    return state


def _save(
    store: CheckpointStore, state: TrainState, config: TrainConfig, frames: int, say: Callable[[str], None]
) -> str | None:
    """Save in process 0; a failure is said and training goes on, because the next attempt may succeed."""
    try:
        if is_first():
            store.save(state, config, frames)
    except CheckpointError as error:
        say(str(error))
        return str(error)
    return None


def _as_floats(report: StepReport) -> dict[str, float]:
    values = jax.device_get(report)
    return {name: float(value) for name, value in values.losses.items()} | {
        "gradient_norm": float(values.gradient_norm),
        "converged": float(values.converged),
    }

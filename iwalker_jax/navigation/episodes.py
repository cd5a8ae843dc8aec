"""Many episodes: one compiled program for a group of robots and a stretch of time, over all devices."""

import math
import time
from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import to_world, turn, turn_about_vertical
from iwalker_jax.navigation.closed_loop import Navigator, run_episode, start_episode
from iwalker_jax.navigation.faults import Faults, make_faults
from iwalker_jax.navigation.record import EpisodeRecord, Outcome
from iwalker_jax.runtime.devices import ShardedProgram, chosen_devices
from iwalker_jax.tasks import Task, TaskArrays, stack_tasks
from iwalker_jax.walking import Conditions, Disturbances, sample_conditions

_CHUNK = 2.0  # [s] of simulated time in one call


class EpisodeProgram:
    """Episodes of one navigator, compiled once; runs of any number of tasks are made of groups of one width."""

    def __init__(
        self,
        navigator: Navigator,
        width: int,
        devices: int | None = None,
        images: bool = False,
        disturbances: Disturbances = Disturbances(),
    ) -> None:
        """Decide the shapes; the compilation comes with the first run.

        Args:
            navigator: who walks.
            width: episodes at a time; rounded up to a multiple of the devices.
            devices: number of this process's devices, all by default.
            images: record depth and map of every frame.
            disturbances: from which each robot's friction, mass and start are drawn.
        """
        if width < 1:
            raise InputError(f"Groups of {width} episodes were asked for; give at least 1.")
        self.frames = max(1, round(_CHUNK / navigator.frame_time))
        self.compile_seconds, self.run_seconds = 0.0, 0.0
        self._disturbances = disturbances
        self._chunk = ShardedProgram(partial(run_episode, frames=self.frames, images=images), chosen_devices(devices))
        self.width = self._chunk.round_up(width)
        self.navigator = jax.device_put(navigator, self._chunk.replicated)
        many = jax.vmap(start_episode, in_axes=(None, 0, 0))
        self._start = jax.jit(many, out_shardings=self._chunk.sharded)

    def run(
        self,
        tasks: Sequence[Task],
        seed: int = 0,
        faults: Sequence[Faults] | None = None,
        on_progress: Callable[[float, int], None] = lambda seconds, running: None,
    ) -> EpisodeRecord:
        """Walk all tasks to their ends; task k meets the conditions of robot k of the seed.

        Args:
            tasks: to walk; group after group.
            seed: of conditions, sensors and depth noise.
            faults: one a task; none by default.
            on_progress: hears of the robot-seconds simulated so far, and of the episodes still running in the group.

        Returns:
            NumPy record, batch first, as long as the longest episode.
        """
        if not tasks:
            raise InputError("No tasks were given; give at least one.")
        if faults is not None and len(faults) != len(tasks):
            raise InputError(f"{len(tasks)} tasks came with {len(faults)} faults; give one each, or none at all.")
        conditions = sample_conditions(self.navigator.walker.robot, self._disturbances, len(tasks), seed)
        faults = [make_faults()] * len(tasks) if faults is None else faults
        parts: list[EpisodeRecord] = []
        done = 0.0
        for first in range(0, len(tasks), self.width):
            # The last group is filled up with repetitions of the last task.
            rows = np.minimum(first + np.arange(self.width), len(tasks) - 1)
            own = min(self.width, len(tasks) - first)
            group_tasks = stack_tasks([tasks[k] for k in rows])
            group_conditions = place_at(jax.tree.map(lambda leaf, rows=rows: leaf[rows], conditions), group_tasks.start)
            group_faults = jax.tree.map(lambda *leaves: jnp.stack(leaves), *[faults[k] for k in rows])
            record = self._group(group_tasks, group_conditions, group_faults, partial(_report, on_progress, done, own))
            parts.append(jax.tree.map(lambda leaf, count=own: leaf[:count], record))
            done += own * record.time.shape[1] * self.navigator.frame_time
        longest = max(part.time.shape[1] for part in parts)
        parts = [jax.tree.map(lambda leaf: _lengthened(leaf, longest), part) for part in parts]
        return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)

    def _group(
        self,
        tasks: TaskArrays,
        conditions: Conditions,
        faults: Faults,
        on_progress: Callable[[float, int], None],
    ) -> EpisodeRecord:
        began = time.perf_counter()
        tasks, conditions, faults = jax.device_put((tasks, conditions, faults), self._chunk.sharded)
        state = self._start(self.navigator, tasks, conditions)
        chunk = self._chunk.compiled(self.navigator, tasks, conditions, faults, state)
        self.compile_seconds += time.perf_counter() - began
        began = time.perf_counter()
        records: list[EpisodeRecord] = []
        wanted = math.ceil(float(jnp.max(tasks.time_limit)) / self.navigator.frame_time) + 1
        while sum(record.time.shape[1] for record in records) < wanted:
            state, record = chunk(self.navigator, tasks, conditions, faults, state)
            records.append(jax.tree.map(np.asarray, record))
            running = int(np.sum(records[-1].outcome[:, -1] == Outcome.RUNNING))
            on_progress(len(records) * self.frames * self.navigator.frame_time, running)
            if running == 0:
                break
        self.run_seconds += time.perf_counter() - began
        return jax.tree.map(lambda *leaves: np.concatenate(leaves, axis=1), *records)


@jax.vmap
def place_at(conditions: Conditions, start: Float[Array, "3"]) -> Conditions:
    """Conditions whose robots stand at (x [m], y [m], yaw [rad]) instead of at the origin, batch first."""
    qpos, qvel, yaw = conditions.qpos, conditions.qvel, start[2]
    turned = turn_about_vertical(qpos[3:7], yaw)
    return conditions._replace(
        qpos=jnp.concatenate([to_world(start, qpos[:2]), qpos[2:3], turned, qpos[7:]]).astype(qpos.dtype),
        qvel=jnp.concatenate([turn(yaw, qvel[:2]), qvel[2:]]).astype(qvel.dtype),
    )


def _lengthened(leaf: np.ndarray, length: int) -> np.ndarray:
    """A record's leaf with its last frame repeated up to a length."""
    missing = length - leaf.shape[1]
    return leaf if missing == 0 else np.concatenate([leaf, np.repeat(leaf[:, -1:], missing, axis=1)], axis=1)


def _report(on_progress: Callable[[float, int], None], done: float, own: int, seconds: float, running: int) -> None:
    """Progress within a group of `own` episodes, after `done` robot-seconds of earlier ones."""
    on_progress(done + own * seconds, min(running, own))

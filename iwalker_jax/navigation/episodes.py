"""Many episodes: one compiled program for rows of robots and a stretch of time, over all devices.

Where an episode has ended, the next one begins in its row between two stretches, so that no row waits for the others.
Rows know nothing of each other, but a processor may round differently from row to row: task k of a batch is always
walked in row k (modulo their number), so that its record is the same bit for bit whatever is walked before and beside.
"""

import functools
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import to_world, turn, turn_about_vertical
from iwalker_jax.navigation.closed_loop import LoopState, Navigator, run_episode, start_episode
from iwalker_jax.navigation.faults import Faults, make_faults
from iwalker_jax.navigation.record import EpisodeRecord, Outcome
from iwalker_jax.runtime.devices import ShardedProgram, chosen_devices
from iwalker_jax.scenes import SceneCapacity, common_capacity
from iwalker_jax.tasks import Task, TaskArrays, stack_tasks
from iwalker_jax.walking import Conditions, Disturbances, sample_conditions

_CHUNK = 2.0  # [s] of simulated time in one call


class TaskBatch(NamedTuple):
    """Tasks whose robots are drawn from one seed.

    Attributes:
        tasks: to walk; task k meets the conditions of robot k of the seed.
        seed: of conditions, sensors and depth noise.
        faults: one a task; None for none.
    """

    tasks: Sequence[Task]
    seed: int = 0
    faults: Sequence[Faults] | None = None


class RunProgress(NamedTuple):
    """How far a run is.

    Attributes:
        seconds: [s] simulated so far, summed over the robots that were under way.
        ended: episodes that have; running: those that are under way.
    """

    seconds: float
    ended: int
    running: int


class _Episode(NamedTuple):
    """An episode that is to be walked: which of which batch, and what it begins with."""

    batch: int
    number: int
    task: Task
    conditions: Conditions
    faults: Faults


_Arguments = tuple[TaskArrays, Conditions, Faults]


class EpisodeProgram:
    """Episodes of one navigator, compiled once; any number of them is walked, so many at a time."""

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
        self._chunk = ShardedProgram(
            functools.partial(run_episode, frames=self.frames, images=images), chosen_devices(devices)
        )
        self.width = self._chunk.round_up(width)
        self.navigator = jax.device_put(navigator, self._chunk.replicated)
        many = jax.vmap(start_episode, in_axes=(None, 0, 0))
        self._start = jax.jit(many, out_shardings=self._chunk.sharded)
        # Apart from the start itself, so that a start is computed alike whoever is under way.
        self._take_over = jax.jit(jax.vmap(_where), out_shardings=self._chunk.sharded)

    def run(
        self,
        tasks: Sequence[Task],
        seed: int = 0,
        faults: Sequence[Faults] | None = None,
        on_progress: Callable[[float, int], None] = lambda seconds, running: None,
    ) -> EpisodeRecord:
        """Walk all tasks to their ends; task k meets the conditions of robot k of the seed.

        Args:
            tasks: to walk.
            seed: of conditions, sensors and depth noise.
            faults: one a task; none by default.
            on_progress: hears of the robot-seconds simulated so far, and of the episodes that are under way.

        Returns:
            NumPy record, batch first, as long as the longest episode.
        """

        def report(progress: RunProgress) -> None:
            on_progress(progress.seconds, progress.running)

        ((_, record),) = self.run_batches([TaskBatch(tasks, seed, faults)], report)
        return record

    def run_batches(
        self, batches: Sequence[TaskBatch], on_progress: Callable[[RunProgress], None] = lambda progress: None
    ) -> Iterator[tuple[int, EpisodeRecord]]:
        """Walk the tasks of all batches to their ends, and hand out each batch when all of its episodes have ended.

        A later batch may come before an earlier one of which an episode takes longer.

        Args:
            batches: to walk.
            on_progress: hears how far the run is.

        Returns:
            Number of a batch and its NumPy record, batch first, as long as its longest episode; each as soon as it is
            there.
        """
        for tasks, _, faults in batches:
            if not tasks:
                raise InputError("No tasks were given; give at least one.")
            if faults is not None and len(faults) != len(tasks):
                raise InputError(f"{len(tasks)} tasks came with {len(faults)} faults; give one each, or none at all.")
        capacity = common_capacity([task.scene for batch in batches for task in batch.tasks])
        return self._whole_batches(batches, capacity, on_progress)

    def _whole_batches(
        self, batches: Sequence[TaskBatch], capacity: SceneCapacity, on_progress: Callable[[RunProgress], None]
    ) -> Iterator[tuple[int, EpisodeRecord]]:
        waiting: dict[int, dict[int, EpisodeRecord]] = {}
        for episode, record in self._walked(self._queues(batches), capacity, on_progress):
            own = waiting.setdefault(episode.batch, {})
            own[episode.number] = record
            if len(own) == len(batches[episode.batch].tasks):
                whole = _stacked([own[number] for number in sorted(own)])
                # Images of many frames need not be in memory twice.
                own.clear()
                yield episode.batch, whole

    def _queues(self, batches: Sequence[TaskBatch]) -> list[Iterator[_Episode]]:
        """The episodes of every row, in the order of the batches."""

        @functools.cache
        def conditions_of(number: int) -> Conditions:
            batch = batches[number]
            return sample_conditions(self.navigator.walker.robot, self._disturbances, len(batch.tasks), batch.seed)

        def queue(row: int) -> Iterator[_Episode]:
            for number, batch in enumerate(batches):
                for k in range(row, len(batch.tasks), self.width):
                    conditions = jax.tree.map(lambda leaf, k=k: leaf[k], conditions_of(number))
                    faults = make_faults() if batch.faults is None else batch.faults[k]
                    yield _Episode(number, k, batch.tasks[k], conditions, faults)

        return [queue(row) for row in range(self.width)]

    def _walked(
        self,
        queues: Sequence[Iterator[_Episode]],
        capacity: SceneCapacity,
        on_progress: Callable[[RunProgress], None],
    ) -> Iterator[tuple[_Episode, EpisodeRecord]]:
        """Episodes with their records as they end; where one has ended, the next in the row's queue begins."""
        began = time.perf_counter()
        first = [next(queue, None) for queue in queues]
        under_way = np.array([episode is not None for episode in first])
        # Rows without an episode of their own walk another's, and nobody looks at them.
        spare = next(episode for episode in first if episode is not None)
        rows = [spare if episode is None else episode for episode in first]
        arguments, state = self._begun(rows, capacity, np.ones(self.width, bool), None)
        chunk = self._chunk.compiled(self.navigator, *arguments, state)
        self.compile_seconds += time.perf_counter() - began
        parts: list[list[EpisodeRecord]] = [[] for _ in rows]
        progress = RunProgress(0.0, 0, 0)
        while under_way.any():
            began = time.perf_counter()
            state, record = chunk(self.navigator, *arguments, state)
            record = jax.tree.map(np.asarray, record)
            seconds = progress.seconds + int(under_way.sum()) * self.frames * self.navigator.frame_time
            ended: list[tuple[_Episode, EpisodeRecord]] = []
            begins = np.zeros(self.width, bool)
            for k in np.flatnonzero(under_way).tolist():
                # A copy, because a view would keep the records of all rows in memory.
                parts[k].append(jax.tree.map(lambda leaf, k=k: leaf[k].copy(), record))
                if record.outcome[k, -1] == Outcome.RUNNING:
                    continue
                ended.append((rows[k], _until_end(parts[k])))
                parts[k] = []
                following = next(queues[k], None)
                under_way[k] = begins[k] = following is not None
                rows[k] = rows[k] if following is None else following
            if begins.any():
                arguments, state = self._begun(rows, capacity, begins, state)
            self.run_seconds += time.perf_counter() - began
            progress = RunProgress(seconds, progress.ended + len(ended), int(under_way.sum()))
            on_progress(progress)
            yield from ended

    def _begun(
        self, rows: Sequence[_Episode], capacity: SceneCapacity, begins: Bool[np.ndarray, " n"], state: LoopState | None
    ) -> tuple[_Arguments, LoopState]:
        """Arguments of all rows, and their states: fresh ones where an episode begins, the others as they are."""
        tasks = stack_tasks([row.task for row in rows], capacity)
        conditions, faults = (
            jax.tree.map(lambda *leaves: jnp.stack(leaves), *inputs)
            for inputs in ([row.conditions for row in rows], [row.faults for row in rows])
        )
        conditions = place_at(conditions, tasks.start)
        tasks, conditions, faults = jax.device_put((tasks, conditions, faults), self._chunk.sharded)
        fresh = self._start(self.navigator, tasks, conditions)
        chosen = jax.device_put(begins, self._chunk.sharded)
        return (tasks, conditions, faults), self._take_over(chosen, fresh, fresh if state is None else state)


@jax.vmap
def place_at(conditions: Conditions, start: Float[Array, "3"]) -> Conditions:
    """Conditions whose robots stand at (x [m], y [m], yaw [rad]) instead of at the origin, batch first."""
    qpos, qvel, yaw = conditions.qpos, conditions.qvel, start[2]
    turned = turn_about_vertical(qpos[3:7], yaw)
    return conditions._replace(
        qpos=jnp.concatenate([to_world(start, qpos[:2]), qpos[2:3], turned, qpos[7:]]).astype(qpos.dtype),
        qvel=jnp.concatenate([turn(yaw, qvel[:2]), qvel[2:]]).astype(qvel.dtype),
    )


def _where(chosen: Bool[Array, ""], one: LoopState, other: LoopState) -> LoopState:
    """One state where it is chosen, else the other."""
    return jax.tree.map(lambda a, b: jnp.where(chosen, a, b), one, other)


def _until_end(parts: Sequence[EpisodeRecord]) -> EpisodeRecord:
    """An episode's record from those of its stretches, up to and with the frame in which it ended."""
    whole: EpisodeRecord = jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)
    frames = int(np.argmax(whole.outcome != Outcome.RUNNING)) + 1
    return jax.tree.map(lambda leaf: leaf[:frames], whole)


def _stacked(records: Sequence[EpisodeRecord]) -> EpisodeRecord:
    """Records of several episodes in one, batch first; shorter ones repeat their last frame."""
    longest = max(len(record.outcome) for record in records)
    frames = [np.minimum(np.arange(longest), len(record.outcome) - 1) for record in records]
    return jax.tree.map(
        lambda *leaves: np.stack([leaf[index] for leaf, index in zip(leaves, frames, strict=True)]), *records
    )

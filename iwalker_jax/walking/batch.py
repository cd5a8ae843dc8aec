"""Many robots' walks on MJX: one compiled program for any number of robots and any duration, over all devices."""

import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from iwalker_jax.control import FootstepPlan, GaitMode
from iwalker_jax.errors import InputError
from iwalker_jax.runtime.devices import ShardedProgram, chosen_devices
from iwalker_jax.walking.rollout import Conditions, Sample, Walker, WalkState, roll_out, start_walk

LARGEST_GROUP = 256
"""Robots that are simulated at once; more go in groups, so that memory stays bounded."""
_AT_REST = 0.5  # [s] of standing after the last footstep that counts as finished


class BrokenRow(NamedTuple):
    """A robot whose state turned non-finite, with what replays it.

    Attributes:
        row: its index in the batch.
        conditions, plan: its own.
        state: its state some time before, at the start of a chunk.
        ticks: in which it then broke.
    """

    row: int
    conditions: Conditions
    plan: FootstepPlan
    state: WalkState
    ticks: int


class BatchResult(NamedTuple):
    """Outcome of a batch.

    Attributes:
        sample: NumPy record, (batch, time, ...).
        seconds: wall time of the run, compilation left out [s].
        compile_seconds: wall time of compiling and of placing the robots [s].
        broken: robots that turned non-finite.
    """

    sample: Sample
    seconds: float
    compile_seconds: float
    broken: tuple[BrokenRow, ...]

    @property
    def robot_seconds_per_second(self) -> float:
        """Simulated robot-seconds in one second of wall time."""
        robots, samples = self.sample.time.shape
        interval = float(self.sample.time[0, 1] - self.sample.time[0, 0]) if samples > 1 else 0.0
        return robots * samples * interval / max(self.seconds, 1e-9)


class WalkProgram:
    """Walks of a group of robots over one chunk of time, compiled once; runs of any size are made of such pieces."""

    def __init__(
        self,
        walker: Walker,
        width: int,
        rows: int,
        devices: int | None = None,
        chunk: float = 2.0,
        every: int = 10,
    ) -> None:
        """Decide the shapes; the compilation comes with the first run.

        Args:
            width: robots of a group, at most `LARGEST_GROUP`; rounded up to a multiple of the devices.
            rows: of the footstep plans.
            devices: number of this process's devices, all by default.
            chunk: [s] of simulated time in one call.
            every: ticks between two records.
        """
        if width < 1 or rows < 2:
            raise InputError(f"Groups of {width} robots and plans of {rows} rows; give at least 1 and 2.")
        self.rows, self.every = rows, every
        self.samples = max(round(chunk / (walker.controller.time_step * every)), 1)
        self._chunk = ShardedProgram(partial(roll_out, samples=self.samples, every=every), chosen_devices(devices))
        self.width = self._chunk.round_up(min(width, LARGEST_GROUP))
        # The walker's numbers are arguments, so that they are not compiled in.
        self.walker = jax.device_put(walker, self._chunk.replicated)
        self._start = jax.jit(jax.vmap(start_walk, in_axes=(None, 0)))

    def run(
        self,
        conditions: Conditions,
        plan: FootstepPlan,
        seconds: float,
        on_progress: Callable[[float, int], None] | None = None,
    ) -> BatchResult:
        """Walk; ends early, at the end of a chunk, once every robot lies or stands at its plan's end.

        Args:
            conditions: (batch, ...).
            plan: of all robots, or (batch, ...).
            seconds: [s] of simulated time.
            on_progress: hears of the simulated time [s] and of the robots still up.
        """
        robots = conditions.friction.shape[0]
        if plan.yaws.shape[-1] != self.rows:
            raise InputError(f"The plan has {plan.yaws.shape[-1]} rows, the program takes {self.rows}; pad the plan.")
        if plan.yaws.ndim == 1:
            plan = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (robots, *leaf.shape)), plan)
        interval = self.walker.controller.time_step * self.every
        wanted = max(round(seconds / interval), 1)
        began = time.perf_counter()
        groups = [self._group(conditions, plan, first) for first in range(0, robots, self.width)]
        compiled = self._chunk.compiled(self.walker, *groups[0])
        compile_seconds, began = time.perf_counter() - began, time.perf_counter()
        records: list[Sample] = []
        broken: dict[int, BrokenRow] = {}
        while sum(record.time.shape[1] for record in records) < wanted:
            pieces: list[Sample] = []
            for g, group in enumerate(groups):
                start = group.state
                state, sample = jax.block_until_ready(compiled(self.walker, *group))
                groups[g] = group._replace(state=state)
                piece = jax.tree.map(np.asarray, sample)
                pieces.append(piece)
                for k in np.flatnonzero(_turned_non_finite(piece)):
                    row = g * self.width + int(k)
                    if row < robots and row not in broken:
                        # Away from the mesh, so that it can be walked again on one device.
                        own = jax.device_put(
                            _take((group.conditions, group.plan, start), int(k)), jax.local_devices()[0]
                        )
                        robot, steps, before = own
                        broken[row] = BrokenRow(row, robot, steps, before, self.samples * self.every)
            record = jax.tree.map(lambda *parts: np.concatenate(parts)[:robots], *pieces)
            records.append(record)
            done = sum(r.time.shape[1] for r in records)
            if on_progress is not None:
                on_progress(min(done, wanted) * interval, int(np.sum(~record.fallen[:, -1])))
            if np.all(record.fallen[:, -1] | _at_rest(record, np.asarray(plan.count), interval)):
                break
        whole = jax.tree.map(lambda *parts: np.concatenate(parts, axis=1)[:, :wanted], *records)
        return BatchResult(whole, time.perf_counter() - began, compile_seconds, tuple(broken.values()))

    def _group(self, conditions: Conditions, plan: FootstepPlan, first: int) -> "_Group":
        """Robots from `first` on, the last one repeated to fill the group, placed on the devices."""
        index = jnp.minimum(first + jnp.arange(self.width), conditions.friction.shape[0] - 1)
        conditions, plan = _take((conditions, plan), index)
        state = self._start(self.walker, conditions)
        return jax.device_put(_Group(conditions, plan, state), self._chunk.sharded)


class _Group(NamedTuple):
    """Arguments of the program after the walker."""

    conditions: Conditions
    plan: FootstepPlan
    state: WalkState


@jax.jit
def _take(tree: tuple, index: Array | int) -> tuple:
    return jax.tree.map(lambda leaf: leaf[index], tree)


def _turned_non_finite(sample: Sample) -> Bool[np.ndarray, " batch"]:
    """Rows that hold NaN or infinity; a frozen robot repeats the tick that broke it, so it shows in the record."""
    parts = (sample.qpos, sample.com, sample.com_velocity, sample.torques, sample.forces)
    finite = [np.isfinite(part).reshape(len(part), -1).all(axis=1) for part in parts]
    return ~np.logical_and.reduce(finite)


def _at_rest(sample: Sample, count: np.ndarray, interval: float) -> Bool[np.ndarray, " batch"]:
    """Rows that have taken all their footsteps and stand; a robot without a plan is never done."""
    last = max(round(_AT_REST / interval), 1)
    stands = np.all(sample.mode[:, -last:] == GaitMode.STAND, axis=1)
    return stands & (count > 0) & (sample.step[:, -1] >= count)

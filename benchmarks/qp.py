"""General QPs of a walking humanoid, beside quadprog, DAQP, ProxQP, OSQP, qpax, Moreau and MPAX; Clarabel judges.

Run with `python -m benchmarks.qp`; `--devices 2` spreads batches over two host devices, `--file stack.npz` reads logged
programs (stacked P, q, C, low, high as written by `QuadraticProgram.save`, one robot, in time order).
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from benchmarks.suite.extras import absent, require
from iwalker_jax.runtime.settings import configure_runtime, requested_devices

if __name__ == "__main__":
    configure_runtime(requested_devices(sys.argv))
require("clarabel", "scipy")

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import tyro  # noqa: E402
from jax.sharding import Mesh, PartitionSpec  # noqa: E402

from benchmarks.peers.qp_solvers import IN_BATCHES, ONE_BY_ONE, PACKAGES, Peer, Programs, clarabel_points  # noqa: E402
from benchmarks.problems.hard_qps import hard_qps  # noqa: E402
from benchmarks.problems.whole_body_qps import whole_body_qps  # noqa: E402
from benchmarks.suite.alone import Options, present  # noqa: E402
from benchmarks.suite.contest import Contender, contest  # noqa: E402
from benchmarks.suite.figures import Fact, Group, Work  # noqa: E402
from iwalker_jax.optimization import (  # noqa: E402
    QpPoint,
    QpSettings,
    QuadraticProgram,
    Solution,
    Status,
    cold_start,
    control_settings,
    load_program,
    solve_qp,
)


@dataclass(frozen=True)
class Config(Options):
    """Time QPs one by one and in batches, and judge the answers.

    Attributes:
        devices: host devices to spread batches over.
        file: logged programs to use instead of generated ones.
        batches: robots whose programs are solved side by side.
        ticks: programs of a robot; 50 with --quick.
    """

    devices: int = 1
    file: Path | None = None
    batches: tuple[int, ...] = (16, 64, 256)
    ticks: int = 250


def walk_tick(settings: QpSettings, guesses: QpPoint, problems: QuadraticProgram) -> tuple[QpPoint, Solution]:
    """One tick of one robot, or of a batch."""
    solve = partial(solve_qp, settings=settings, gradient="stopped")
    solution = solve(problems, guesses) if problems.q.ndim == 1 else jax.vmap(solve)(problems, guesses)
    return solution.value, solution


def scan_walk(stack: QuadraticProgram, batch: int, settings: QpSettings) -> Callable[[], Solution]:
    """A scan over time; robots of a batch start at different times of the log and go round.

    All read the one log, as the peers do: a copy for every robot would time the memory instead.
    """
    length = stack.q.shape[0]
    offsets = jnp.arange(batch) * length // batch
    first = jax.tree.map(lambda a: a[offsets], stack)
    start = jax.vmap(cold_start)(first)
    if batch == 1:
        offsets, start = offsets[0], jax.tree.map(lambda a: a[0], start)

    def walk(start: QpPoint, offsets: jax.Array, stack: QuadraticProgram) -> Solution:
        def tick(guesses: QpPoint, t: jax.Array) -> tuple[QpPoint, Solution]:
            return walk_tick(settings, guesses, jax.tree.map(lambda a: a[(t + offsets) % length], stack))

        return jax.lax.scan(tick, start, jnp.arange(length))[1]

    if batch >= 2 * jax.device_count() > 2:
        mesh = Mesh(np.asarray(jax.devices()), ("robots",))
        robots, ticks = PartitionSpec("robots"), PartitionSpec(None, "robots")
        walk = jax.shard_map(
            walk, mesh=mesh, in_specs=(robots, robots, PartitionSpec()), out_specs=ticks, check_vma=False
        )
    return partial(jax.jit(walk), start, offsets, stack)


class Judge:
    """Errors of points (T, n) of the programs, or of their first ones, beside an interior-point method's.

    The objective's gap is relative to the optimum's size, the violation to the largest variable, and the error of the
    torques, which are what a walk uses of a solution, to the largest torque of its program.
    """

    def __init__(self, programs: Programs, torque_map: np.ndarray, torque_offset: np.ndarray) -> None:
        self._programs, self._map, self._offset = programs, torque_map, torque_offset
        self._exact = clarabel_points(programs)

    def __call__(self, points: np.ndarray) -> dict[str, float]:
        count = len(points)
        programs = Programs(*(leaf[:count] for leaf in self._programs))
        exact, rows = self._exact[:count], self._map[:count]
        best = programs.objective(exact)
        gap = np.abs(programs.objective(points) - best) / np.maximum(np.abs(best), 1.0)
        outside = programs.violation(points) / np.max(np.abs(points), axis=1)
        torque = np.max(np.abs(np.einsum("tij,tj->ti", rows, exact) + self._offset[:count]), axis=1)
        error = np.max(np.abs(np.einsum("tij,tj->ti", rows, points - exact)), axis=1) / torque
        return {
            "worst gap": float(gap.max()),
            "worst violation": float(outside.max()),
            "torque error, 99 %": float(np.quantile(error, 0.99)),
            "torque error, worst": float(error.max()),
        }

    def ours(self, solution: Solution) -> dict[str, float]:
        """Errors of a roll-out's points: of its first robot, which begins at the beginning."""
        x = np.asarray(solution.value.x, float)
        return self(x if x.ndim == 2 else x[:, 0])


def least_work(programs: Programs, side_by_side: int) -> Work:
    """One factorisation of P, one reading of the program, and its share of a step of the loop over time."""
    n, m = programs.q.shape[1], programs.low.shape[1]
    return Work(n**3 / 3, 4.0 * (n * n + n + m * n + 2 * m), 1 / side_by_side)


def peers_of(table: dict[str, Peer], programs: Programs, judge: Judge) -> Iterator[Contender]:
    """Those that are installed."""
    for name, peer in table.items():
        if find_spec(peer.module) is not None:
            given = Programs(*(leaf[: peer.most] for leaf in programs)) if peer.most else programs
            yield Contender(name, "peer", peer.make(given), len(given.q), judge, compiles=peer.compiles)


def compare(
    name: str, programs: Programs, torque_map: np.ndarray, offset: np.ndarray, config: Config
) -> Iterator[Group]:
    """Programs one by one, in time order, and in batches."""
    length, n = programs.q.shape
    size = f"{n} variables, {programs.low.shape[1]} rows"
    judge = Judge(programs, torque_map, offset)
    P, q, C, low, high = (jnp.asarray(leaf, jnp.float32) for leaf in programs)
    stack = QuadraticProgram(P, q, C, low, high)
    repeats = 5 if config.quick else 9
    alone = [
        Contender(f"ours, {label}", "ours", scan_walk(stack, 1, settings), length, judge.ours, least_work(programs, 1))
        for label, settings in (("control", control_settings()), ("default", QpSettings()))
    ]
    yield contest(
        f"{name}: {size}, one at a time, {length} in time order",
        "a QP",
        [*alone, *peers_of(ONE_BY_ONE, programs, judge)],
        repeats,
    )
    batches = config.batches[1:2] if config.quick else config.batches
    together = [
        Contender(
            f"ours, control, {batch} side by side",
            "ours",
            scan_walk(stack, batch, control_settings()),
            length * batch,
            judge.ours,
            least_work(programs, batch),
        )
        for batch in batches
    ]
    yield contest(
        f"{name}: {size}, many at once",
        "a QP",
        [*together, *peers_of(IN_BATCHES, programs, judge)],
        repeats,
    )


def hard_statuses(seeds: int) -> Iterator[Fact]:
    """How hard programs end, in single precision."""
    solve = jax.jit(solve_qp)
    ends: dict[str, list[str]] = {}
    for seed in range(seeds):
        for name, case in hard_qps(seed).items():
            P, q, C, low, high = (jnp.asarray(a, jnp.float32) for a in case[:5])
            ends.setdefault(f"{name} ({case.outcome})", []).append(
                Status(int(solve(QuadraticProgram(P, q, C, low, high)).status)).name.lower()
            )
    for name, found in ends.items():
        for status in sorted(set(found)):
            yield Fact(f"hard program, {name}: {status}", found.count(status), f"of {seeds}")


def measure(config: Config) -> Iterator[Group | Fact]:
    """All figures of this benchmark."""
    ticks = min(config.ticks, 50) if config.quick else config.ticks
    if config.file is not None:
        stack = load_program(config.file)
        programs = Programs(*(leaf[:ticks].astype(float) for leaf in stack.arrays()))
        start = sum(count for name, count in stack.blocks if name != "torque") if stack.blocks else 0
        rows = programs.C[:, start:]
        yield from compare(config.file.name, programs, rows, np.zeros(rows.shape[:2]), config)
        return
    kinds = {"whole body, base eliminated": True, "whole body, base kept": False}
    for name, eliminate in list(kinds.items())[: 1 if config.quick else 2]:
        walk = whole_body_qps(ticks, eliminate=eliminate)
        programs = Programs(walk.P, walk.q, walk.C, walk.low, walk.high)
        yield from compare(name, programs, walk.torque_map, walk.torque_offset, config)
    if not config.quick:
        yield from hard_statuses(10)


if __name__ == "__main__":
    options = tyro.cli(Config, description=__doc__)
    present(measure(options), options, absent(PACKAGES))

"""Closed-loop episodes made by hand, for the tests of their metrics, tables, pictures and films."""

import numpy as np

from bruce_model import crouch_qpos
from iwalker_jax.geometry import Side
from iwalker_jax.navigation.episodes import RunProgress
from iwalker_jax.navigation.record import EpisodeRecord, Outcome
from iwalker_jax.planning import MapCell
from iwalker_jax.scenes.scene import Scene
from iwalker_jax.tasks.task import Task

FRAME = 1.0 / 15.0
"""[s] between camera frames."""


def room(name: str = "room") -> Scene:
    """A room of 6 m x 4 m with a partition in its middle, a low bench, a beam overhead and a column."""
    walls = [
        [3.0, -0.05, 0.75, 3.1, 0.05, 0.75, 0.0],
        [3.0, 4.05, 0.75, 3.1, 0.05, 0.75, 0.0],
        [-0.05, 2.0, 0.75, 0.05, 2.0, 0.75, 0.0],
        [6.05, 2.0, 0.75, 0.05, 2.0, 0.75, 0.0],
    ]
    inside = [
        [3.0, 1.0, 0.6, 0.05, 1.0, 0.6, 0.0],
        [4.6, 3.5, 0.2, 0.5, 0.2, 0.2, 0.4],
        [1.0, 2.0, 1.4, 0.1, 2.0, 0.1, 0.0],
    ]
    return Scene(name, "test", np.array(walls + inside), np.array([[1.6, 3.2, 0.5, 0.15, 0.5]]), (0, 0, 6, 4), 2.4)


def make_task(name: str = "room-0", goals: tuple[tuple[float, float], ...] = ((5.0, 1.0),)) -> Task:
    """Around the partition, from (1, 1) to (5, 1) by default."""
    return Task(name, room(), (1.0, 1.0, 0.0), np.array(goals), time_limit=60.0)


def along(corners: np.ndarray, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """(frames, 2) evenly spaced places on a polyline, and (frames,) headings."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    at = np.linspace(0.0, lengths[-1], frames)
    places = np.stack([np.interp(at, lengths, corners[:, k]) for k in (0, 1)], axis=1)
    step = np.gradient(places, axis=0)
    return places, np.unwrap(np.arctan2(step[:, 1], step[:, 0]))


def make_record(
    corners: tuple[tuple[float, float], ...] = ((1.0, 1.0), (3.0, 2.7), (5.0, 1.0)),
    outcomes: tuple[Outcome, ...] = (Outcome.REACHED,),
    seconds: float = 20.0,
    sway: float = 0.015,
    images: bool = False,
) -> EpisodeRecord:
    """Episodes along one polyline in `seconds`; each ends two frames before the record's end."""
    n = round(seconds / FRAME) + 1
    time = np.arange(n) * FRAME
    places, heading = along(np.asarray(corners), n)
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    base = np.column_stack([places + sway * np.sin(2 * np.pi * 2.1 * time)[:, None] * left, heading])
    qpos = np.tile(crouch_qpos(), (n, 1))
    qpos[:, :2] = base[:, :2]
    qpos[:, 3], qpos[:, 6] = np.cos(heading / 2), np.sin(heading / 2)
    qpos[:, 4:6] = 0.0
    feet = np.concatenate([_standing(places - 0.05 * left, 0), _standing(places + 0.05 * left, 2)], axis=1)
    path = np.stack([np.linspace(p, np.asarray(corners[-1]), 20) for p in places])
    steps = np.stack([path[:, i] + 0.045 * (-1) ** i * left for i in range(1, 9)], axis=1)
    outcome = np.zeros((len(outcomes), n), int)
    for row, ends in enumerate(outcomes):
        outcome[row, -3:] = ends
    shape = (90, 160) if images else (0, 0)
    depth = np.broadcast_to(np.linspace(0.0, 5.0, shape[0])[:, None], shape).astype(np.float16)
    cells = np.full((160, 160) if images else (0, 0), MapCell.UNSEEN, np.int8)
    cells[70:100, 40:110] = MapCell.FREE
    cells[90:100, 60:100] = MapCell.OCCUPIED
    one = EpisodeRecord(
        time=time,
        outcome=outcome[0],
        goal=np.zeros(n, int),
        qpos=qpos,
        base=base,
        believed=np.concatenate([base[:1], base[:-1]]),  # at the frame's beginning
        feet=feet.reshape(n, 2, 3),
        path=path,
        footsteps=steps,
        first_side=np.full(n, Side.RIGHT),
        clearance=0.3 + 0.1 * np.cos(time),
        stopped=np.zeros(n, bool),
        detour=np.arange(n) % 4 == 0,
        torque_share=np.full(n, 0.5),
        qp_failures=np.zeros(n, int),
        depth=np.broadcast_to(depth, (n, *shape)),
        cells=np.broadcast_to(cells, (n, *cells.shape)),
    )
    batch = EpisodeRecord(*(np.repeat(part[None], len(outcomes), axis=0) for part in one))
    # A finished episode repeats its last row.
    for part in batch:
        part[:, -2:] = part[:, -3:-2]
    return batch._replace(outcome=outcome)


def _standing(track: np.ndarray, shift: int) -> np.ndarray:
    """(n, 3) a foot that stands for seven frames and then steps to where its track has come."""
    held = np.arange(len(track)) + shift
    held = np.clip(held - held % 8, 0, len(track) - 1)
    return np.column_stack([track[held], np.zeros(len(track))])


class StubProgram:
    """Walks every task straight to its goals, but each third into an obstacle; counts its runs."""

    def __init__(self, images: bool = False, log: list | None = None) -> None:
        self.images, self.log = images, [] if log is None else log
        self.compile_seconds = 0.0

    def run(self, tasks, seed=0, *, on_progress=lambda seconds, running: None) -> EpisodeRecord:
        self.log.append((len(tasks), seed))
        parts = []
        for number, task in enumerate(tasks):
            outcome = Outcome.COLLIDED if number % 3 == 2 else Outcome.REACHED
            corners = (task.start[:2], *task.goals)
            parts.append(make_record(corners, (outcome,), seconds=4.0, images=self.images))
            on_progress(4.0 * (number + 1), len(tasks) - number - 1)
        return EpisodeRecord(*(np.concatenate(leaves) for leaves in zip(*parts)))

    def run_batches(self, batches, on_progress=lambda progress: None):
        ended = 0
        for number, batch in enumerate(batches):
            record = self.run(batch.tasks, batch.seed)
            ended += len(batch.tasks)
            on_progress(RunProgress(4.0 * ended, ended, 0))
            yield number, record

"""Tasks with names: the three demonstrations, the routes of the four test sequences, and the hard rooms."""

import math

import numpy as np

from iwalker_jax.checks import require_whole
from iwalker_jax.errors import InputError
from iwalker_jax.scenes import (
    DEMONSTRATION_NAMES,
    HARD_ROOM_NAMES,
    SEQUENCE_NAMES,
    Scene,
    demonstration_scene,
    hard_room,
    held_out_sequence,
)
from iwalker_jax.streams import NAMED_TASKS
from iwalker_jax.tasks.routes import clearances, leg_lengths, single_precision, time_limit
from iwalker_jax.tasks.task import Task

ROOM_TASK_NAMES: tuple[str, ...] = tuple(f"room_{name}" for name in HARD_ROOM_NAMES)
"""Tasks in hard rooms, some of which cannot be walked through."""

TASK_NAMES: tuple[str, ...] = (
    *DEMONSTRATION_NAMES,
    *(f"test_{name}" for name in SEQUENCE_NAMES),
    *ROOM_TASK_NAMES,
)
"""All names that `named_task` takes."""

START_CLEARANCE, GOAL_CLEARANCE = 0.35, 0.30
"""[m] in plan view between obstacles and the base at the start and at goals: room to start and to stand."""

_ATTEMPTS = 20
_ROOM_TIME = 60.0


def named_task(name: str, seed: int = 0) -> Task:
    """The task of a name in `TASK_NAMES`.

    Raises:
        InputError: for an unknown name or a negative seed.
    """
    if name not in TASK_NAMES:
        raise InputError(f"Unknown task {name!r}; choose one of {', '.join(TASK_NAMES)}.")
    if name in DEMONSTRATION_NAMES:
        return demonstration(name, seed)
    if name in ROOM_TASK_NAMES:
        return room_task(name.removeprefix("room_"), seed)
    return sequence_task(name.removeprefix("test_"), seed)


def demonstration(name: str, seed: int = 0) -> Task:
    """The demonstration of a name in `DEMONSTRATION_NAMES`: "factory" (three goals), "corridor" or "office".

    Args:
        name: of the demonstration.
        seed: moves the start by up to 5 cm and 5 degrees, and small clutter; a route always remains.

    Raises:
        InputError: for an unknown name or a negative seed.
    """
    for rng in _generators(name, seed):
        design = demonstration_scene(name, rng)
        start = (design.start.x, design.start.y, design.start.yaw)
        length = tour_length(design.scene, start, design.goals)
        if length is not None:
            return Task(name, design.scene, start, design.goals, time_limit(length))
    raise RuntimeError(f"Demonstration {name}: no arrangement of seed {seed} leaves a route; use another seed.")


def sequence_task(name: str, seed: int = 0) -> Task:
    """The test sequence of a name in `SEQUENCE_NAMES` as a task: from its route's first corner to its end.

    Args:
        name: of the test sequence.
        seed: moves the start by up to 5 cm and 5 degrees.

    Raises:
        InputError: for an unknown name or a negative seed.
    """
    sequence = held_out_sequence(name)
    (x, y), (ahead_x, ahead_y) = sequence.route[:2].tolist()
    goals = sequence.route[-1:]
    for rng in _generators(name, seed):
        shift = (rng.uniform(-1, 1, 3) * (0.05, 0.05, math.radians(5))).tolist()
        start = (x + shift[0], y + shift[1], math.atan2(ahead_y - y, ahead_x - x) + shift[2])
        length = tour_length(sequence.scene, start, goals)
        if length is not None:
            return Task(f"test_{name}", sequence.scene, start, goals, time_limit(length))
    raise RuntimeError(f"Test sequence {name}: no start of seed {seed} leaves a route; use another seed.")


def room_task(name: str, seed: int = 0) -> Task:
    """The hard room of a name in `HARD_ROOM_NAMES` as a task, whether there is a way or not.

    Args:
        name: of the room.
        seed: moves obstacles and start by up to 3 cm and 5 degrees.

    Raises:
        InputError: for an unknown name or a negative seed.
    """
    room = hard_room(name, _generators(f"room_{name}", seed)[0])
    start = (room.start.x, room.start.y, room.start.yaw)
    return Task(f"room_{name}", room.scene, start, room.goal[None], _ROOM_TIME)


def tour_length(scene: Scene, start: tuple[float, float, float], goals: np.ndarray) -> float | None:
    """Length [m] of the comfortable way from a start (x, y, yaw) to goals (G, 2) in turn.

    None if the start or a goal lacks clearance or cannot be reached.
    """
    arrays = single_precision(scene)
    stops = np.concatenate([[start[:2]], goals])
    spare = clearances(arrays, stops) - np.append(START_CLEARANCE, np.full(len(goals), GOAL_CLEARANCE))
    if spare.min() < 0:
        return None
    lengths = [length for length in leg_lengths(arrays, stops) if length is not None]
    return sum(lengths) if len(lengths) == len(goals) else None


def _generators(name: str, seed: int) -> list[np.random.Generator]:
    require_whole(seed, "A task's seed")
    if seed < 0:
        raise InputError(f"A task's seed must not be negative, got {seed}.")
    return [NAMED_TASKS.generator(*name.encode(), seed, attempt) for attempt in range(_ATTEMPTS)]

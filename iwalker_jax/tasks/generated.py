"""Unlimited tasks in generated scenes: something stands in between, and there is a way around it."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from iwalker_jax.checks import require_whole
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY, host
from iwalker_jax.scenes import FAMILIES, Scene, SceneArrays, generate_scene, held_out_scene
from iwalker_jax.streams import HELD_OUT_TASKS, TRAINING_TASKS, Stream
from iwalker_jax.tasks.named import GOAL_CLEARANCE, START_CLEARANCE
from iwalker_jax.tasks.routes import (
    clearances,
    comfortable_route,
    single_precision,
    time_limit,
)
from iwalker_jax.tasks.task import Task


@dataclass(frozen=True)
class TaskSampling:
    """Which pairs of start and goal make a task.

    Attributes:
        nearest, farthest: [m] straight-line distance between start and goal.
        blocked_clearance: [m] which the straight line must fall below somewhere.
        most_detour: route length over straight-line distance, at most.
        look_ahead: [m] of the route whose direction the start heading follows.
        heading_spread: [rad] largest departure of the start heading from it.
    """

    nearest: float = 2.0
    farthest: float = 6.0
    blocked_clearance: float = BODY.layout_radius
    most_detour: float = 2.0
    look_ahead: float = 0.7
    heading_spread: float = math.radians(35)

    def __post_init__(self) -> None:
        if not (0 < self.nearest < self.farthest and self.most_detour > 1 and self.look_ahead > 0):
            raise InputError(
                "TaskSampling needs 0 < nearest < farthest [m], most_detour > 1 and look_ahead > 0 [m]; correct them."
            )


_SCENES, _PAIRS, _ROUTES = 20, 400, 4


def generated_task(seed: int, sampling: TaskSampling = TaskSampling()) -> Task:
    """The held-out task of a seed, in a scene that training never shows; the same arguments give the same task.

    Raises:
        InputError: for a negative seed.
    """
    return _draw(f"unseen-{seed}", HELD_OUT_TASKS, seed, sampling, lambda rng: held_out_scene(int(rng.integers(2**31))))


def training_task(seed: int, sampling: TaskSampling = TaskSampling()) -> Task:
    """Like `generated_task`, in a scene of a training family.

    Raises:
        InputError: for a negative seed.
    """

    def scene(rng: np.random.Generator) -> Scene:
        return generate_scene(FAMILIES[rng.integers(len(FAMILIES))], int(rng.integers(2**31)))

    return _draw(f"training-{seed}", TRAINING_TASKS, seed, sampling, scene)


def generated_tasks(count: int, seed: int = 0, sampling: TaskSampling = TaskSampling()) -> list[Task]:
    """`generated_task` of `count` successive seeds.

    Raises:
        InputError: for a count below 1 or a negative seed.
    """
    if count < 1:
        raise InputError(f"Ask for at least one task, not {count}.")
    return [generated_task(seed + i, sampling) for i in range(count)]


def _draw(
    name: str, stream: Stream, seed: int, sampling: TaskSampling, scene_of: Callable[[np.random.Generator], Scene]
) -> Task:
    """A task from successive sub-seeds; scenes in which nothing stands between free places are passed over."""
    require_whole(seed, "A task's seed")
    if seed < 0:
        raise InputError(f"A task's seed must not be negative, got {seed}.")
    for attempt in range(_SCENES):
        rng = stream.generator(seed, attempt)
        scene = scene_of(rng)
        arrays = single_precision(scene)
        for start, goal in _blocked_pairs(arrays, rng, sampling):
            route = comfortable_route(arrays, start, goal)
            if route is None or host.polyline_length(route) > sampling.most_detour * math.dist(start, goal):
                continue
            yaw = _heading(route, sampling.look_ahead) + rng.uniform(-sampling.heading_spread, sampling.heading_spread)
            pose = (float(start[0]), float(start[1]), math.remainder(yaw, 2 * math.pi))
            return Task(name, scene, pose, goal[None], time_limit(host.polyline_length(route)))
    raise RuntimeError(f"Task {name}: none of {_SCENES} scenes has a start and a goal that obey {sampling}.")


def _blocked_pairs(arrays: SceneArrays, rng: np.random.Generator, sampling: TaskSampling) -> Float[np.ndarray, "n 2 2"]:
    """A few random starts and goals with room around them and something in between."""
    bounds = np.asarray(arrays.bounds, np.float64)
    pairs = rng.uniform(bounds[:2], bounds[2:], size=(_PAIRS, 2, 2))
    # Every whole line is measured at once: the same shapes for every scene.
    fractions = np.linspace(0.0, 1.0, 65)[:, None]
    lines = pairs[:, :1] + fractions * (pairs[:, 1:] - pairs[:, :1])
    clearance = clearances(arrays, lines)
    distance = np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1)
    fits = (
        (clearance[:, 0] >= START_CLEARANCE)
        & (clearance[:, -1] >= GOAL_CLEARANCE)
        & (clearance.min(axis=1) < sampling.blocked_clearance)
        & (distance >= sampling.nearest)
        & (distance <= sampling.farthest)
    )
    return pairs[fits][:_ROUTES]


def _heading(route: Float[np.ndarray, "n 2"], ahead: float) -> float:
    """Direction [rad] from a route's start to the point `ahead` [m] along it."""
    x, y = host.points_along(route, ahead) - route[0]
    return math.atan2(y, x)

"""What a robot is asked to do in an episode."""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from iwalker_jax.arrays import as_doubles
from iwalker_jax.errors import InputError
from iwalker_jax.scenes import Scene, SceneArrays, SceneCapacity, stack_scenes

GOAL_CAPACITY = 6
"""Goals of one task at most, so that the tasks of a batch have one shape."""

LONGEST_EPISODE = 86_400.0
"""[s] of a task's time limit at most."""


@dataclass(frozen=True, eq=False)
class Task:
    """A scene to walk in and the goals to visit one after the other.

    Attributes:
        name: of the row in tables.
        scene: where.
        start: (x [m], y [m], yaw [rad]) of the robot.
        goals: (G, 2) [m] world frame, 1 to `GOAL_CAPACITY`.
        time_limit: [s], at most `LONGEST_EPISODE`.
    """

    name: str
    scene: Scene
    start: tuple[float, float, float]
    goals: np.ndarray
    time_limit: float = 60.0

    def __post_init__(self) -> None:
        if not isinstance(self.scene, Scene):
            raise InputError(f"Task {self.name}: the scene is a {type(self.scene).__name__}; give a Scene.")
        goals, start = (as_doubles(getattr(self, name), f"Task {self.name}: {name}") for name in ("goals", "start"))
        if goals.ndim != 2 or goals.shape[1:] != (2,) or not 1 <= len(goals) <= GOAL_CAPACITY:
            raise InputError(
                f"Task {self.name}: goals have shape {goals.shape}; give 1 to {GOAL_CAPACITY} rows of x, y in metres."
            )
        if not (np.isfinite(goals).all() and np.isfinite(start).all() and start.shape == (3,)):
            raise InputError(f"Task {self.name}: start and goals must be finite; the start is x, y [m] and yaw [rad].")
        seconds = as_doubles(self.time_limit, f"Task {self.name}: the time limit")
        if seconds.shape != () or not 0 < seconds <= LONGEST_EPISODE:
            raise InputError(
                f"Task {self.name}: the time limit must be positive and at most {LONGEST_EPISODE:g} s, got "
                f"{self.time_limit} s."
            )
        goals.setflags(write=False)
        object.__setattr__(self, "goals", goals)


class TaskArrays(NamedTuple):
    """Tasks as arrays of one shape; a pytree.

    Attributes:
        scene: with the batch axis first.
        start: (3,) x, y [m], yaw [rad].
        goals: (GOAL_CAPACITY, 2) [m] world; the last one repeated.
        goal_count: () int32.
        time_limit: () [s].
    """

    scene: SceneArrays
    start: Float[Array, "*batch 3"]
    goals: Float[Array, "*batch g 2"]
    goal_count: Int[Array, "*batch"]
    time_limit: Float[Array, "*batch"]


def stack_tasks(tasks: list[Task], capacity: SceneCapacity | None = None) -> TaskArrays:
    """The arrays of several tasks, batch first; their scenes have the shape of a capacity, as in `stack_scenes`."""
    goals = np.stack([task.goals[np.minimum(np.arange(GOAL_CAPACITY), len(task.goals) - 1)] for task in tasks])
    return TaskArrays(
        stack_scenes([task.scene for task in tasks], capacity),
        jnp.asarray([task.start for task in tasks], float),
        jnp.asarray(goals, float),
        jnp.asarray([len(task.goals) for task in tasks], jnp.int32),
        jnp.asarray([task.time_limit for task in tasks], float),
    )

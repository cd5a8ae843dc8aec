"""What a robot is asked to do in an episode, how the episode ends, and what is recorded of it."""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.scene import Scene, SceneArrays, stack_scenes

GOAL_CAPACITY = 6
"""Goals of one task at most, so that the tasks of a batch have one shape."""


class Outcome(IntEnum):
    """How an episode ended; the robot cannot know that it is MISTAKEN, only the true state tells."""

    RUNNING = 0
    REACHED = 1
    COLLIDED = 2
    FELL = 3
    GAVE_UP = 4
    TIMED_OUT = 5
    MISTAKEN = 6


SENTENCES = {
    Outcome.RUNNING: "still under way",
    Outcome.REACHED: "stood at its last goal",
    Outcome.COLLIDED: "its body touched an obstacle",
    Outcome.FELL: "fell",
    Outcome.GAVE_UP: "stopped, because it found no way to its goal or saw nothing",
    Outcome.TIMED_OUT: "ran out of time",
    Outcome.MISTAKEN: "stood where it believed its last goal to be, but had not been at all goals",
}


@dataclass(frozen=True, eq=False)
class Task:
    """A scene to walk in and the goals to visit one after the other.

    Attributes:
        name: of the row in tables.
        scene: where.
        start: (x [m], y [m], yaw [rad]) of the robot.
        goals: (G, 2) [m] world frame, 1 to `GOAL_CAPACITY`.
        time_limit: [s].
    """

    name: str
    scene: Scene
    start: tuple[float, float, float]
    goals: np.ndarray
    time_limit: float = 60.0

    def __post_init__(self) -> None:
        goals = np.array(self.goals, np.float64)
        if goals.ndim != 2 or goals.shape[1:] != (2,) or not 1 <= len(goals) <= GOAL_CAPACITY:
            raise InputError(
                f"Task {self.name}: goals have shape {goals.shape}; give 1 to {GOAL_CAPACITY} rows of x, y in metres."
            )
        if not (np.isfinite(goals).all() and np.isfinite(self.start).all() and len(self.start) == 3):
            raise InputError(f"Task {self.name}: start and goals must be finite; the start is x, y [m] and yaw [rad].")
        if not self.time_limit > 0:
            raise InputError(f"Task {self.name}: the time limit must be positive, got {self.time_limit} s.")
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


def stack_tasks(tasks: list[Task]) -> TaskArrays:
    """The arrays of several tasks, batch first."""
    goals = np.stack([task.goals[np.minimum(np.arange(GOAL_CAPACITY), len(task.goals) - 1)] for task in tasks])
    return TaskArrays(
        stack_scenes([task.scene for task in tasks]),
        jnp.asarray([task.start for task in tasks], float),
        jnp.asarray(goals, float),
        jnp.asarray([len(task.goals) for task in tasks], jnp.int32),
        jnp.asarray([task.time_limit for task in tasks], float),
    )


class EpisodeRecord(NamedTuple):
    """What is recorded of episodes at every camera frame; NumPy, batch first, then time.

    A finished episode repeats its last row.

    Attributes:
        time: [s]; outcome: `Outcome` so far; goal: index of the goal being walked to.
        qpos: (23,) true state; base: true and believed: estimated (x, y, yaw) of the base frame, which lies on the
            floor below the COM with x along the torso's heading [m, rad].
        feet: (2, 3) [m] true, right and left.
        path: (n, 2) [m] planned, world frame.
        footsteps: (m, 2) [m] planned, world frame.
        clearance: [m] between the body's volume and the nearest obstacle; negative inside.
        stopped: whether the robot holds still for its own safety (blind or frozen camera, no way).
        detour: whether the classical route took the place of a path of iPath's that led nowhere.
        torque_share: largest motor torque since the last frame over its limit.
        qp_failures: ticks since the last frame whose whole-body QP did not converge.
        depth: (height, width) float16 [m] as the planner sees it, and
        occupied: (n, n) its remembered map, a window with the world's axes around the believed base; both only where
            images are kept, else empty.

    What the planner saw and planned (`believed`, `path`, `depth`) belong to the frame's start, the rest to its end.
    """

    time: Float[Array, "*n"]
    outcome: Int[Array, "*n"]
    goal: Int[Array, "*n"]
    qpos: Float[Array, "*n nq"]
    base: Float[Array, "*n 3"]
    believed: Float[Array, "*n 3"]
    feet: Float[Array, "*n 2 3"]
    path: Float[Array, "*n p 2"]
    footsteps: Float[Array, "*n m 2"]
    clearance: Float[Array, "*n"]
    stopped: Bool[Array, "*n"]
    detour: Bool[Array, "*n"]
    torque_share: Float[Array, "*n"]
    qp_failures: Int[Array, "*n"]
    depth: Float[Array, "*n h w"]
    occupied: Bool[Array, "*n rows columns"]

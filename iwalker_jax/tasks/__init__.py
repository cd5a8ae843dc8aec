"""What a robot is asked to do in an episode: a scene, a start and goals."""

from iwalker_jax.tasks.generated import TaskSampling, generated_task, generated_tasks, training_task
from iwalker_jax.tasks.named import (
    ROOM_TASK_NAMES,
    TASK_NAMES,
    demonstration,
    named_task,
    room_task,
    sequence_task,
    tour_length,
)
from iwalker_jax.tasks.reachability import check_task
from iwalker_jax.tasks.routes import comfortable_route, time_limit
from iwalker_jax.tasks.task import GOAL_CAPACITY, Task, TaskArrays, stack_tasks

__all__ = [
    "GOAL_CAPACITY",
    "ROOM_TASK_NAMES",
    "TASK_NAMES",
    "Task",
    "TaskArrays",
    "TaskSampling",
    "check_task",
    "comfortable_route",
    "demonstration",
    "generated_task",
    "generated_tasks",
    "named_task",
    "room_task",
    "sequence_task",
    "stack_tasks",
    "time_limit",
    "tour_length",
    "training_task",
]

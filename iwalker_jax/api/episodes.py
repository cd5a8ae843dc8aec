"""One call from tasks to closed-loop episodes by sight, judged and measured."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from iwalker_jax.api.planner import load_with_config
from iwalker_jax.checks import require_whole
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes import EpisodeMetrics, episode_metrics, judged, row_of
from iwalker_jax.navigation import EpisodeProgram, EpisodeRecord, Faults, Outcome, make_navigator
from iwalker_jax.tasks.named import named_task
from iwalker_jax.tasks.reachability import check_task
from iwalker_jax.tasks.task import Task
from iwalker_jax.training.on_policy import memory_ipath_for
from iwalker_jax.walking import Disturbances, Sensors


class EpisodesResult(NamedTuple):
    """What came of the episodes, one a task.

    Attributes:
        tasks: that were given.
        records: of each, NumPy, up to the frame in which it ended; judged by the true state.
        metrics: of each.
        compile_seconds, run_seconds: [s] of wall time.
    """

    tasks: tuple[Task, ...]
    records: tuple[EpisodeRecord, ...]
    metrics: tuple[EpisodeMetrics, ...]
    compile_seconds: float
    run_seconds: float

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """How each of them ended."""
        return tuple(each.outcome for each in self.metrics)


def run_episodes(
    tasks: str | Task | Sequence[str | Task],
    policy: str = "default",
    run: str | Path | None = None,
    *,
    sensors: Sensors = "nominal",
    depth_noise: bool = True,
    disturbances: Disturbances = Disturbances(),
    faults: Sequence[Faults] | None = None,
    images: bool = False,
    unreachable: bool = False,
    seed: int = 0,
    width: int = 20,
    devices: int | None = None,
    on_progress: Callable[[float, int], None] = lambda seconds, running: None,
) -> EpisodesResult:
    """Let BRUCE find its way by sight: `run_episodes("office").outcomes`.

    Args:
        tasks: one or several, each a name of `TASK_NAMES` or a `Task`.
        policy: how to navigate, a name of `POLICIES`: default, networks, memory, published or classical.
        run: folder of the training run whose networks are used; the shipped planner if left out.
        sensors: `none` walks on the true state, the others on the estimate from simulated sensors.
        depth_noise: whether the camera is as noisy as a real one.
        disturbances: from which each robot's friction, mass and start are drawn.
        faults: of camera, odometry and scene, one a task; none by default.
        images: whether to record depth and map of every frame.
        unreachable: whether the robot shall find out for itself that no way leads to a goal; refused otherwise.
        seed: of conditions, sensors and depth noise, and of the tasks given by name.
        width: episodes at a time.
        devices: number of devices, all by default.
        on_progress: hears of the robot-seconds simulated so far, and of the episodes still running.

    Raises:
        InputError: for an unknown task or policy, a task whose start or goals are outside, in an obstacle or cut off,
            or options out of range.
        CheckpointError: if the run's networks cannot be read.
    """
    require_whole(width, "The number of episodes at a time")
    several = (tasks,) if isinstance(tasks, (str, Task)) else tasks
    if not isinstance(several, Sequence) or not all(isinstance(task, (str, Task)) for task in several):
        raise InputError("The tasks are none; give names, or a Task each.")
    if faults is not None and not (isinstance(faults, Sequence) and all(isinstance(each, Faults) for each in faults)):
        raise InputError("The faults are none; give Faults, one a task, or leave them out.")
    chosen = tuple(named_task(task, seed) if isinstance(task, str) else task for task in several)
    for task in several:
        if not isinstance(task, str):
            check_task(task, unreachable)
    planner, _ = load_with_config(run)
    memory_ipath = memory_ipath_for(policy, None if run is None else Path(run))
    navigator = make_navigator(policy, planner, sensors, depth_noise, memory_ipath=memory_ipath)
    program = EpisodeProgram(navigator, max(1, min(width, len(chosen))), devices, images, disturbances)
    record = program.run(chosen, seed, faults, on_progress)
    records = tuple(judged(row_of(record, k), task) for k, task in enumerate(chosen))
    metrics = tuple(episode_metrics(row, task) for row, task in zip(records, chosen, strict=True))
    return EpisodesResult(chosen, records, metrics, program.compile_seconds, program.run_seconds)

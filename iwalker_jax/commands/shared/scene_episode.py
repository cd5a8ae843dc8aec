"""One episode in a scene: camera, planner, walking and physics for one robot, with its trace, film and figures."""

import dataclasses
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh

from bruce_model import load_mujoco
from iwalker_jax.commands.shared.console import progress_bar, say
from iwalker_jax.commands.shared.planners import planner_of
from iwalker_jax.commands.shared.walk_options import EpisodeOptions, SharedOptions
from iwalker_jax.commands.shared.walk_output import finite_or_none
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes import (
    AROUND,
    FilmSettings,
    episode_metrics,
    judged,
    least_surface_distance,
    original_surface,
    row_of,
    save_episode,
    write_film,
)
from iwalker_jax.evaluation.rerun_files import write_episode
from iwalker_jax.navigation import BodyVolume, EpisodeProgram, EpisodeRecord, Outcome, make_navigator
from iwalker_jax.perception import Intrinsics
from iwalker_jax.runtime import write_json
from iwalker_jax.scenes.imported.user_scene import UserScene, convert_user_scene
from iwalker_jax.tasks import TASK_NAMES, Task, check_task, named_task
from iwalker_jax.tasks.routes import (
    PACE,
    leg_lengths,
    single_precision,
    time_limit,
)
from iwalker_jax.training.on_policy import memory_ipath_for
from iwalker_jax.walking import Disturbances

_DETOUR = 2.0
"""Length of the way, by that of the straight line, that is allowed to where no route leads."""


def task_of(options: EpisodeOptions, seed: int, user: UserScene | None = None) -> Task:
    """The task of a demonstration's or test sequence's name, or of a user's own scene file with start and goals.

    Args:
        options: with a scene.
        seed: of a demonstration's start.
        user: the scene file converted, if that was done already.

    Raises:
        InputError: for an unknown scene, a file that cannot be used, a start or goal outside, in an obstacle or without
            room for the robot, or, unless the options allow it, a goal that no way leads to.
    """
    shift = np.zeros(2)
    if options.scene_file is None:
        if options.bounds is not None:
            raise InputError(f"--bounds belongs to a scene file, but {options.scene} has its own; leave it out.")
        task = named_task(str(options.scene), seed)
        if options.start is None and not options.goals:
            return task
        name, scene, start, goals = task.name, task.scene, task.start, options.goals or task.goals
    else:
        user = user or user_scene(options)
        name, scene, shift = user.scene.name, user.scene, user.shift
        start, goals = (0.0, 0.0, 0.0), options.goals
    if options.start is not None:
        x, y, degrees = options.start
        start = (x, y, math.radians(degrees))
    task = Task(name, scene, (start[0] + shift[0], start[1] + shift[1], start[2]), np.asarray(goals) + shift)
    try:
        check_task(task, options.unreachable)
    except InputError as error:
        if not shift.any():
            raise
        moved = f"these places and the scene were moved by {shift[0]:.0f}, {shift[1]:.0f} m"
        raise InputError(f"{str(error).rstrip('.')} ({moved}).") from error
    return dataclasses.replace(task, time_limit=time_limit(allowed_length(task)))


def user_scene(options: EpisodeOptions) -> UserScene:
    """The scene file of the options as boxes and cylinders; says what became of it.

    Raises:
        InputError: without goals, or for a file that cannot be used.
    """
    file = options.scene_file
    if file is None or not file.suffix:
        raise InputError(f"Unknown scene {str(file)!r}; choose one of {', '.join(TASK_NAMES)}, or give a file.")
    if not options.goals:
        raise InputError(f"Where to in {file}? Give --goals X Y in metres, and --start X Y DEGREES if it is not 0 0 0.")
    converted = convert_user_scene(file, options.bounds, options.up)
    say(converted.describe())
    return converted


def allowed_length(task: Task) -> float:
    """[m] of the way from the start through all goals: comfortable routes, and detours where there are none."""
    stops = np.concatenate([[task.start[:2]], task.goals])
    direct = [_DETOUR * math.dist(here, there) for here, there in pairwise(stops)]
    lengths = leg_lengths(single_precision(task.scene), stops)
    return sum(away if length is None else length for away, length in zip(direct, lengths, strict=True))


def run_scene_episode(options: EpisodeOptions, shared: SharedOptions) -> None:
    """Run the episode, say how it ended, and save trace, film and figures.

    Raises:
        InputError: for an unknown scene or policy, or files that cannot be used.
    """
    user = None if options.scene_file is None else user_scene(options)
    task = task_of(options, shared.seed, user)
    planner, _, name = planner_of(options.run)
    memory_ipath = memory_ipath_for(options.policy, options.run)
    navigator = make_navigator(options.policy, planner, shared.sensors or "nominal", memory_ipath=memory_ipath)
    disturbances: Disturbances = shared.disturbances
    if disturbances.push_impulse:
        disturbances = dataclasses.replace(disturbances, push_after=allowed_length(task) / PACE / 2)
    program = EpisodeProgram(navigator, 1, 1, images=True, disturbances=disturbances)
    with progress_bar("simulated seconds", round(task.time_limit)) as advance:
        advance(0, "compiling, a minute or two the first time")
        record = program.run([task], shared.seed, on_progress=lambda done, up: advance(round(done), task.name))
    episode = judged(row_of(record, 0), task)
    metrics = episode_metrics(episode, task)
    outcome = Outcome(int(episode.outcome[-1]))
    simulated = float(episode.time[-1])
    say(f"\nBRUCE {outcome.sentence} after {simulated:.1f} s ({task.name}, {name}, {options.policy}).")
    route = f"the shortest route is {metrics.shortest:.1f} m; SPL {metrics.spl:.2f}"
    say(f"Walked {metrics.walked:.1f} m, {route if math.isfinite(metrics.shortest) else 'but no route leads there'}.")
    say(f"Least clearance {100 * float(episode.clearance.min()):.1f} cm, mean speed {metrics.speed:.2f} m/s.")
    figures = {"task": task.name, **metrics._asdict(), "outcome": outcome.name}
    if options.scene_file is not None and user is not None:
        surface = original_surface(options.scene_file, user.T_scene_file, user.lowest)
        figures["surface_distance"] = _surface_distance(options.scene_file.name, surface, navigator.volume, episode)
    say(
        f"Simulation {simulated / max(program.run_seconds, 1e-9):.1f} x real time, camera included; "
        f"{program.compile_seconds:.0f} s more to compile and start."
    )
    save_episode(task, episode, shared.out / "trace.png")
    plain = {name: value if isinstance(value, str) else finite_or_none(float(value)) for name, value in figures.items()}
    write_json(shared.out / "figures.json", plain)
    if shared.rerun is not None:
        write_episode(shared.rerun, task, episode, navigator.intrinsics, load_mujoco())
    filmed = shared.video and _film(shared.out / "film.mp4", task, episode, navigator.intrinsics)
    say(f"Trace{', figures and film' if filmed else ' and figures'} are in {shared.out}.")


def _surface_distance(name: str, surface: trimesh.Trimesh, volume: BodyVolume, episode: EpisodeRecord) -> float:
    """[m] from the walked body to what the file itself describes; says it."""
    qpos = np.asarray(episode.qpos, np.float64)
    qpos = qpos[np.isfinite(qpos).all(axis=1)]
    distance = least_surface_distance(surface, volume, load_mujoco(), qpos) if len(qpos) else math.nan
    words = f"{100 * distance:.1f} cm" if math.isfinite(distance) else f"more than {AROUND:g} m"
    say(f"Least distance to the surfaces of {name} itself {words}.")
    return distance


def _film(file: Path, task: Task, episode: EpisodeRecord, camera: Intrinsics) -> bool:
    """Write the film; a machine that cannot draw is told what is missing and keeps its other results."""
    try:
        write_film(file, task, episode, FilmSettings(camera=camera))
    except InputError as error:
        say(f"No film: {error}")
        return False
    return True

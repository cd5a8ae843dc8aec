"""The walk through a scene: camera, planner, walking and physics for one robot, with its trace, film and figures."""

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.console import progress_bar, say
from experiments.planner import planner_of
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.navigation_film import write_film
from iwalker_jax.evaluation.navigation_metrics import episode_metrics, row_of
from iwalker_jax.evaluation.navigation_pictures import save_episode
from iwalker_jax.navigation.demonstrations import TASK_NAMES, named_task
from iwalker_jax.navigation.episodes import EpisodeProgram
from iwalker_jax.navigation.navigators import make_navigator
from iwalker_jax.navigation.task import SENTENCES, Outcome, Task
from iwalker_jax.navigation.user_scene import convert_user_scene
from iwalker_jax.simulation.walk_setup import Disturbances, Sensors

PRETRAINED = "pretrained"


@dataclass(frozen=True)
class SceneWalk:
    """What the command line asks for; see `experiments.walk` for the fields' meaning."""

    scene: str
    policy: str
    navigation: str
    start: tuple[float, float, float]
    goals: tuple[tuple[float, float], ...]
    sensors: Sensors
    disturbances: Disturbances
    seed: int
    video: bool
    out: Path


def task_of(walk: SceneWalk) -> Task:
    """The task of a demonstration's or test sequence's name, or of a user's own scene file with start and goals."""
    if walk.scene in TASK_NAMES:
        if walk.goals:
            task = named_task(walk.scene, walk.seed)
            return dataclasses.replace(task, goals=np.asarray(walk.goals))
        return named_task(walk.scene, walk.seed)
    file = Path(walk.scene)
    if not file.suffix:
        raise InputError(f"Unknown scene {walk.scene!r}; choose one of {', '.join(TASK_NAMES)}, or give a file.")
    if not walk.goals:
        raise InputError(f"Where to in {file}? Give --goals X Y in metres, and --start X Y DEGREES if it is not 0 0 0.")
    converted = convert_user_scene(file)
    say(converted.describe())
    x, y, degrees = walk.start
    return Task(file.stem, converted.scene, (x, y, float(np.radians(degrees))), np.asarray(walk.goals), 120.0)


def walk_in_scene(walk: SceneWalk) -> None:
    """Walk, say how it ended, and save trace, film and figures.

    Raises:
        InputError: for an unknown scene or policy, or files that cannot be used.
    """
    task = task_of(walk)
    planner, _, name = planner_of(None if walk.policy == PRETRAINED else Path(walk.policy))
    navigator = make_navigator(walk.navigation, planner, walk.sensors)
    program = EpisodeProgram(navigator, 1, 1, images=True, disturbances=walk.disturbances)
    with progress_bar("simulated seconds", round(task.time_limit)) as advance:
        advance(0, "compiling, a minute or two the first time")
        record = program.run([task], walk.seed, on_progress=lambda done, up: advance(round(done), task.name))
    episode = row_of(record, 0)
    metrics = episode_metrics(episode, task)
    outcome = Outcome(int(episode.outcome[-1]))
    simulated = float(episode.time[-1])
    say(f"\nBRUCE {SENTENCES[outcome]} after {simulated:.1f} s ({task.name}, {name}, {walk.navigation}).")
    say(f"Walked {metrics.walked:.1f} m, the shortest route is {metrics.shortest:.1f} m; SPL {metrics.spl:.2f}.")
    say(f"Least clearance {100 * float(episode.clearance.min()):.1f} cm, mean speed {metrics.speed:.2f} m/s.")
    say(
        f"Simulation {simulated / max(program.run_seconds, 1e-9):.1f} x real time, camera included; "
        f"{program.compile_seconds:.0f} s more to compile and start."
    )
    walk.out.mkdir(parents=True, exist_ok=True)
    save_episode(task, episode, walk.out / "trace.png")
    figures = {"task": task.name, "outcome": outcome.name, **metrics._asdict()}
    (walk.out / "figures.json").write_text(json.dumps(figures, indent=2, default=float) + "\n")
    if walk.video:
        write_film(walk.out / "film.mp4", task, episode)
    say(f"Trace, figures{' and film' if walk.video else ''} are in {walk.out}.")

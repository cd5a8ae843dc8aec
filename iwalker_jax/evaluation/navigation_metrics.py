"""What closed-loop episodes are worth: how they ended, how far they walked, how near obstacles, how calm the plan."""

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from iwalker_jax.errors import InputError
from iwalker_jax.navigation.task import EpisodeRecord, Outcome, Task
from iwalker_jax.perception.cost_to_go import UNREACHABLE
from iwalker_jax.simulation.motion import smooth_track
from iwalker_jax.simulation.routes import DEFAULT_ROUTE_RULES, RouteRules, cost_at, shortest_distance
from iwalker_jax.simulation.scene import SceneArrays

AHEAD = 0.5
"""[m] along a planned path from its start to where its shaking is measured."""

_MOVED = 5e-3
"""[m] by which a foot that has just landed was elsewhere in the two frames before."""


class EpisodeMetrics(NamedTuple):
    """Figures of one episode; NaN where one does not apply.

    Attributes:
        outcome: how it ended.
        seconds: [s] until then.
        walked: [m] length of the base's track without the sway of single steps.
        shortest: [m] shortest route through all goals in order; NaN where there is none.
        spl: success weighted by path length, Anderson et al. (2018): success x shortest / max(shortest, walked).
        clearance: [m] least, between the body's volume and the nearest obstacle.
        goals: share of the goals reached.
        torque_peak: largest torque of a motor over its limit.
        qp_failures: share of the ticks whose whole-body QP did not converge.
        shaking: [m] mean distance between the path before and the point `AHEAD` on each new path, world frame.
        detours: share of the frames in which the classical route took the place of iPath's path.
    """

    outcome: Outcome
    seconds: float
    walked: float
    shortest: float
    spl: float
    clearance: float
    goals: float
    torque_peak: float
    qp_failures: float
    shaking: float
    detours: float

    @property
    def success(self) -> bool:
        """Whether the robot stood at its last goal."""
        return self.outcome is Outcome.REACHED

    @property
    def speed(self) -> float:
        """[m/s] mean over the episode."""
        return self.walked / self.seconds if self.seconds > 0 else float("nan")


def row_of(record: EpisodeRecord, episode: int) -> EpisodeRecord:
    """One episode of a batch, up to and with the frame in which it ended: (time, ...).

    Raises:
        InputError: a record that has no such episode.
    """
    if np.ndim(record.outcome) != 2 or not 0 <= episode < len(record.outcome):
        raise InputError(f"The record has outcomes of shape {np.shape(record.outcome)} and no episode {episode}.")
    ended = record.outcome[episode] != Outcome.RUNNING
    frames = int(np.argmax(ended)) + 1 if ended.any() else len(ended)
    return EpisodeRecord(*(np.asarray(part)[episode][:frames] for part in record))


def episode_metrics(
    episode: EpisodeRecord, task: Task, shortest: float | None = None, time_step: float = 0.002
) -> EpisodeMetrics:
    """Figures of one episode.

    Args:
        episode: as from `row_of`.
        task: that was given.
        shortest: [m] of `shortest_route`; worked out here if left out.
        time_step: [s] of a tick of the whole-body QP.
    """
    shortest = shortest_route(task) if shortest is None else shortest
    outcome = Outcome(int(episode.outcome[-1]))
    success = outcome is Outcome.REACHED
    seconds = float(episode.time[-1])
    walked = walked_distance(np.asarray(episode.base)[:, :2], np.asarray(episode.time))
    return EpisodeMetrics(
        outcome=outcome,
        seconds=seconds,
        walked=walked,
        shortest=shortest,
        spl=success * shortest / max(shortest, walked, 1e-6) if np.isfinite(shortest) else float("nan"),
        clearance=_reduced(np.min, episode.clearance),
        goals=1.0 if success else float(episode.goal[-1]) / len(task.goals),
        torque_peak=_reduced(np.max, episode.torque_share),
        qp_failures=float(np.sum(episode.qp_failures)) * time_step / seconds if seconds > 0 else 0.0,
        shaking=path_shaking(np.asarray(episode.path)),
        detours=float(np.mean(np.asarray(episode.detour))),
    )


def batch_metrics(record: EpisodeRecord, tasks: Sequence[Task], time_step: float = 0.002) -> list[EpisodeMetrics]:
    """Figures of every episode of a batch.

    Raises:
        InputError: another number of tasks than of episodes.
    """
    if len(tasks) != len(record.outcome):
        raise InputError(f"There are {len(tasks)} tasks and {len(record.outcome)} episodes; give a task for each.")
    return [episode_metrics(row_of(record, i), task, time_step=time_step) for i, task in enumerate(tasks)]


def walked_distance(places: Float[np.ndarray, "n 2"], times: Float[np.ndarray, " n"]) -> float:
    """[m] length of a track of evenly sampled places [m], smoothed so that the sway of single steps does not count."""
    finite = np.isfinite(places).all(axis=1)
    places = np.asarray(places, np.float64)[finite]
    if len(places) < 2:
        return 0.0
    period = max(float(np.median(np.diff(times))), 1e-3)
    return float(np.linalg.norm(np.diff(smooth_track(places, period), axis=0), axis=1).sum())


def shortest_route(task: Task, rules: RouteRules = DEFAULT_ROUTE_RULES) -> float:
    """[m] length of the shortest walkable route from the start through all goals in order; NaN if there is none."""
    scene = task.scene.arrays()
    places = np.concatenate([[task.start[:2]], task.goals])
    legs = [
        float(_leg(scene, jnp.asarray(a, float), jnp.asarray(b, float), rules)) for a, b in itertools.pairwise(places)
    ]
    return float("nan") if max(legs) >= UNREACHABLE else sum(legs)


@functools.partial(jax.jit, static_argnames="rules")
def _leg(
    scene: SceneArrays, start: Float[jax.Array, " 2"], goal: Float[jax.Array, " 2"], rules: RouteRules
) -> Float[jax.Array, ""]:
    return cost_at(shortest_distance(scene, goal, rules), start)


def path_shaking(paths: Float[np.ndarray, "n p 2"]) -> float:
    """[m] mean distance from the path before to the point `AHEAD` along each new path; NaN if there is no such pair.

    A robot that walks on along an unchanged path does not count as shaking, however far it came. Pairs of which one
    path ends before that point are left out: near a goal there is nothing to compare.
    """
    distances = []
    for before, after in itertools.pairwise(paths):
        if np.array_equal(before, after) or not (np.isfinite(before).all() and np.isfinite(after).all()):
            continue
        ahead = _point_along(after, AHEAD)
        if ahead is None:
            continue
        distance, place = _distance_to_line(ahead, before)
        if place < 1.0:
            distances.append(distance)
    return float(np.mean(distances)) if distances else float("nan")


def landing_errors(episode: EpisodeRecord) -> Float[np.ndarray, " n"]:
    """[m] from the planned to the true place of every footstep of an episode, as from `row_of`.

    A walking robot plans anew when a foot lands, so a new plan says that the last one's first footstep was taken, by
    the foot that is nearest; a standing robot plans anew as well, but its feet have not moved.
    """
    aims, feet = np.asarray(episode.footsteps, np.float64)[:, 0], np.asarray(episode.feet, np.float64)
    errors = []
    for k in range(1, len(aims) - 1):
        gaps = np.linalg.norm(feet[k + 1, :, :2] - aims[k], axis=1)
        foot = int(np.argmin(gaps))
        moved = np.linalg.norm(feet[k - 1 : k + 1, foot] - feet[k + 1, foot], axis=1).max()
        if not np.array_equal(aims[k], aims[k + 1]) and moved > _MOVED and np.isfinite(gaps).all():
            errors.append(gaps[foot])
    return np.array(errors)


def _point_along(path: Float[np.ndarray, "p 2"], distance: float) -> Float[np.ndarray, " 2"] | None:
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    if lengths[-1] < distance:
        return None
    return np.array([np.interp(distance, lengths, path[:, 0]), np.interp(distance, lengths, path[:, 1])])


def _distance_to_line(point: Float[np.ndarray, " 2"], line: Float[np.ndarray, "p 2"]) -> tuple[float, float]:
    """Distance [m] to a polyline, and where on it the nearest point lies: 1 is its end."""
    starts, edges = line[:-1], np.diff(line, axis=0)
    share = np.sum((point - starts) * edges, axis=1) / np.maximum(np.sum(edges**2, axis=1), 1e-12)
    share = np.clip(share, 0.0, 1.0)
    distances = np.linalg.norm(starts + share[:, None] * edges - point, axis=1)
    nearest = int(np.argmin(distances))
    return float(distances[nearest]), (nearest + float(share[nearest])) / len(edges)


def _reduced(function: Callable[[np.ndarray], float], values: ArrayLike) -> float:
    usable = np.asarray(values, np.float64)
    usable = usable[np.isfinite(usable)]
    return float(function(usable)) if len(usable) else float("nan")

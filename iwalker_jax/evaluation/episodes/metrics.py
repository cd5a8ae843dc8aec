"""What closed-loop episodes are worth: how they ended, how far they walked, how near obstacles, how calm the plan."""

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from iwalker_jax.constants import TIME_STEP
from iwalker_jax.errors import InputError
from iwalker_jax.film import smooth_track
from iwalker_jax.geometry import host
from iwalker_jax.navigation import EpisodeRecord, LoopParameters, Outcome
from iwalker_jax.perception import UNREACHABLE
from iwalker_jax.scenes import SceneArrays
from iwalker_jax.scenes.routes import DEFAULT_ROUTE_PARAMETERS, RouteParameters, cost_at, shortest_distance
from iwalker_jax.tasks import GOAL_CAPACITY, Task

AHEAD = 0.5
"""[m] along a planned path from its start to where its shaking is measured."""

ARRIVAL = LoopParameters.arrival_distance
"""[m] from a goal at which a robot takes it for reached, by its own estimate of where it is."""

SLACK = 0.10
"""[m] beyond `ARRIVAL` at which the true base still counts as at a goal: the drift of odometry on a walk of several
metres, and what the base moves until the robot stands. A robot farther off than that is not where it was sent."""

_RING = 0.1 * np.stack([np.cos(np.arange(16) * np.pi / 8), np.sin(np.arange(16) * np.pi / 8)], axis=1)
"""[m] places around a goal where routes' directions are measured; goals have so much room beyond the routes' margin."""

_MOVED = 5e-3
"""[m] by which a foot that has just landed was elsewhere in the two frames before."""


class EpisodeMetrics(NamedTuple):
    """Figures of one episode; NaN where one does not apply.

    Attributes:
        outcome: how it ended, judged by the true state.
        seconds: [s] until then.
        walked: [m] length of the base's track without the sway of single steps.
        shortest: [m] of `shortest_route`; NaN where there is none.
        spl: success weighted by path length, Anderson et al. (2018): success x shortest / max(shortest, walked).
        clearance: [m] least, between the body's volume and the nearest obstacle.
        goals: share of the goals of which the robot believed that it reached them, and truly did (see `goals_reached`).
        end: [m] from the true base to the last goal at the end.
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
    end: float
    torque_peak: float
    qp_failures: float
    shaking: float
    detours: float

    @property
    def success(self) -> bool:
        """Whether the robot truly stood at its last goal after all others."""
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


def judged(episode: EpisodeRecord, task: Task) -> EpisodeRecord:
    """An episode, as from `row_of`, whose end is MISTAKEN if the robot believed to have reached what it had not."""
    believed = episode.outcome[-1] == Outcome.REACHED
    if not believed or goals_reached(episode, task).all():
        return episode
    outcome: Any = np.where(episode.outcome == Outcome.REACHED, int(Outcome.MISTAKEN), episode.outcome)
    return episode._replace(outcome=outcome)


def episode_metrics(
    episode: EpisodeRecord, task: Task, shortest: float | None = None, time_step: float = TIME_STEP
) -> EpisodeMetrics:
    """Figures of one episode.

    Args:
        episode: as from `row_of`, judged or not.
        task: that was given.
        shortest: [m] of `shortest_route`; worked out here if left out.
        time_step: [s] of a tick of the whole-body QP.
    """
    shortest = shortest_route(task) if shortest is None else shortest
    episode = judged(episode, task)
    outcome = Outcome(int(episode.outcome[-1]))
    success = outcome is Outcome.REACHED
    seconds = float(episode.time[-1])
    walked = walked_distance(np.asarray(episode.base)[:, :2], np.asarray(episode.time))
    return EpisodeMetrics(
        outcome=outcome,
        seconds=seconds,
        walked=walked,
        shortest=shortest,
        spl=success * max(shortest, 1e-6) / max(shortest, walked, 1e-6) if np.isfinite(shortest) else float("nan"),
        clearance=_reduced(np.min, episode.clearance),
        goals=float(np.mean(goals_reached(episode, task))),
        end=float(np.linalg.norm(np.asarray(episode.base)[-1, :2] - task.goals[-1])),
        torque_peak=_reduced(np.max, episode.torque_share),
        qp_failures=float(np.sum(episode.qp_failures)) * time_step / seconds if seconds > 0 else 0.0,
        shaking=path_shaking(np.asarray(episode.path)),
        detours=float(np.mean(np.asarray(episode.detour))),
    )


def goals_reached(episode: EpisodeRecord, task: Task) -> Bool[np.ndarray, " goals"]:
    """Which goals the robot took for reached while its true base was within `ARRIVAL` + `SLACK` of them.

    The last one counts by where the robot stands at the end, each other one by the nearest place on the way to it.

    Args:
        episode: as from `row_of`.
        task: that was given.
    """
    places, aims = np.asarray(episode.base)[:, :2], np.asarray(episode.goal)
    gaps = np.linalg.norm(places[:, None] - task.goals, axis=2)
    reached = np.zeros(len(task.goals), bool)
    stood = episode.outcome[-1] in (Outcome.REACHED, Outcome.MISTAKEN)
    reached[-1] = stood and gaps[-1, -1] <= ARRIVAL + SLACK
    for number in range(len(task.goals) - 1):
        after = np.flatnonzero(aims > number)
        if len(after):
            # The next goal is aimed at from a frame's start on, whose place the frame before has recorded.
            meant = np.append(np.flatnonzero(aims == number), after[0])
            reached[number] = bool((gaps[meant, number] <= ARRIVAL + SLACK).any())
    return reached


def batch_metrics(record: EpisodeRecord, tasks: Sequence[Task], time_step: float = TIME_STEP) -> list[EpisodeMetrics]:
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
    return host.polyline_length(smooth_track(places, period))


def shortest_route(task: Task, parameters: RouteParameters = DEFAULT_ROUTE_PARAMETERS) -> float:
    """[m] length that nobody can walk less than to reach all goals in order; NaN if there is no route.

    That is the shortest walkable route over the goals' centres, less what is spared because a goal counts from
    `ARRIVAL` on: all of it at the last goal; at each other one, where the route comes along the unit vector u and goes
    on along v, `ARRIVAL` |v - u|, which is nothing straight ahead and twice `ARRIVAL` there and back. Lengths of ways
    are convex in their ends where nothing stands in between, so that their slopes at the centres bound what is spared.
    The ways are those of a grid, up to 3 % longer than the shortest.
    """
    scene = task.scene.arrays()
    stops = np.concatenate([[task.start[:2]], task.goals])
    padded = stops[np.minimum(np.arange(GOAL_CAPACITY + 1), len(stops) - 1)]
    places = jnp.asarray(padded[:, None] + np.concatenate([np.zeros((1, 2)), _RING]), float)
    # Lengths from each stop to all others; of a start and one goal the goal's tell everything.
    first = 0 if len(task.goals) > 1 else 1
    ways = {
        k: np.asarray(_lengths(scene, jnp.asarray(stops[k], float), places, parameters), np.float64)
        for k in range(first, len(stops))
    }
    legs = [ways[k][k - 1, 0] for k in range(1, len(stops))]
    if max(legs) >= UNREACHABLE:
        return float("nan")
    turns = [_towards(ways[k - 1][k]) + _towards(ways[k + 1][k]) for k in range(1, len(stops) - 1)]
    spared = ARRIVAL * (1.0 + sum(float(np.nan_to_num(np.linalg.norm(turn), nan=2.0)) for turn in turns))
    return max(float(sum(legs)) - spared, 0.0)


@functools.partial(jax.jit, static_argnames="parameters")
def _lengths(
    scene: SceneArrays, stop: Float[jax.Array, " 2"], places: Float[jax.Array, "s k 2"], parameters: RouteParameters
) -> Float[jax.Array, "s k"]:
    return cost_at(shortest_distance(scene, stop, parameters), places)


def _towards(lengths: Float[np.ndarray, " k"]) -> Float[np.ndarray, " 2"]:
    """Unit vector in which the way begins whose length from a place, and from `_RING` around it, is given.

    NaN if there is no way from some of them.
    """
    if lengths.max() >= UNREACHABLE:
        return np.full(2, np.nan)
    descent = -lengths[1:] @ _RING
    return descent / max(float(np.linalg.norm(descent)), 1e-9)


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
    return None if host.arc_length(path)[-1] < distance else host.points_along(path, distance)


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

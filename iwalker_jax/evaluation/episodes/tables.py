"""Tables of closed-loop episodes: one row a policy and set of scenes, as text, Markdown and CSV."""

from collections.abc import Mapping, Sequence

from iwalker_jax.evaluation.episodes.metrics import ARRIVAL, SLACK, EpisodeMetrics
from iwalker_jax.evaluation.episodes.schedule import expected_outcomes
from iwalker_jax.evaluation.tables import Column, Table
from iwalker_jax.navigation import Outcome


def _rate_title(outcome: Outcome) -> str:
    return f"{outcome.word} %"


EPISODE_COLUMNS = (
    Column(
        "success %",
        f"episodes that ended standing at the last goal, after all others: the true base within "
        f"{ARRIVAL + SLACK:.1f} m of each",
        0,
        rate=True,
    ),
    Column(
        "as expected %",
        "episodes that ended as they should: where there is no way, or none that the robot fits, it gives up",
        0,
        rate=True,
    ),
    Column(
        _rate_title(Outcome.MISTAKEN),
        "it stood where it believed the last goal to be, but was farther from a goal",
        0,
        rate=True,
    ),
    Column(_rate_title(Outcome.COLLIDED), "the body's volume touched an obstacle", 0, rate=True),
    Column(_rate_title(Outcome.FELL), "the robot fell", 0, rate=True),
    Column(_rate_title(Outcome.GAVE_UP), "it stopped because it found no way", 0, rate=True),
    Column(_rate_title(Outcome.TIMED_OUT), "it was still on its way at the time limit", 0, rate=True),
    Column("goals %", "goals truly reached of those asked for", 0),
    Column("end cm", "from the true base to the last goal where the robot believed to stand at it", 1),
    Column(
        "SPL",
        "success x shortest route / the longer of shortest route and way walked; the route ends where a goal counts as "
        f"reached, {ARRIVAL:.1f} m from the last one, and is spared the corners within that of the others",
        2,
    ),
    Column("time s", "to the last goal, of the episodes that reached it", 1),
    Column("walked m", "way of the base, without the sway of single steps", 2),
    Column("speed m/s", "way walked by time", 3),
    Column("clearance cm", "least distance between the body's volume and an obstacle", 1),
    Column("detours %", "frames in which the classical route took the place of iPath's path", 0),
    Column("torque %", "largest share of a motor's limit", 0),
    Column("QP failed %", "ticks whose whole-body QP did not converge", 2),
    Column("shaking cm", "from each new path, 0.5 m ahead, to the one before", 1),
)
"""Columns of the table of episodes, in order."""
_FAILURES = (
    (Outcome.MISTAKEN,),
    (Outcome.COLLIDED,),
    (Outcome.FELL,),
    (Outcome.GAVE_UP,),
    (Outcome.TIMED_OUT, Outcome.RUNNING),
)
"""Outcomes that share a column, named after the first."""
_STOOD = (Outcome.REACHED, Outcome.MISTAKEN)


def episode_values(metrics: EpisodeMetrics, expected: Sequence[Outcome] = (Outcome.REACHED,)) -> dict[str, float]:
    """Figures of one episode by column title; NaN where a column does not apply.

    Args:
        metrics: of the episode.
        expected: how it should end, see `expected_outcomes`.
    """
    rates = {_rate_title(kinds[0]): 100.0 * (metrics.outcome in kinds) for kinds in _FAILURES}
    return {
        "success %": 100.0 * metrics.success,
        "as expected %": 100.0 * (metrics.outcome in expected),
        **rates,
        "goals %": 100.0 * metrics.goals,
        "end cm": 100.0 * metrics.end if metrics.outcome in _STOOD else float("nan"),
        "SPL": metrics.spl,
        "time s": metrics.seconds if metrics.success else float("nan"),
        "walked m": metrics.walked,
        "speed m/s": metrics.speed,
        "clearance cm": 100.0 * metrics.clearance,
        "detours %": 100.0 * metrics.detours,
        "torque %": 100.0 * metrics.torque_peak,
        "QP failed %": 100.0 * metrics.qp_failures,
        "shaking cm": 100.0 * metrics.shaking,
    }


def episode_table(groups: Mapping[tuple[str, str], Sequence[EpisodeMetrics]]) -> Table:
    """The table of episodes grouped by (policy, set of scenes).

    Rates are shown with Wilson's 95 % interval, everything else with its standard deviation over the episodes.
    """

    def values(scenes: str, episodes: Sequence[EpisodeMetrics]) -> tuple[dict[str, float], ...]:
        expected = expected_outcomes(scenes)
        return tuple(episode_values(metrics, expected) for metrics in episodes)

    rows = tuple(
        ((policy, scenes, str(len(episodes))), values(scenes, episodes))
        for (policy, scenes), episodes in groups.items()
    )
    return Table(rows, ("policy", "scenes", "episodes"), EPISODE_COLUMNS, "episode")


def failures(groups: Mapping[tuple[str, str], Sequence[EpisodeMetrics]]) -> dict[tuple[str, str], dict[Outcome, int]]:
    """How often each kind of end occurred, by group; kinds that occurred nowhere are left out."""
    kinds = [kind for kind in Outcome if any(m.outcome is kind for episodes in groups.values() for m in episodes)]
    return {key: {kind: sum(m.outcome is kind for m in ms) for kind in kinds} for key, ms in groups.items()}

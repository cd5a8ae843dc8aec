"""Tables of closed-loop episodes: rates with intervals, means with deviations, files that others can read."""

import csv

import numpy as np
import pytest
from scipy import stats

from iwalker_jax.evaluation.episodes.metrics import EpisodeMetrics
from iwalker_jax.evaluation.episodes.tables import EPISODE_COLUMNS, episode_table, episode_values, failures
from iwalker_jax.navigation.record import Outcome

TITLES = [column.title for column in EPISODE_COLUMNS]
GOOD = EpisodeMetrics(Outcome.REACHED, 20.0, 4.0, 3.0, 0.75, 0.12, 1.0, 0.28, 0.8, 0.001, 0.03, 0.25)
BAD = GOOD._replace(outcome=Outcome.COLLIDED, spl=0.0, clearance=-0.01, goals=0.5)


def test_an_episodes_values_by_hand():
    assert list(episode_values(GOOD)) == TITLES
    wanted = [100, 100, 0, 0, 0, 0, 0, 100, 28, 0.75, 20, 4, 0.2, 12, 25, 80, 0.1, 3]
    assert list(episode_values(GOOD).values()) == pytest.approx(wanted)
    bad = episode_values(BAD)
    assert bad["collided %"] == 100 and bad["success %"] == 0 and np.isnan(bad["time s"])
    assert np.isnan(bad["end cm"])
    assert episode_values(BAD._replace(outcome=Outcome.RUNNING))["timed out %"] == 100


def test_a_robot_that_only_believes_is_no_success():
    values = episode_values(GOOD._replace(outcome=Outcome.MISTAKEN, goals=2 / 3, end=0.55))
    assert values["success %"] == 0 and values["mistaken %"] == 100 and np.isnan(values["time s"])
    assert values["end cm"] == pytest.approx(55.0)
    rates = [column.title for column in EPISODE_COLUMNS if column.rate]
    assert sum(values[title] for title in rates) == 100


@pytest.mark.parametrize(
    ("episode_set", "outcome", "expected"),
    [
        ("room_gap_45", Outcome.REACHED, True),
        ("room_gap_45", Outcome.GAVE_UP, False),
        ("room_closed_door", Outcome.GAVE_UP, True),
        ("room_closed_door", Outcome.REACHED, False),
        ("room_threshold_30", Outcome.GAVE_UP, True),
        ("room_threshold_30", Outcome.COLLIDED, False),
        ("office", Outcome.GAVE_UP, False),
    ],
)
def test_where_there_is_no_way_giving_up_is_as_expected(episode_set, outcome, expected):
    """Oracle: the rooms' names."""
    table = episode_table({("default", episode_set): [GOOD._replace(outcome=outcome)]})
    assert table.cells()[1][3 + TITLES.index("as expected %")].startswith("100" if expected else "0 ")


def test_rates_come_with_intervals_and_figures_with_deviations(tmp_path):
    """Oracle: SciPy's Wilson interval and NumPy's deviation of a sample."""
    table = episode_table({("default", "office"): [GOOD] * 7 + [BAD] * 3, ("classical", "office"): [BAD]})
    header, row, other = table.cells()
    assert header == ["policy", "scenes", "episodes", *TITLES]
    assert row[:3] == ["default", "office", "10"]
    low, high = stats.binomtest(7, 10).proportion_ci(0.95, method="wilson")
    assert row[3] == f"70 [{100 * low:.0f}, {100 * high:.0f}]"
    assert row[3 + TITLES.index("SPL")] == f"{0.525:.2f} +- {np.std([0.75] * 7 + [0.0] * 3, ddof=1):.2f}"
    assert row[3 + TITLES.index("time s")] == "20.0 +- 0.0"
    assert other[3 + TITLES.index("time s")] == "-"
    table.save(tmp_path, "episode_table")
    with (tmp_path / "episode_table.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    assert len(lines) == 11 and lines[0]["episode"] == "0" and float(lines[8]["clearance cm"]) == -1.0
    assert all(column.meaning in (tmp_path / "episode_table.md").read_text() for column in EPISODE_COLUMNS)


def test_failures_are_counted_by_kind():
    groups = {("a", "x"): [GOOD, BAD, BAD], ("b", "x"): [GOOD, GOOD]}
    assert failures(groups) == {
        ("a", "x"): {Outcome.REACHED: 1, Outcome.COLLIDED: 2},
        ("b", "x"): {Outcome.REACHED: 2, Outcome.COLLIDED: 0},
    }

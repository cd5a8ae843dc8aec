"""The columns of frames: means and percentages by hand."""

import dataclasses
import math

import numpy as np
import pytest

from iwalker_jax.evaluation.frames.columns import FRAME_COLUMNS, frame_values
from iwalker_jax.evaluation.tables import Table
from tests.evaluation.frame_results import make_result

TITLES = [column.title for column in FRAME_COLUMNS]


def test_a_results_row_by_hand():
    """Oracle: four frames, worked out by hand; of the two goals in view one is served, of the others both."""
    got = frame_values(make_result())
    wanted = dict(zip(TITLES, [1.5, 3.0, 11.5, 0.75, 15.0, 25.0, 50.0, 100.0, 75.0]))
    assert list(got) == TITLES
    assert got == pytest.approx(wanted)


def test_without_ground_truth_its_columns_are_empty():
    got = frame_values(make_result(truth=False))
    assert [title for title in TITLES if math.isnan(got[title])] == TITLES[4:]
    assert got["feasibility"] == 1.5
    assert Table(((("own",), (got,)),), ("scene",), FRAME_COLUMNS).cells()[1][5:] == ["-"] * 5


def test_no_goal_out_of_view_leaves_progress_empty():
    result = dataclasses.replace(make_result(), in_view=np.ones(4, bool))
    got = frame_values(result)
    assert math.isnan(got["progress %"])
    assert got["reach %"] == 75.0

"""The columns of frames: means and percentages by hand."""

import dataclasses
import math

import numpy as np
import pytest

from iwalker_jax.evaluation.frames.columns import FRAME_COLUMNS, UNCHARGED_COLUMNS, frame_values
from iwalker_jax.evaluation.tables import Table
from tests.evaluation.frame_results import make_result

TITLES = [column.title for column in FRAME_COLUMNS]


def test_a_results_row_by_hand():
    """Oracle: four frames, worked out by hand; one of the two goals in view is not served: a quarter of the charges."""
    got = frame_values(make_result())
    raw = [1.5, 0.75, 3.0, 4.5, 11.5]
    charges = [10 / 3, 1.0, 2.0, 20.0, 250.0]
    wanted = [value + charge / 4 for value, charge in zip(raw, charges)]
    assert [got[title] for title in TITLES] == pytest.approx([*wanted, 15.0, 25.0, 50.0, 100.0, 75.0])
    assert [got[column.title] for column in UNCHARGED_COLUMNS] == pytest.approx(raw)
    assert got["frames"] == 4


def test_without_ground_truth_its_columns_are_empty():
    got = frame_values(make_result(truth=False))
    assert [title for title in TITLES if math.isnan(got[title])] == TITLES[5:]
    assert got["feasibility"] == 1.5
    assert Table(((("own",), (got,)),), ("scene",), FRAME_COLUMNS).cells()[1][6:] == ["-"] * 5


def test_no_goal_out_of_view_leaves_progress_empty():
    result = dataclasses.replace(make_result(), in_view=np.ones(4, bool))
    got = frame_values(result)
    assert math.isnan(got["progress %"])
    assert got["reach %"] == 75.0

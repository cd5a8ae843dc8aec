"""Tables: means, percentages and spreads by hand, and files that other programs can read."""

import csv
import dataclasses
import math
import statistics

import numpy as np
import pytest

from iwalker_jax.evaluation.tables import COLUMNS, Table, legend, result_row, spread
from tests.evaluation.frame_results import make_result

TITLES = [column.title for column in COLUMNS]


def row(**values: float) -> dict[str, float]:
    """A row of ones with the named columns replaced."""
    return dict.fromkeys(TITLES, 1.0) | values


def test_a_results_row_by_hand():
    """Oracle: four frames, worked out by hand; of the two goals in view one is served, of the others both."""
    got = result_row(make_result())
    wanted = dict(zip(TITLES, [1.5, 3.0, 11.5, 0.75, 15.0, 25.0, 50.0, 100.0, 75.0]))
    assert list(got) == TITLES
    assert got == pytest.approx(wanted)


def test_without_ground_truth_its_columns_are_empty():
    got = result_row(make_result(truth=False))
    assert [title for title in TITLES if math.isnan(got[title])] == TITLES[4:]
    assert got["feasibility"] == 1.5
    assert Table(((("own",), (got,)),)).cells()[1][5:] == ["-"] * 5


def test_no_goal_out_of_view_leaves_progress_empty():
    result = dataclasses.replace(make_result(), in_view=np.ones(4, bool))
    got = result_row(result)
    assert math.isnan(got["progress %"])
    assert got["reach %"] == 75.0


def test_one_seed_shows_its_value_and_several_mean_and_spread():
    """Oracle: NumPy's mean and a sample's standard deviation; a seed without a value does not count."""
    several = tuple(row(feasibility=value) for value in (1.0, 2.0, 6.0, float("nan")))
    table = Table(((("a", "x"), (row(stability=0.126),)), (("b", "x"), several)), ("method", "scene"))
    header, one, many = table.cells()
    assert header == ["method", "scene", *TITLES]
    assert one[4] == "0.126"
    assert many[2] == f"{3.0:.3f} +- {np.std([1.0, 2.0, 6.0], ddof=1):.3f}"


def test_spread_is_that_of_a_sample():
    """Oracle: the standard library."""
    assert spread([1.0, 2.0, 6.0]) == pytest.approx(statistics.stdev([1.0, 2.0, 6.0]))
    assert spread(np.array([3.0])) == 0.0


def test_text_is_aligned_and_markdown_has_every_cell():
    table = Table(((("office",), (row(),)), (("a longer name",), (row(feasibility=1234.5),))))
    assert len({len(line) for line in table.text().splitlines()}) == 1
    lines = table.markdown().splitlines()
    assert len(lines) == 4
    assert {line.count("|") for line in lines} == {len(TITLES) + 2}
    assert "1234.500" in lines[3]


def test_saved_csv_reads_back_in_full_precision(tmp_path):
    """Oracle: Python's csv reader."""
    value = 1.0 / 3.0
    table = Table(((("office",), (row(feasibility=value), row(feasibility=2.0))),))
    table.save(tmp_path / "new" / "folder", "table")
    with (tmp_path / "new" / "folder" / "table.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    assert [line["seed"] for line in lines] == ["0", "1"]
    assert float(lines[0]["feasibility"]) == value
    assert list(lines[0]) == ["scene", "seed", *TITLES]


def test_saved_markdown_explains_its_columns(tmp_path):
    Table(((("office",), (row(),)),)).save(tmp_path, "table")
    text = (tmp_path / "table.md").read_text()
    assert legend() in text
    assert all(column.meaning in text for column in COLUMNS)
    assert len(legend().splitlines()) == len(COLUMNS)

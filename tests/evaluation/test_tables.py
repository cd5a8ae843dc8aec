"""Tables: means, percentages and spreads by hand, and files that other programs can read."""

import csv
import statistics

import numpy as np
import pytest

from iwalker_jax.evaluation.tables import Column, Table, spread

COLUMNS = (Column("error", "distance from the plan", 3), Column("hits %", "rows that touch", 1), Column("gain", "more"))
TITLES = [column.title for column in COLUMNS]


def table_of(*rows, labels: tuple[str, ...] = ("scene",), sample: str | None = "seed") -> Table:
    return Table(rows, labels, COLUMNS, sample)


def row(**values: float) -> dict[str, float]:
    """A row of ones with the named columns replaced."""
    return dict.fromkeys(TITLES, 1.0) | values


def test_one_seed_shows_its_value_and_several_mean_and_spread():
    """Oracle: NumPy's mean and a sample's standard deviation; a seed without a value does not count."""
    several = tuple(row(error=value) for value in (1.0, 2.0, 6.0, float("nan")))
    rows = (("a", "x"), (row(error=0.126),)), (("b", "x"), several)
    table = table_of(*rows, labels=("method", "scene"))
    header, one, many = table.cells()
    assert header == ["method", "scene", *TITLES]
    assert one[2] == "0.126"
    assert many[2] == f"{3.0:.3f} +- {np.std([1.0, 2.0, 6.0], ddof=1):.3f}"


def test_spread_is_that_of_a_sample():
    """Oracle: the standard library."""
    assert spread([1.0, 2.0, 6.0]) == pytest.approx(statistics.stdev([1.0, 2.0, 6.0]))
    assert spread(np.array([3.0])) == 0.0


def test_text_is_aligned_and_markdown_has_every_cell():
    table = table_of((("office",), (row(),)), (("a longer name",), (row(error=1234.5),)))
    assert len({len(line) for line in table.text().splitlines()}) == 1
    lines = table.markdown().splitlines()
    assert len(lines) == 4
    assert {line.count("|") for line in lines} == {len(TITLES) + 2}
    assert "1234.500" in lines[3]


def test_saved_csv_reads_back_in_full_precision(tmp_path):
    """Oracle: Python's csv reader."""
    value = 1.0 / 3.0
    table = table_of((("office",), (row(error=value), row(error=2.0))))
    table.save(tmp_path / "new" / "folder", "table")
    with (tmp_path / "new" / "folder" / "table.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    assert [line["seed"] for line in lines] == ["0", "1"]
    assert float(lines[0]["error"]) == value
    assert list(lines[0]) == ["scene", "seed", *TITLES]


def test_a_row_of_one_sample_is_not_numbered(tmp_path):
    """Oracle: Python's csv reader."""
    table = table_of((("office",), (row(error=0.5),)), sample=None)
    table.save(tmp_path, "table")
    with (tmp_path / "table.csv").open() as stream:
        header, line = csv.reader(stream)
    assert header == ["scene", *TITLES] == table.header()
    assert line == ["office", "0.5", "1.0", "1.0"]


@pytest.mark.parametrize("ending", ["md", "txt"])
def test_saved_tables_explain_their_columns(tmp_path, ending):
    table = table_of((("office",), (row(),)))
    table.save(tmp_path, "table")
    text = (tmp_path / f"table.{ending}").read_text()
    assert table.legend() in text
    assert (table.markdown() if ending == "md" else table.text()) in text
    assert all(column.meaning in text for column in COLUMNS)
    assert len(table.legend().splitlines()) == len(COLUMNS)

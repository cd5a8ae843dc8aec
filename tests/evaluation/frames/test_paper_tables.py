"""The paper's tables: means, marks and verdicts by hand, and files that other programs can read."""

import csv

import numpy as np
import pytest
from scipy import stats

from iwalker_jax.evaluation.frames.columns import FRAME_COLUMNS, UNCHARGED_COLUMNS
from iwalker_jax.evaluation.frames.paper_tables import (
    PAPER_TABLES,
    best_methods,
    difference_cells,
    paper_cells,
    paper_text,
    published_cells,
    save_paper_tables,
    scene_values,
    verdict,
)
from iwalker_jax.evaluation.tables import Table
from iwalker_jax.scenes.built.held_out_sequences import SEQUENCE_NAMES

TITLES = [column.title for column in (*FRAME_COLUMNS, *UNCHARGED_COLUMNS)]
STABILITY = next(table for table in PAPER_TABLES if table.metric == "stability")
SEEDS = {"iplanner": (2.0, 2.2, 2.4), "finetuned": (1.0, 1.6, 2.2), "iwalker": (0.5, 0.6, 0.7)}


def results(**scenes: dict[str, tuple[float, ...]]) -> Table:
    """Rows whose every column has the same values; scenes that are not named have `SEEDS`."""
    rows = []
    for scene in (*SEQUENCE_NAMES, "unseen"):
        for method, seeds in scenes.get(scene, SEEDS).items():
            rows.append(((method, scene), tuple({**dict.fromkeys(TITLES, value), "frames": 60.0} for value in seeds)))
    return Table(tuple(rows), ("method", "scene"), FRAME_COLUMNS)


def test_cells_are_means_and_deviations_with_the_best_marked():
    """Oracle: NumPy; the unseen scenes are not in the paper's tables."""
    header, *lines = paper_cells(results(), PAPER_TABLES[0])
    assert header == ["method", *SEQUENCE_NAMES]
    assert lines[0][1] == f"{np.mean(SEEDS['iplanner']):.3f} +- {np.std(SEEDS['iplanner'], ddof=1):.3f}"
    assert lines[2][1:] == [f"**0.600 +- {np.std(SEEDS['iwalker'], ddof=1):.3f}**"] * 4
    assert not any("*" in cell for line in lines if line[0] != "iwalker" for cell in line)


def test_published_figures_stand_below():
    """Oracle: the paper's Table I."""
    scene = {**SEEDS, "stand still": (0.0, 0.0, 0.0)}
    table = results(**dict.fromkeys(SEQUENCE_NAMES, scene))
    lines = {line[0]: line[1:] for line in published_cells(table, PAPER_TABLES[0])}
    assert lines["published iwalker"] == ["1.432", "0.483", "0.468", "0.533"]
    assert "stand still" not in lines  # it would win: nothing is charged here
    assert [len(numbers) for each in PAPER_TABLES for _, numbers in each.published] == [4] * 9


def test_what_prints_alike_is_best_alike():
    values = {"a": {"stair": np.array([0.0001])}, "b": {"stair": np.array([0.0])}, "c": {"stair": np.array([0.1])}}
    assert best_methods(values, "stair") == {"a", "b"}
    office = {**SEEDS, "iplanner": tuple(value + 1e-6 for value in SEEDS["iwalker"])}
    said = verdict(results(office=office), STABILITY)
    assert "than iplanner in 3 of 4 scenes (3 beyond the paired interval, 1 alike)" in said


def test_what_holds_by_construction_wins_nothing():
    """Oracle: by hand; evenly spaced waypoints are marked in the table of spacing and in no other."""
    values = {**SEEDS, "even": (0.0, 0.0, 0.0)}
    table = results(**dict.fromkeys(SEQUENCE_NAMES, values))
    spacing = {line[0]: line[1] for line in paper_cells(table, STABILITY, even=("even",))[1:]}
    assert spacing["even (by construction)"] == "0.000 +- 0.000"
    assert spacing["iwalker"].startswith("**")
    other = {line[0]: line[1] for line in paper_cells(table, PAPER_TABLES[0], even=("even",))[1:]}
    assert other["even"].startswith("**")


def test_differences_have_paired_intervals():
    """Oracle: SciPy's paired t-test."""
    cells = {line[0]: line[1] for line in difference_cells(results(), PAPER_TABLES[0])}
    assert set(cells) == {"minus iwalker", "iplanner", "finetuned"}
    expected = stats.ttest_rel(SEEDS["iplanner"], SEEDS["iwalker"]).confidence_interval(0.95)
    assert cells["iplanner"] == f"+1.600 [{expected.low:+.3f}, {expected.high:+.3f}]"


def test_cells_that_read_alike_are_no_win():
    """Oracle: the printed means themselves; the paper's metrics have as many decimals in the study's own table."""
    values = {"iplanner": (0.0014, 0.0014), "finetuned": (0.0016, 0.0016), "iwalker": (0.0005, 0.0006)}
    table = results(**dict.fromkeys(SEQUENCE_NAMES, values))
    cells = {line[0]: line[1].strip("*").split(" ")[0] for line in paper_cells(table, STABILITY)[1:4]}
    assert cells == {"iplanner": "0.001", "finetuned": "0.002", "iwalker": "0.001"}
    said = verdict(table, STABILITY)
    assert "than iplanner in 0 of 4 scenes (0 beyond the paired interval, 4 alike)" in said
    assert "than finetuned in 4 of 4 scenes (4 beyond the paired interval)" in said
    metrics = {table.metric for table in PAPER_TABLES}
    assert {column.decimals for column in FRAME_COLUMNS if column.title in metrics} == {3}


def test_the_verdict_counts_scenes():
    """Oracle: by hand; in the office the baseline is better, in the corner its interval includes ours."""
    office = {**SEEDS, "iplanner": (0.1, 0.1, 0.1)}
    corner = {**SEEDS, "iplanner": (0.0, 1.0, 2.0)}
    said = verdict(results(office=office, corner=corner), PAPER_TABLES[0])
    assert "than iplanner in 3 of 4 scenes (2 beyond the paired interval)" in said
    assert "than finetuned in 4 of 4 scenes" in said


def test_one_seed_has_no_deviation():
    single = {method: seeds[:1] for method, seeds in SEEDS.items()}
    table = results(**dict.fromkeys(SEQUENCE_NAMES, single))
    assert paper_cells(table, PAPER_TABLES[1])[1][1] == "2.000"
    assert "interval" not in verdict(table, PAPER_TABLES[1])
    assert difference_cells(table, PAPER_TABLES[1]) == []


@pytest.mark.parametrize("table", PAPER_TABLES)
def test_text_names_every_table(table):
    text = paper_text(results())
    assert f"Table {table.number}: {table.metric}" in text
    assert text.count("success within 0.3 m; 60 frames a scene, 3 seeds") == len(PAPER_TABLES)


def test_saved_files_read_back(tmp_path):
    """Oracle: Python's csv reader."""
    save_paper_tables(results(), tmp_path / "new", "A note.")
    with (tmp_path / "new" / "paper_tables.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    assert len(lines) == len(PAPER_TABLES) * 3 * 4
    first = next(line for line in lines if line["method"] == "finetuned")
    assert float(first["mean"]) == pytest.approx(np.mean(SEEDS["finetuned"]))
    assert float(first["deviation"]) == pytest.approx(np.std(SEEDS["finetuned"], ddof=1))
    for name in ("paper_tables.md", "paper_tables.txt"):
        assert (tmp_path / "new" / name).read_text().endswith("\nA note.\n")
    assert (tmp_path / "new" / "paper_tables.md").read_text().count(
        "\n| --- |"
    ) == 5 + 5 + 3  # means, differences, and as published
    assert "Table III" in (tmp_path / "new" / "paper_tables.txt").read_text()
    assert set(scene_values(results(), "stability")) == set(SEEDS)

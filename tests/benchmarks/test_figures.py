"""Figures, their file, page and comparison, on made-up times whose quotients are known by hand."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.suite.comparison import changes, comparison_text
from benchmarks.suite.contest import Contender, contest
from benchmarks.suite.figures import Group, Row
from benchmarks.suite.page import page
from benchmarks.suite.pictures import draw, picture_names
from benchmarks.suite.report import load, save
from benchmarks.suite.tables import duration, group_table
from benchmarks.suite.timing import in_turns
from iwalker_jax.errors import InputError
from tests.benchmarks.reports import report

ROOT = Path(__file__).resolve().parents[2]


def test_quotients_are_taken_turn_by_turn():
    """Oracle: by hand. The second turn was slow for both, which the ratio does not see."""
    rows = (
        Row("ours", "ours", (1.0, 10.0, 1.0)),
        Row("slow", "peer", (9.0, 90.0, 9.0)),
        Row("fast", "peer", (2.0, 20.0, 2.0)),
    )
    group = Group("g", "a thing", rows)
    assert group.fastest_peer() is rows[2]
    lead = group.lead(rows[0])
    assert (lead.median, lead.low, lead.high) == (2.0, 2.0, 2.0)
    assert group.lead(rows[1]) is None
    assert (rows[0].best, rows[0].median, rows[0].spread) == (1.0, 1.0, 4.5)  # quartiles 1 and 5.5


def test_calls_take_turns_forwards_and_backwards():
    order = []
    times = in_turns({name: lambda name=name: order.append(name) for name in "ab"}, 3)
    assert "".join(order) == "ab" + "ab" + "ba" + "ab"
    assert all(len(each.turns) == 3 and each.best <= each.median for each in times.values())


def test_a_contest_divides_by_items_and_judges_what_was_returned():
    calls = [
        Contender("ours", "ours", lambda: 5, 10, lambda value: {"error": value - 4}),
        Contender("peer", "peer", lambda: 1, compiles=False),
    ]
    group = contest("t", "a thing", calls, 2)
    ours, peer = group.rows
    assert ours.accuracy == {"error": 1.0} and peer.accuracy == {}
    assert ours.first is not None and peer.first is None
    assert ours.first / 10 > 0 and len(ours.turns) == len(peer.turns) == 2


def test_a_report_comes_back_from_its_file(tmp_path):
    save(report(), tmp_path / "report.json")
    assert load(tmp_path / "report.json") == report()
    written = json.loads((tmp_path / "report.json").read_text())
    row = written["results"]["qp"]["groups"][0]["rows"][0]
    assert (row["best"], row["median"]) == (1e-6, 2e-6)
    assert row["peer_over_ours"] == {"peer": "other", "median": 2.0, "low": 2.0, "high": 2.0}


@pytest.mark.parametrize(
    "break_it",
    [
        lambda value: value.pop("results"),
        lambda value: value.update(layout=99),
        lambda value: value["machine"].pop("cores"),
        lambda value: value["results"]["qp"]["groups"][0]["rows"][0].update(turns=[]),
        lambda value: value["results"]["qp"]["groups"][0]["rows"][0].update(turns=["fast"]),
        lambda value: value["results"]["qp"]["groups"][0]["rows"][0].update(kind="theirs"),
        lambda value: value["results"].update(qp=[]),
    ],
)
def test_what_is_no_report_is_refused_with_a_sentence(tmp_path, break_it):
    file = tmp_path / "report.json"
    save(report(), file)
    value = json.loads(file.read_text())
    break_it(value)
    file.write_text(json.dumps(value))
    with pytest.raises(InputError, match=r"report\.json .*give the report\.json of"):
        load(file)


def test_text_that_is_no_json_is_refused(tmp_path):
    (tmp_path / "other.json").write_text("hello")
    with pytest.raises(InputError, match="is no JSON"):
        load(tmp_path / "other.json")


def test_a_faster_machine_is_no_change_and_slower_code_is():
    """Oracle: by hand. Both contenders twice as fast; then ours alone three times as slow."""
    before = report()
    (same,) = [each for each in changes(before, report((5e-7, 1e-6, 1.5e-6), (1e-6, 2e-6, 3e-6))) if "qp" in each.where]
    assert same.by_peer and same.change == pytest.approx(1.0) and same.verdict() == "within the noise"
    (worse,) = [each for each in changes(before, report((3e-6, 6e-6, 9e-6))) if "qp" in each.where]
    assert worse.change == pytest.approx(3.0) and worse.verdict() == "slower"
    (better,) = [each for each in changes(report((3e-6, 6e-6, 9e-6)), before) if "qp" in each.where]
    assert better.verdict() == "faster"


def test_a_change_as_wide_as_the_turns_is_within_the_noise():
    """Oracle: the same median, or 20 % beside it, in turns that differ by a factor of two."""
    before, now = report((1e-6, 2e-6, 4e-6), (2e-6,) * 3), report((1.2e-6, 2.4e-6, 4.8e-6), (2e-6,) * 3)
    (change,) = [each for each in changes(before, now) if "qp" in each.where]
    assert change.change == pytest.approx(1.2) and change.noise > 0.5 and change.verdict() == "within the noise"


def test_the_comparison_names_what_is_in_one_report_alone():
    alone = replace(report(), results={"qp": report().results["qp"]})
    text = comparison_text(report(), alone)
    assert "In one of the reports alone: floor." in text and "qp, programs in a row: ours" in text


def test_the_page_says_what_the_reader_must_know():
    text = page(report(), {"qp": "picture.png"})
    assert "| **ours**" in text and "2.00 [2.00, 2.00]" in text
    # The floor of 1000 bytes at 0.1 ns each is 100 ns; 2 us are twenty of them.
    (row,) = [line for line in text.splitlines() if line.startswith("| **ours**")]
    assert "| 20 " in row and "1.5 s" in row and "1.0e-06" in row
    assert "daqp. To get them: `pip install 'iwalker-jax[peers]'`" in text
    assert "![qp: medians of the contenders](picture.png)" in text and "1024 MiB" in text
    assert "faster than none of our rows" in text and "shared" not in text


def test_the_page_says_so_where_a_peer_is_faster():
    text = page(report(peer=(1e-7, 2e-7, 3e-7)), {})
    (row,) = [line for line in text.splitlines() if line.startswith("| qp ") and "other" in line]
    assert "| 0.10 [0.10, 0.10]" in row


def test_lines_of_the_page_can_be_read_side_by_side_and_code_stays_whole():
    command = "python -m benchmarks qp --out " + "a" * 70
    text = page(replace(report(), command=command), {})
    assert f"`{command}`" in text
    assert all(len(line) <= 120 or line.startswith("|") for line in text.splitlines())


@pytest.mark.parametrize(("load", "others"), [(1.5, 0.0), (0.0, 1.5)])
def test_the_page_says_so_where_the_machine_was_shared(load, others):
    assert "shared with other work" in page(report(load=load, others=others), {})


def test_a_failed_benchmark_is_on_the_page():
    failed = replace(report(), results={"qp": replace(report().results["qp"], failure="out of memory")})
    assert "It failed: out of memory" in page(failed, {})


def test_pictures_are_those_of_the_benchmarks_with_peers(tmp_path):
    names = picture_names(report(), "p")
    assert names == {"qp": "p_qp.png"}
    draw(report(), tmp_path, names)
    assert (tmp_path / "p_qp.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("seconds", "text"), [(2.5, "2.5 s"), (0.0123, "12.3 ms"), (1.7e-5, "17 us"), (3e-9, "3 ns"), (1234.0, "1234 s")]
)
def test_durations_have_a_unit(seconds, text):
    assert duration(seconds) == text


def test_a_table_without_peers_has_no_ratio():
    head = group_table(Group("t", "a step", (Row("ours", "ours", (1.0,)),))).splitlines()[0]
    assert "/ this" not in head and "floor" not in head


def test_the_published_page_is_written_from_the_figures_beside_it():
    """Property: page and JSON of the documentation cannot differ; its pictures are there."""
    docs = ROOT / "docs"
    published = load(docs / "performance.json")
    names = picture_names(published, "performance")
    assert (docs / "performance.md").read_text(encoding="utf-8") == page(published, names)
    assert names and all((docs / name).is_file() for name in names.values())

"""`python -m benchmarks`: listing, choosing, sentences, and failures that do not take the rest."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.__main__ import main
from benchmarks.suite import command as command_module
from benchmarks.suite import runs
from benchmarks.suite.alone import Options, present
from benchmarks.suite.extras import absent, missing_sentence, require
from benchmarks.suite.figures import Fact, Result, from_json
from benchmarks.suite.registry import BENCHMARKS, Benchmark, chosen
from benchmarks.suite.report import load, save
from iwalker_jax.errors import InputError
from tests.benchmarks.reports import report

ROOT = Path(__file__).resolve().parents[2]


def test_the_list_has_a_line_for_each(capsys):
    assert main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(BENCHMARKS)
    assert all(len(line) > 30 for line in lines)


def test_every_module_that_measures_is_in_the_list():
    """Oracle: the files."""
    files = [
        file for file in (ROOT / "benchmarks").rglob("*.py") if "\ndef measure(" in file.read_text(encoding="utf-8")
    ]
    modules = {".".join(file.relative_to(ROOT).with_suffix("").parts) for file in files}
    assert modules == {each.module for each in BENCHMARKS.values()}


def test_the_floor_is_measured_with_every_run():
    assert [each.name for each in chosen(("unicycle", "qp"), True)] == ["floor", "qp", "unicycle"]


def test_all_leaves_out_what_is_slow_or_wants_an_accelerator():
    quick, full = ({each.name for each in chosen(("all",), size)} for size in (True, False))
    assert quick < full and "accelerator" not in full and "closed_loop" in full - quick


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["qqp"], "There is no benchmark 'qqp'; choose of all, floor, qp"),
        (["qp", "--gpu"], "--gpu is a set of its own"),
        (["--compare", "nowhere.json"], "nowhere.json is missing"),
    ],
)
def test_bad_input_ends_in_a_sentence(arguments, sentence, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(arguments)
    assert sentence in capsys.readouterr().err


def fake(folder: Path, text: str, monkeypatch: pytest.MonkeyPatch) -> Benchmark:
    """A benchmark of some text, beside the others."""
    (folder / "made_up.py").write_text(text)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    return Benchmark("made up", "made_up")


def test_a_benchmark_that_fails_keeps_what_it_had(tmp_path, monkeypatch):
    text = (
        "from pathlib import Path\nimport json, sys\n"
        "figures = {'groups': [], 'facts': [{'name': 'first', 'value': 1.0, 'unit': ''}], 'missing': [],\n"
        "           'seconds': 1.0, 'peak_memory': 1.0, 'others': None, 'failure': ''}\n"
        "Path(sys.argv[sys.argv.index('--json') + 1]).write_text(json.dumps(figures))\n"
        "raise SystemExit('error: no more memory')\n"
    )
    result = runs.run_one(fake(tmp_path, text, monkeypatch), True)
    assert result.failure == "no more memory" and result.facts == (Fact("first", 1.0),)


def test_a_benchmark_that_takes_too_long_is_stopped(tmp_path, monkeypatch):
    slow = fake(tmp_path, "import time\ntime.sleep(60)\n", monkeypatch)._replace(limit=0.5)
    result = runs.run_one(slow, True)
    assert "stopped after 0.5 s" in result.failure


def test_a_run_writes_its_report_page_and_pictures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(runs, "run_one", lambda benchmark, quick: report().results[benchmark.name])
    out = tmp_path / "out"
    assert main(["qp", "--quick", "--out", str(out)]) == 0
    assert {file.name for file in out.iterdir()} == {"report.json", "performance.md", "performance_qp.png"}
    found = load(out / "report.json")
    assert found.command.endswith("benchmarks qp --quick") or "--out" in found.command
    assert found.results == report().results and found.size == "quick" and found.versions["jax"]
    save(report(), tmp_path / "other.json")
    assert main(["--out", str(out), "--compare", str(tmp_path / "other.json")]) == 0
    assert "within the noise" in capsys.readouterr().out


def test_publishing_writes_the_documentation(tmp_path, monkeypatch):
    docs = tmp_path / "docs"
    docs.mkdir()
    monkeypatch.setattr(command_module, "DOCUMENTATION", docs)
    save(report(), tmp_path / "report.json")
    command_module.publish(tmp_path)
    assert {file.name for file in docs.iterdir()} == {"performance.json", "performance.md", "performance_qp.png"}


def test_a_missing_peer_is_named_with_the_way_to_get_it(capsys):
    assert absent({"json": "json", "no_such_module": "no-such-package"}) == ("no-such-package",)
    assert missing_sentence(["daqp", "edt"]).endswith("daqp, edt. To get them: pip install 'iwalker-jax[peers]'")
    with pytest.raises(SystemExit, match="needs no_such_module; run: pip install"):
        require("json", "no_such_module")
    present([], Options(), ("daqp",))
    assert "Left out, because they are not installed: daqp." in capsys.readouterr().out


def test_figures_are_written_while_they_come(tmp_path, capsys):
    file = tmp_path / "figures.json"

    def figures():
        yield Fact("first", 1.0, "of 2")
        assert from_json(json.loads(file.read_text())).facts == (Fact("first", 1.0, "of 2"),)
        yield Fact("second", 2.0)

    present(figures(), Options(json=file))
    found = from_json(json.loads(file.read_text()))
    assert [fact.name for fact in found.facts] == ["first", "second"] and found.peak_memory > 1e6
    assert "1 of 2" in capsys.readouterr().out


def test_a_machine_without_an_accelerator_is_told_so():
    """Oracle: the platform that this process was given."""
    from benchmarks.accelerator import accelerator

    assert accelerator(anyway=True).platform == "cpu"
    with pytest.raises(InputError, match="JAX sees no accelerator here"):
        accelerator(anyway=False)


def test_the_accelerators_set_ends_in_that_sentence_and_writes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(runs, "run_one", lambda benchmark, quick: Result(failure="JAX sees no accelerator here."))
    with pytest.raises(SystemExit):
        main(["--gpu", "--out", str(tmp_path / "out")])
    assert "error: JAX sees no accelerator here." in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_command_starts_from_any_folder(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks"],
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT), "PATH": "", "HOME": str(tmp_path), "JAX_PLATFORMS": "cpu"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("floor ")

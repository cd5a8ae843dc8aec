"""Notebooks are in step with their scripts, committed with their pictures, and shown by the page."""

import re
from pathlib import Path

import nbformat
import pytest

from experiments.notebooks.refresh import SCRIPTS, noise, read_script
from tests.docs.pages import ROOT
from tests.notebooks.runs import pictures

LARGEST = 400_000
"""[bytes] of a committed notebook."""

by_notebook = pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)


def test_every_notebook_is_run_by_a_test_and_shown_by_the_page():
    tests = "".join(file.read_text(encoding="utf-8") for file in Path(__file__).parent.glob("test_*.py"))
    page = (ROOT / "docs" / "notebooks.md").read_text(encoding="utf-8")
    for script in SCRIPTS:
        assert f'found_by("{script.stem}"' in re.sub(r"\(\s+", "(", tests)
        assert f"(../experiments/notebooks/{script.stem}.ipynb)" in page


@by_notebook
def test_script_and_notebook_are_in_step(script):
    """Oracle: jupytext's own reading of the script."""
    committed = nbformat.read(script.with_suffix(".ipynb"), as_version=4)
    nbformat.validate(committed)
    wanted = read_script(script)

    def content(notebook):
        return [(cell.cell_type, cell.source, cell.metadata.get("tags", [])) for cell in notebook.cells]

    assert content(committed) == content(wanted), "run python -m experiments.notebooks.refresh " + script.stem
    assert committed.metadata.kernelspec == wanted.metadata.kernelspec


@by_notebook
def test_committed_outputs_are_whole_and_hold_pictures(script):
    """No error, nothing on the error stream, every code cell run in order, and pictures that show something."""
    file = script.with_suffix(".ipynb")
    notebook = nbformat.read(file, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    kinds = {output.output_type for cell in code for output in cell.outputs}
    assert "error" not in kinds and noise(notebook) == []
    shown = pictures(notebook)
    assert len(shown) >= 2
    for picture in shown:
        assert min(picture.shape[:2]) > 150 and picture.std() > 5
    assert file.stat().st_size < LARGEST


@by_notebook
def test_notebooks_say_why_and_end_in_something_to_try(script):
    cells = read_script(script).cells
    words = [cell.source for cell in cells if cell.cell_type == "markdown"]
    assert words[0].startswith("# ") and "## Try" in words[-1]
    first = next(cell.source for cell in cells if cell.cell_type == "code")
    assert "iw.configure_runtime()" in first and "import jax" not in first


def test_a_parameter_that_a_notebook_does_not_have_is_refused():
    with pytest.raises(ValueError, match="has no parameters NOTHING"):
        read_script(SCRIPTS[0], {"NOTHING": 1})

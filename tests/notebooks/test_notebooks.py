"""Notebooks are in step with their scripts, committed with their pictures, and run on small settings.

Each run ends in a cell of ours that tells what the notebook found; what it is held against is computed here by other
means, named in each test.
"""

import base64
import json
import os
from pathlib import Path

import cv2
import nbformat
import numpy as np
import pytest
import scipy

from experiments.notebooks.refresh import SCRIPTS, noise, read_script, run
from tests.docs.pages import ROOT

LARGEST = 400_000
"""[bytes] of a committed notebook."""

ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"} | {"PYTHONPATH": str(ROOT)}
"""Of a user's kernel: without the devices that this test run has asked for."""

by_notebook = pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)


def found_by(name: str, folder: Path, parameters: dict, tells: str) -> dict:
    """What a notebook tells of itself after a run on small settings, in which no cell fails or writes an error.

    Args:
        name: of the notebook.
        folder: that it runs in.
        parameters: in the place of its own.
        tells: Python of a dictionary of numbers and arrays, in the notebook's names.
    """
    (script,) = (script for script in SCRIPTS if script.stem == name)
    notebook = read_script(script, parameters)
    last = f"import json\nprint(json.dumps({tells}, default=lambda array: np.asarray(array).tolist()))"
    notebook.cells.append(nbformat.v4.new_code_cell(last))
    notebook = run(notebook, folder, ENVIRONMENT)
    assert noise(notebook) == []
    return json.loads(notebook.cells[-1].outputs[0].text)


def pictures(notebook: nbformat.NotebookNode) -> list[np.ndarray]:
    """The PNG outputs of a notebook, decoded."""
    data = [output.data for cell in notebook.cells for output in cell.get("outputs", ()) if "data" in output]
    coded = [base64.b64decode(each["image/png"]) for each in data if "image/png" in each]
    return [cv2.imdecode(np.frombuffer(each, np.uint8), cv2.IMREAD_COLOR) for each in coded]


def test_every_notebook_is_run_by_a_test_and_shown_by_the_page():
    tests = Path(__file__).read_text(encoding="utf-8")
    page = (ROOT / "docs" / "notebooks.md").read_text(encoding="utf-8")
    for script in SCRIPTS:
        assert f'found_by("{script.stem}"' in tests.replace("\n        ", "")
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


def test_unicycle_gradients(tmp_path):
    """Oracle: the motion and its cost in NumPy, and SciPy's least squares, which finds nothing better."""
    found = found_by(
        "unicycle_gradients",
        tmp_path,
        {"PROBES": 5, "ITERATIONS": [1], "DESCENT_STEPS": 60},
        "{'path': path, 'start': start, 'controls': plan.controls, 'cost': plan.cost, 'errors': errors, "
        "'losses': {mode: losses for mode, (_, losses) in learned.items()}}",
    )
    path, start = np.array(found["path"]), np.array(found["start"])

    def residuals(controls):
        omega, acceleration = controls.reshape(-1, 2).T
        theta = start[3] + np.concatenate([[0], np.cumsum(omega)])
        speed = start[2] + np.concatenate([[0], np.cumsum(acceleration)])
        steps = (speed * [np.cos(theta), np.sin(theta)])[:, :-1]
        places = start[:2, None] + np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1)
        return np.concatenate([(places.T - path).ravel(), 1000**0.5 * omega, 5000**0.5 * acceleration])

    controls = np.array(found["controls"]).ravel()
    assert np.sum(residuals(controls) ** 2) == pytest.approx(found["cost"], rel=1e-4)
    best = scipy.optimize.least_squares(residuals, controls, max_nfev=20)
    assert 2 * best.cost == pytest.approx(found["cost"], rel=1e-4)
    errors, losses = found["errors"], found["losses"]
    assert max(errors["implicit"], errors["unrolled"]) < 1e-6 and errors["stopped"] > 0.1
    assert losses["implicit"][-1] < losses["stopped"][-1]


def test_hlip_steps(tmp_path):
    """Oracle: the matrix exponential of the pendulum's motion, and hand arithmetic."""
    found = found_by(
        "hlip_steps",
        tmp_path,
        {"SPEED": 0.25, "STEPS": 8},
        "{'A': matrix, 'B': column, 'step': forward_u, 'runaway': runaway, 'slopes': slopes}",
    )
    fall = scipy.linalg.expm(0.24 * np.array([[0.0, 1.0], [9.81 / 0.365, 0.0]]))
    np.testing.assert_allclose(np.array(found["A"])[1:, 1:], fall, rtol=1e-5)
    np.testing.assert_allclose(found["B"][1:], -fall[:, 0], rtol=1e-5)
    assert found["step"] == pytest.approx(0.25 * 0.24)
    away = {name: np.abs(positions) for name, positions in found["runaway"].items()}
    assert away["ours"].max() < 0.2 and away["within reach"].max() < 0.2
    # The larger eigenvalue of the fall is what the COM runs away by.
    growth = away["published"][-1, 0] / away["published"][-2, 0]
    assert growth == pytest.approx(np.exp(0.24 * (9.81 / 0.365) ** 0.5), rel=0.02)
    assert found["slopes"]["published"][0][2] == 0.0 and found["slopes"]["ours"][0][2] > 0.05

"""Notebooks run on small settings, and what they show."""

import base64
import json
import os
from pathlib import Path

import cv2
import nbformat
import numpy as np

from experiments.notebooks.refresh import SCRIPTS, noise, read_script, run
from tests.docs.pages import ROOT

ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"} | {"PYTHONPATH": str(ROOT)}
"""Of a user's kernel: without the devices that this test run has asked for."""


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
    last = f"""import json
with open("told.json", "w") as file:
    json.dump({tells}, file, default=lambda array: np.asarray(array).tolist())
"""
    notebook.cells.append(nbformat.v4.new_code_cell(last))
    notebook = run(notebook, folder, ENVIRONMENT)
    assert noise(notebook) == []
    return json.loads((folder / "told.json").read_text(encoding="utf-8"))


def pictures(notebook: nbformat.NotebookNode) -> list[np.ndarray]:
    """The PNG outputs of a notebook, decoded."""
    data = [output.data for cell in notebook.cells for output in cell.get("outputs", ()) if "data" in output]
    coded = [base64.b64decode(each["image/png"]) for each in data if "image/png" in each]
    return [cv2.imdecode(np.frombuffer(each, np.uint8), cv2.IMREAD_COLOR) for each in coded]

"""Blocks of the pages run: Python as a reader would type it, files as the project's own readers take them."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from iwalker_jax.control import check_footsteps, load_footsteps
from iwalker_jax.data.recordings import load_recording, validate_recording
from iwalker_jax.optimization.steps.reach import StepReach
from iwalker_jax.walking import load_path
from tests.docs.pages import PAGES, ROOT, fenced_blocks
from tests.docs.user_files import write_depth_image, write_recording

README, RECORDINGS, WALKING = ROOT / "README.md", ROOT / "docs" / "recordings.md", ROOT / "docs" / "walking.md"


def python_of(page: Path) -> str:
    """The Python blocks of a page as one script, whose lines keep the page's numbers."""
    lines: list[str] = []
    for block in fenced_blocks(page):
        if block.language == "python":
            lines += [""] * (block.line - 1 - len(lines)) + block.text.splitlines()
    return "\n".join(lines)


def run_module(module: str, *arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own, started in a folder."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    command = [sys.executable, *(["-m", module] if not module.endswith(".py") else [module]), *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=500)


WITH_PYTHON = [page for page in PAGES if python_of(page) and page != README]


@pytest.mark.parametrize("page", WITH_PYTHON, ids=lambda page: page.stem)
def test_python_blocks_run_in_order(page, tmp_path):
    """In a fresh process, in a folder that holds the reader's files."""
    write_depth_image(tmp_path / "depth.png")
    script = tmp_path / f"{page.stem}.py"
    script.write_text(python_of(page), encoding="utf-8")
    ended = run_module(str(script), folder=tmp_path)
    assert ended.returncode == 0, f"{page.name} (lines as in the page):\n{ended.stderr[-3000:]}"


def test_the_readmes_example_is_short_and_draws(tmp_path):
    """One depth image to a drawn path with footsteps in at most ten lines; the picture is one."""
    write_depth_image(tmp_path / "depth.png")
    script = tmp_path / "example.py"
    script.write_text(python_of(README), encoding="utf-8")
    assert len([line for line in script.read_text(encoding="utf-8").splitlines() if line.strip()]) <= 10
    ended = run_module(str(script), folder=tmp_path)
    assert ended.returncode == 0, ended.stderr[-3000:]
    assert len(ended.stdout.splitlines()) == 20
    picture = cv2.imread(str(tmp_path / "plan.png"))
    assert picture is not None and min(picture.shape[:2]) > 300 and picture.std() > 20


def test_the_recording_of_the_page_is_usable(tmp_path):
    """recording.yaml as printed, read by the library and by the command that the page recommends."""
    write_recording(tmp_path / "recording", RECORDINGS)
    report = validate_recording(tmp_path / "recording")
    assert report.is_usable and not report.problems
    recording = load_recording(tmp_path / "recording")
    assert len(recording) == 3
    ended = run_module("experiments.validate_recording", "recording", folder=tmp_path)
    assert ended.returncode == 0, ended.stdout + ended.stderr


def test_footsteps_and_path_of_the_page_can_be_walked(tmp_path):
    """Both files as printed, read and checked by what the walking command uses."""
    footsteps, path = (block.text for block in fenced_blocks(WALKING) if block.language == "csv")
    (tmp_path / "footsteps.csv").write_text(footsteps)
    (tmp_path / "path.csv").write_text(path)
    positions, yaws, first = load_footsteps(tmp_path / "footsteps.csv")
    check_footsteps(positions, yaws, first, StepReach())
    assert np.allclose(load_path(tmp_path / "path.csv")[0], 0.0)


def test_the_models_generator_finds_its_file_up_to_date():
    """The README's generator, asked only to compare."""
    assert run_module("bruce_model.generate", "--check", folder=ROOT).returncode == 0

"""Every example runs as its user runs it, from a folder of its own, and says and writes what it promises."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.examples.example_runs import EXAMPLES, is_picture, numbers, run

LONGEST = 60
"""Lines of an example at most."""


def test_examples_are_short_and_explained_and_all_are_run():
    tests = "".join(file.read_text(encoding="utf-8") for file in Path(__file__).parent.glob("test_*.py"))
    tested = set(re.findall(r'run\("(\w+)"', tests))
    assert tested == {file.stem for file in EXAMPLES.glob("*.py")}
    for file in EXAMPLES.glob("*.py"):
        text = file.read_text(encoding="utf-8")
        assert text.startswith('"""') and f"examples/{file.name}" in text.split('"""')[1], file.name
        assert len(text.splitlines()) < LONGEST, file.name


def test_plan_from_depth(tmp_path):
    text = run("plan_from_depth", tmp_path)
    assert len(re.findall(r"^Footstep \d \((left|right)\)", text, re.MULTILINE)) == 4
    assert 1.0 < numbers(text)[0] < 5.0
    assert is_picture(tmp_path / "runs/examples/plan.png")
    depth = tmp_path / "runs/examples/depth.png"
    own = run("plan_from_depth", tmp_path, "--file", str(depth), "--goal", "2", "-0.5", "--out", "own")
    assert is_picture(tmp_path / "own/plan.png") and not (tmp_path / "own/depth.png").exists()
    assert own.splitlines()[:5] != text.splitlines()[:5]


def test_mpc_gradients(tmp_path):
    text = run("mpc_gradients", tmp_path)
    for mpc in text.split("Step MPC:"):
        implicit, unrolled, stopped = (
            float(re.search(rf"{mode}.*\|gradient\| (\S+)", mpc)[1]) for mode in ("implicit", "unrolled", "stopped")
        )
        assert implicit == pytest.approx(unrolled, rel=1e-3)
        assert stopped < 0.5 * implicit


def test_quadratic_program(tmp_path):
    text = run("quadratic_program", tmp_path)
    # The nearest point to (0.9, 1.4) with x0 + x1 <= 1.5 and x <= 1, by hand: (0.5, 1.0).
    np.testing.assert_allclose(numbers(re.search(r"x = \[(.*?)\]", text)[1]), [0.5, 1.0], atol=1e-5)
    assert "dx/dtarget inside the bounds = [[1.0, 0.0], [0.0, 1.0]]" in text
    assert "No point satisfies all constraints" in text and "'half-plane'" in text


def test_local_map(tmp_path):
    text = run("local_map", tmp_path, "--out", "maps")
    shares = [float(share) for share in re.findall(r": (\S+) % of 160 x 160", text)]
    assert sum(shares) == pytest.approx(100.0, abs=0.2) and min(shares) > 0
    assert is_picture(tmp_path / "maps/local_map.png")


def test_hlip_orbits(tmp_path):
    text = run("hlip_orbits", tmp_path, "--speed", "0.25")
    # A step of the period-one orbit is the speed times the step time, 0.24 s.
    assert "step 0.0600 m" in text
    for line in text.splitlines()[2:]:
        errors = [abs(error) for error in numbers(line.split("each step")[1])]
        assert errors[-1] < 0.002 and errors == sorted(errors, reverse=True)


def test_distance_and_cost_to_go(tmp_path):
    text = run("distance_and_cost_to_go", tmp_path)
    grid = [list(line) for line in text.splitlines() if set(line) <= set(".#SG*")]
    drawn = (EXAMPLES / "distance_and_cost_to_go.py").read_text(encoding="utf-8").split('"""')[3]
    assert len(grid) == 10 and sum(line.count("*") for line in grid) > 15
    assert sum(line.count("#") for line in grid) == drawn.count("#")
    assert "Converged" in text

"""The command that shows simulated beside real depth, run as a user runs it."""

import subprocess
import sys

import cv2
import numpy as np

COMMAND = [sys.executable, "-m", "experiments.show_depth_noise", "--families", "corridor_doors", "--output"]


def test_figures_and_picture_beside_real_frames(tmp_path):
    rng = np.random.default_rng(0)
    for index in range(5):
        frame = rng.normal(2500.0, 20.0, (48, 64)).astype(np.uint16)
        cv2.imwrite(str(tmp_path / f"{index}.png"), frame)
    picture = tmp_path / "out" / "noise.jpg"
    run = subprocess.run(
        [*COMMAND, str(picture), "--real", str(tmp_path)], capture_output=True, text=True, timeout=200, check=False
    )
    assert run.returncode == 0, run.stderr
    row = next(line for line in run.stdout.splitlines() if "2-3 m" in line)
    # The median of the standard deviation of four frames with sigma 20 mm is 0.89 sigma.
    assert "simulated" in run.stdout and 16 <= int(row.split("/")[-2].split()[-1]) <= 20
    drawn = cv2.imread(str(picture))
    assert drawn is not None and drawn.std() > 10


def test_a_folder_without_frames_is_one_sentence(tmp_path):
    run = subprocess.run(
        [*COMMAND, str(tmp_path / "x.png"), "--real", str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert run.returncode == 1
    assert "at least 4 PNG depth images" in run.stderr and "Traceback" not in run.stderr

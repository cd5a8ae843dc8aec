"""Notebooks of solvers and images, run on small settings in which no cell fails or warns.

Each run ends in a cell of ours that tells what the notebook found; what it is held against is computed here by other
means, named in each test.
"""

import cv2
import numpy as np
import pytest
import scipy

from tests.notebooks.runs import found_by


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


def test_depth_to_distance(tmp_path):
    """Oracle: SciPy's exact distance transform; central differences, which the notebook takes."""
    found = found_by(
        "depth_to_distance",
        tmp_path,
        {"SCENE": "office", "DESCENT_STEPS": 50},
        "{'occupied': hard.occupied, 'esdf': hard.esdf, 'along': along, 'differences': differences, 'costs': costs}",
    )
    occupied = np.array(found["occupied"])
    outside = scipy.ndimage.distance_transform_edt(~occupied) - 0.5
    inside = 0.5 - scipy.ndimage.distance_transform_edt(occupied)
    np.testing.assert_allclose(found["esdf"], 0.05 * np.where(occupied, inside, outside), atol=1e-4)
    assert found["differences"]["0.005"] == pytest.approx(found["along"], rel=0.1)
    assert found["costs"][-1] < found["costs"][0]


def test_own_camera(tmp_path):
    """Oracle: the stored PNG read by OpenCV and looked up pixel by pixel; the mount that the images were made with."""
    found = found_by(
        "own_camera",
        tmp_path,
        {"IMAGES": 3},
        "{'usable': len(report.usable), 'mount': report.mount, 'seen': seen, 'frames': len(frames)}",
    )
    assert found["usable"] == found["frames"] == 2
    np.testing.assert_allclose(found["mount"][:3], [0.62, np.deg2rad(18.9), np.deg2rad(10.4)], atol=0.01)
    stored = cv2.imread(str(tmp_path / "runs/recording/depth/000000.png"), cv2.IMREAD_UNCHANGED)
    for v, u in ((60, 80), (75, 40), (70, 120)):
        row, column = round(383.8 * (v - 44.5) / 80 + 236.8), round(383.8 * (u - 79.5) / 80 + 321.7)
        assert found["seen"][v][u] == pytest.approx(stored[row, column] / 1000, abs=1e-6)


def test_train_in_ten_minutes(tmp_path):
    """Oracle: hand arithmetic of steps and sums, and the files that a run leaves."""
    found = found_by(
        "train_in_ten_minutes",
        tmp_path,
        {"FRAMES": 16, "EPOCHS": 1, "BATCH": 8},
        "{'metrics': [{k: line[k] for k in ('total', 'U_path', 'U_step', 'converged')} for line in metrics], "
        "'ends': list(ends.values())}",
    )
    assert len(found["metrics"]) == 1 * (16 // 8)
    for line in found["metrics"]:
        assert line["total"] == pytest.approx(line["U_path"] + line["U_step"], rel=1e-4) and line["converged"] > 0.5
    assert np.shape(found["ends"]) == (6, 2) and np.isfinite(found["ends"]).all()
    assert (tmp_path / "runs/ten_minutes/checkpoints").is_dir()

"""Notebooks of the robot, run on small settings in which no cell fails or warns; oracles as in `test_runs`."""

import mujoco
import numpy as np
import pytest
import quadprog

from bruce_model import load_mujoco
from tests.notebooks.runs import found_by


def test_qp_and_torques(tmp_path):
    """Oracle: quadprog on the program that the notebook opened."""
    found = found_by(
        "qp_and_torques",
        tmp_path,
        {"SECONDS": 1.82},
        "{'P': info.program.P, 'q': info.program.q, 'C': info.program.C, 'low': info.program.low, "
        "'high': info.program.high, 'x': info.solution.value.x, 'costs': costs}",
    )
    P, q, C, low, high = (np.array(found[name], float) for name in ("P", "q", "C", "low", "high"))
    rows = np.concatenate([C[np.isfinite(low)], -C[np.isfinite(high)]])
    bounds = np.concatenate([low[np.isfinite(low)], -high[np.isfinite(high)]])
    x = quadprog.solve_qp((P + P.T) / 2, -q, rows.T, bounds)[0]
    np.testing.assert_allclose(found["x"], x, atol=1e-2 * np.abs(x).max())
    assert found["costs"][0] == pytest.approx(x @ P @ x / 2 + q @ x, rel=1e-3)
    assert np.all(np.diff(found["costs"]) > -1e-2)


def test_contact_gradients(tmp_path):
    """Oracle: C MuJoCo's step, differenced here; whole ticks against differences, which the notebook takes."""
    found = found_by(
        "contact_gradients",
        tmp_path,
        {"HEIGHTS": 9},
        "{'jacobian': jacobian, 'torques': torques, 'standing': standing, 'ticks': ticks_errors}",
    )
    model = load_mujoco()

    def step(torques):
        data = mujoco.MjData(model)
        data.qpos[:], data.ctrl[:] = found["standing"], torques
        mujoco.mj_step(model, data)
        return data.qvel.copy()

    jacobian, torques = np.array(found["jacobian"]), np.array(found["torques"])
    for motor in (3, 8, 12):
        nudge = 1e-5 * np.eye(len(torques))[motor]
        numeric = (step(torques + nudge) - step(torques - nudge)) / 2e-5
        np.testing.assert_allclose(jacobian[:, motor], numeric, atol=1e-7 * np.abs(jacobian).max())
    assert len(found["ticks"]) == 6 and max(found["ticks"].values()) < 1e-5


def test_closed_loop(tmp_path):
    """Oracle: the frame rate and the time limit, counted by hand, and the base's way from the recorded joints."""
    found = found_by(
        "closed_loop",
        tmp_path,
        {"TASK": "corridor", "TIME_LIMIT": 2.0, "FRAMES": 2},
        "{'time': record.time, 'outcome': metrics.outcome.name, 'torso': record.qpos[:, :2], "
        "'base': record.base[:, :2], 'depth': record.depth.shape, 'drift': drift}",
    )
    # A frame is 33 ticks of 2 ms; that the time is over is noticed at a frame's beginning, and recorded at its end.
    assert found["outcome"] == "TIMED_OUT" and 2.0 <= found["time"][-1] <= 2.0 + 2 * 0.066
    np.testing.assert_allclose(np.diff(found["time"]), 0.066, atol=1e-3)
    assert found["depth"] == [len(found["time"]), 90, 160]
    # The base frame lies below the COM, a few centimetres from the torso's origin.
    np.testing.assert_allclose(found["torso"], found["base"], atol=0.06)
    assert 0 < max(found["drift"]) < 0.2

"""Resampled and smoothed motions against SciPy."""

import mujoco
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, Slerp

from iwalker_jax.film.recorded_motion import resample_motion, smooth_track

MODEL = mujoco.MjModel.from_xml_string(
    """
<mujoco>
  <worldbody>
    <body><freejoint/><geom size="0.1"/>
      <body><joint/><geom size="0.1"/>
        <body><joint type="ball"/><geom size="0.1"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
)
BASE, HINGE, BALL = slice(3, 7), 7, slice(8, 12)


@pytest.fixture
def motion() -> tuple[np.ndarray, np.ndarray]:
    """Turning bodies at 500 Hz; quaternions of random sign."""
    times = 3.0 + np.linspace(0.0, 1.0, 501)
    qpos = np.zeros((501, MODEL.nq))
    qpos[:, 0], qpos[:, HINGE] = 0.3 * times, np.sin(times)
    rng = np.random.default_rng(0)
    for part, axis in ((BASE, [0.0, 0.6, 2.0]), (BALL, [1.5, 0.0, 0.0])):
        turned = Rotation.from_rotvec(np.outer(times, axis)).as_quat(scalar_first=True)
        qpos[:, part] = turned * rng.choice([-1.0, 1.0], size=(501, 1))
    return qpos, times


def test_resampled_configurations_match_slerp_and_interp(motion):
    qpos, times = motion
    at = np.sort(np.random.default_rng(1).uniform(times[0], times[-1], 200))
    result = resample_motion(MODEL, qpos, times, at)
    np.testing.assert_allclose(result[:, 0], np.interp(at, times, qpos[:, 0]), atol=1e-12)
    np.testing.assert_allclose(result[:, HINGE], np.interp(at, times, qpos[:, HINGE]), atol=1e-12)
    for part in (BASE, BALL):
        np.testing.assert_allclose(np.linalg.norm(result[:, part], axis=1), 1.0, atol=1e-12)
        exact = Slerp(times, Rotation.from_quat(qpos[:, part], scalar_first=True))(at)
        apart = (exact.inv() * Rotation.from_quat(result[:, part], scalar_first=True)).magnitude()
        assert apart.max() < 1e-9


def test_recorded_instants_are_kept_and_the_ends_hold(motion):
    qpos, times = motion
    at = np.concatenate([[times[0] - 1.0], times, [times[-1] + 1.0]])
    expected = np.concatenate([qpos[:1], qpos, qpos[-1:]])
    result = resample_motion(MODEL, qpos, times, at)
    for part in (BASE, BALL):
        expected[:, part] *= np.sign(np.sum(expected[:, part] * result[:, part], axis=1, keepdims=True))
    np.testing.assert_allclose(result, expected, atol=1e-9)


def test_a_track_is_smoothed_as_by_scipy_and_a_steady_one_is_kept():
    rng = np.random.default_rng(2)
    points, period = np.cumsum(rng.standard_normal((200, 2)), axis=0), 1 / 30
    smooth = smooth_track(points, period, deviation=0.25)
    inside = slice(30, -30)
    expected = gaussian_filter1d(points, 0.25 / period, axis=0, radius=23)[inside]
    np.testing.assert_allclose(smooth[inside], expected, atol=1e-9)
    line = np.outer(np.arange(50) * period, [0.15, -0.05, 0.0])
    np.testing.assert_allclose(smooth_track(line, period), line, atol=1e-12)
    np.testing.assert_array_equal(smooth_track(points[:1], period), points[:1])

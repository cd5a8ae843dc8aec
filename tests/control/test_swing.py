"""Swing trajectories against NumPy's polynomial solver and finite differences."""

import jax.numpy as jnp
import numpy as np

from iwalker_jax.control.swing import TrajectoryPoint, advance_towards, rise_and_fall


def quintic(start: tuple, end: tuple, span: float) -> np.ndarray:
    """Coefficients (lowest first) of the quintic with the given position, velocity, acceleration at both ends."""
    rows, values = [], []
    for t, point in ((0.0, start), (span, end)):
        rows.append([t**k for k in range(6)])
        rows.append([k * t ** (k - 1) if k else 0.0 for k in range(6)])
        rows.append([k * (k - 1) * t ** (k - 2) if k > 1 else 0.0 for k in range(6)])
        values += list(point)
    return np.linalg.solve(rows, values)


def test_ticks_stay_on_the_quintic_of_numpy_and_arrive_at_rest(x64):
    start, span, dt = (0.3, -0.5, 2.0), 0.24, 0.002
    coefficients = np.polynomial.Polynomial(quintic(start, (0.42, 0.0, 0.0), span))
    motion = TrajectoryPoint(*(jnp.asarray([x]) for x in start))
    for k in range(115):
        motion = advance_towards(motion, jnp.asarray([0.42]), jnp.asarray(span - k * dt), dt)
        t = (k + 1) * dt
        np.testing.assert_allclose(motion.position[0], coefficients(t), atol=1e-9)
        np.testing.assert_allclose(motion.velocity[0], coefficients.deriv()(t), atol=1e-7)
        np.testing.assert_allclose(motion.acceleration[0], coefficients.deriv(2)(t), atol=1e-5)


def test_a_moved_target_is_still_reached(x64):
    span, dt = 0.24, 0.002
    motion = TrajectoryPoint(jnp.zeros(2), jnp.zeros(2), jnp.zeros(2))
    for k in range(120):
        target = jnp.asarray([0.1, -0.05]) if k < 70 else jnp.asarray([0.14, -0.02])
        motion = advance_towards(motion, target, jnp.asarray(span - k * dt), dt)
    np.testing.assert_allclose(motion.position, [0.14, -0.02], atol=2e-4)
    assert np.abs(motion.velocity).max() < 0.1


def test_the_last_instants_stay_finite_in_single_precision():
    motion = TrajectoryPoint(jnp.asarray([3.0]), jnp.asarray([0.01]), jnp.asarray([0.1]))
    for remaining in (0.004, 0.002, 0.0, -0.002):
        motion = advance_towards(motion, jnp.asarray([3.001]), jnp.asarray(remaining), 0.002)
        assert all(np.isfinite(x).all() for x in motion)
        assert np.abs(motion.acceleration).max() < 200.0


def test_rise_and_fall_passes_its_marks_with_consistent_derivatives(x64):
    def at(phase: float) -> TrajectoryPoint:
        return rise_and_fall(jnp.asarray(phase), jnp.asarray(1 / 0.24), jnp.asarray(0.004), 0.03, 0.1, 0.24)

    np.testing.assert_allclose([at(0.0).position, at(0.5).position, at(1.0).position], [0.004, 0.03, 0.0], atol=1e-12)
    np.testing.assert_allclose([at(0.0).velocity, at(0.5).velocity, at(1.0).velocity], [0, 0, -0.1], atol=1e-9)
    np.testing.assert_allclose(at(0.5 - 1e-9).acceleration, at(0.5).acceleration, rtol=1e-6)
    for phase in (0.1, 0.3, 0.6, 0.9):
        step = 1e-5
        slope = (at(phase + step).position - at(phase - step).position) / (2 * step) / 0.24
        bend = (at(phase + step).velocity - at(phase - step).velocity) / (2 * step) / 0.24
        np.testing.assert_allclose(at(phase).velocity, slope, atol=1e-7)
        np.testing.assert_allclose(at(phase).acceleration, bend, atol=1e-5)
    heights = [float(at(s).position) for s in np.linspace(0.1, 0.95, 30)]
    assert min(heights) > 0.0
    assert max(heights) <= 0.03 + 1e-9

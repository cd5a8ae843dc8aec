"""The linear Kalman filter against its textbook form, and against simulated data."""

import jax
import jax.numpy as jnp
import numpy as np

from iwalker_jax.estimation import axis_filter
from iwalker_jax.estimation.axis_filter import (
    BIAS,
    CONSIDERED,
    LEFT_FOOT,
    POSITION,
    RIGHT_FOOT,
    STATES,
    VELOCITY,
    Belief,
)
from iwalker_jax.estimation.axis_filter import DRIFT as ODOMETRY_DRIFT

PERIOD = 0.002
DRIFT = np.array([0, 0, 0.05, 0.004, 0.5, 0, 0.004]) ** 2 * PERIOD
ACCELERATION_STD = 0.5
MEASUREMENTS = (
    ((RIGHT_FOOT,), 1e-3),
    ((LEFT_FOOT,), 1e-3),
    ((VELOCITY,), 0.1),
    ((POSITION, ODOMETRY_DRIFT), 5e-3),
    ((POSITION, RIGHT_FOOT), 4e-3),
)
DEPTH, GRAVITY = -0.4, 9.81


def dense_transition(dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and input column, written out again."""
    f = np.array(
        [
            [1, dt, -(dt**2) / 2, 0, 0, 0, 0],
            [0, 1, -dt, 0, 0, 0, 0],
            [0, 0, 1, 0, 0, 0, 0],
            [0, -dt, dt**2 / 2, 1, 0, 0, 0],
            [0, -dt, dt**2 / 2, 0, 1, 0, 0],
            [0, 0, 0, 0, 0, 1, 0],
            [0, 0, 0, 0, 0, 0, 1],
        ]
    )
    return f, np.array([dt**2 / 2, dt, 0, -(dt**2) / 2, -(dt**2) / 2, 0, 0])


def measured_row(rows: tuple[int, ...]) -> np.ndarray:
    """(2, 7) rows, written again; horizontally, a foot 0.4 m below the base is seen through the tilt (b - c) / g."""
    row = np.tile(np.isin(np.arange(STATES), rows).astype(float), (2, 1))
    if rows in ((RIGHT_FOOT,), (LEFT_FOOT,)):
        row[0, [BIAS, CONSIDERED]] = DEPTH / GRAVITY, -DEPTH / GRAVITY
    return row


def test_rows():
    """Oracle: the rows by hand."""
    for rows, _ in MEASUREMENTS[2:]:
        np.testing.assert_array_equal(axis_filter.measures(*rows), measured_row(rows))
    for foot in (RIGHT_FOOT, LEFT_FOOT):
        row = axis_filter.measures_foot(foot, jnp.asarray(-DEPTH), GRAVITY)
        np.testing.assert_allclose(row, measured_row((foot,)), rtol=1e-6)


def random_belief(rng) -> Belief:
    root = rng.normal(size=(2, 7, 7)) * np.array([1e-2, 5e-2, 1e-1, 1e-2, 1e-2, 5e-2, 1e-2])[:, None]
    covariance = root @ np.swapaxes(root, 1, 2) + 1e-6 * np.eye(STATES)
    return Belief(jnp.asarray(rng.normal(size=(STATES, 3))), jnp.asarray(covariance))


def test_predict_and_update_equal_the_textbook(x64):
    """Oracle: dense Kalman filter in NumPy with the Joseph form, one axis at a time, whose gain for c is zero."""
    rng = np.random.default_rng(0)
    belief, acceleration = random_belief(rng), rng.normal(size=3)
    f, g = dense_transition(PERIOD)
    means = [np.asarray(belief.mean)[:, axis] for axis in range(3)]
    covariances = [np.asarray(belief.covariance)[group] for group in (0, 0, 1)]
    belief = axis_filter.predict(belief, jnp.asarray(acceleration), PERIOD, ACCELERATION_STD**2, jnp.asarray(DRIFT))
    for axis in range(3):
        means[axis] = f @ means[axis] + g * acceleration[axis]
        covariances[axis] = f @ covariances[axis] @ f.T + ACCELERATION_STD**2 * np.outer(g, g) + np.diag(DRIFT)
    for rows, std in MEASUREMENTS:
        innovation = rng.normal(size=3) * 0.01
        belief, _ = axis_filter.update(
            belief,
            jnp.asarray(measured_row(rows)),
            jnp.asarray(innovation),
            jnp.asarray(std**2),
            jnp.asarray([1.0, 0.5]),
            1e9,
        )
        for axis, weight in enumerate((1.0, 1.0, 0.5)):
            h = measured_row(rows)[axis // 2]
            p, r = covariances[axis], std**2 / weight
            k = p @ h / (h @ p @ h + r) * (np.arange(STATES) != CONSIDERED)
            means[axis] = means[axis] + k * innovation[axis]
            joseph = np.eye(STATES) - np.outer(k, h)
            covariances[axis] = joseph @ p @ joseph.T + r * np.outer(k, k)
    np.testing.assert_allclose(belief.mean, np.stack(means, 1), rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(belief.covariance, np.stack([covariances[0], covariances[2]]), rtol=1e-8, atol=1e-14)
    np.testing.assert_allclose(covariances[0], covariances[1])


def test_outlier_pulls_no_harder_than_at_the_gate(x64):
    """Huber: beyond the gate the correction stays what it is at the gate, for a tight measurement."""
    belief = random_belief(np.random.default_rng(1))
    spread = float(belief.covariance[0, VELOCITY, VELOCITY])
    std = 100 * np.sqrt(spread)  # so that the weight hardly changes the denominator

    def pull(size):
        innovation = jnp.full(3, size * np.sqrt(spread + std**2))
        moved, residual = axis_filter.update(
            belief, axis_filter.measures(VELOCITY), innovation, jnp.asarray(std**2), jnp.ones(2), 3.0
        )
        return float(moved.mean[VELOCITY, 0] - belief.mean[VELOCITY, 0]), float(residual)

    assert np.isclose(pull(2.0)[0], 2 / 3 * pull(3.0)[0], rtol=1e-2)
    assert np.isclose(pull(300.0)[0], pull(3.0)[0], rtol=1e-2)


def test_covariance_is_consistent(x64):
    """Oracle: chi-square. Simulated with the filter's own model, normalised squared errors average the state count."""
    f, g = (jnp.asarray(a) for a in dense_transition(PERIOD))
    start = jnp.asarray([2e-3, 2e-2, 5e-2, 2e-3, 2e-3, 5e-2, 1e-3])

    def run(key):
        key, key_start = jax.random.split(key)
        truth = start[:, None] * jax.random.normal(key_start, (STATES, 3))
        belief = Belief(jnp.zeros((STATES, 3)), jnp.tile(jnp.diag(start**2), (2, 1, 1)))

        def tick(carry, k):
            truth, belief = carry
            noise = jax.random.normal(jax.random.fold_in(key, k), (STATES + 5, 3))
            acceleration = jnp.sin(0.05 * k + jnp.arange(3.0))
            truth = f @ truth + g[:, None] * acceleration + jnp.sqrt(DRIFT)[:, None] * noise[:STATES]
            measured = acceleration + ACCELERATION_STD * noise[STATES]
            belief = axis_filter.predict(belief, measured, PERIOD, ACCELERATION_STD**2, jnp.asarray(DRIFT))
            for i, (rows, std) in enumerate(MEASUREMENTS[:4]):
                row = jnp.asarray(measured_row(rows))
                by_axis = row[jnp.asarray([0, 0, 1])]
                reading = jnp.sum(by_axis.T * truth, axis=0) + std * noise[STATES + 1 + i]
                belief, _ = axis_filter.update(
                    belief,
                    row,
                    reading - jnp.sum(by_axis.T * belief.mean, axis=0),
                    jnp.asarray(std**2),
                    jnp.ones(2),
                    1e9,
                )
            error = belief.mean - truth
            by_axis = belief.covariance[jnp.asarray([0, 0, 1])]
            return (truth, belief), jnp.einsum(
                "ia,ia->a", error, jnp.linalg.solve(by_axis, error.T[..., None])[..., 0].T
            )

        return jax.lax.scan(tick, (truth, belief), jnp.arange(300))[1]

    squares = np.asarray(jax.jit(jax.vmap(run))(jax.random.split(jax.random.key(0), 100)))
    # 300 independent axes at each of a few instants far apart: 7 +- 3 standard errors.
    for k in (0, 20, 100, 299):
        assert abs(squares[:, k].mean() - STATES) < 3 * np.sqrt(2 * STATES / squares[:, k].size), k


def test_single_precision_stays_symmetric_positive_definite_far_from_home():
    """Ten minutes of walking without images: the position's variance grows, the rest must not suffer from it."""

    def tick(belief, k):
        swing = (k // 120) % 2
        drift = jnp.asarray([0, 0, 2.5e-3, 0, 0, 0, 1e-5]) * PERIOD
        feet = jnp.stack([jnp.where(swing == 0, 0.25, 1.6e-5), jnp.where(swing == 1, 0.25, 1.6e-5)]) * PERIOD
        belief = axis_filter.predict(belief, jnp.zeros(3), PERIOD, jnp.asarray(0.25), drift.at[3:5].set(feet))
        for rows, std in MEASUREMENTS[:3]:
            belief, _ = axis_filter.update(
                belief,
                jnp.asarray(measured_row(rows), jnp.float32),
                jnp.zeros(3),
                jnp.asarray(std**2),
                jnp.ones(2),
                3.0,
            )
        return belief, None

    variances = jnp.asarray([4e-6, 4e-4, 2.5e-3, 4e-6, 4e-6, 2.5e-3, 1e-8])
    start = Belief(jnp.zeros((STATES, 3)), jnp.tile(jnp.diag(variances), (2, 1, 1)))
    (end, _) = jax.jit(lambda b: jax.lax.scan(tick, b, jnp.arange(300_000)))(start)
    covariance = np.asarray(end.covariance, np.float64)
    assert covariance.dtype == np.float64 and end.covariance.dtype == jnp.float32
    np.testing.assert_array_equal(covariance, np.swapaxes(covariance, 1, 2))
    scale = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    correlation = covariance / (scale[:, :, None] * scale[:, None, :])
    assert np.linalg.eigvalsh(correlation).min() > 1e-6

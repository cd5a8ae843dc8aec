"""Intervals of rates against SciPy's."""

import numpy as np
import pytest
from scipy import stats

from iwalker_jax.evaluation.intervals import mean_interval, paired_interval, wilson_interval


@pytest.mark.parametrize(("hits", "n"), [(0, 10), (10, 10), (7, 10), (93, 100), (1, 3)])
def test_wilson_interval(hits, n):
    """Oracle: SciPy's."""
    expected = stats.binomtest(hits, n).proportion_ci(0.95, method="wilson")
    assert wilson_interval(np.arange(n) < hits) == pytest.approx((expected.low, expected.high), abs=1e-9)


def test_wilson_interval_of_nothing():
    assert np.isnan(wilson_interval([])).all()


def test_mean_interval():
    """Oracle: SciPy's normal distribution; one value has no spread."""
    values = np.random.default_rng(0).normal(3, 2, 30)
    expected = stats.norm.interval(0.95, np.mean(values), stats.sem(values))
    assert mean_interval(values) == pytest.approx(expected, abs=1e-9)
    assert np.isnan(mean_interval([1.0])).all()


def test_paired_interval():
    """Oracle: SciPy's paired t-test; what both rows share does not widen it."""
    rng = np.random.default_rng(1)
    second = rng.normal(0, 10, 5)
    first = second + rng.normal(1, 0.1, 5)
    expected = stats.ttest_rel(first, second).confidence_interval(0.95)
    assert paired_interval(first, second) == pytest.approx((expected.low, expected.high), abs=1e-9)
    assert np.isnan(paired_interval([1.0], [2.0])).all()

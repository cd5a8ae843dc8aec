"""Confidence intervals of rates and means."""

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

_NORMAL_QUANTILE = 1.959963984540054
"""Of a two-sided 95 % interval."""


def wilson_interval(flags: Sequence[float] | np.ndarray) -> tuple[float, float]:
    """Wilson's 95 % interval of the share of true flags (Wilson 1927); NaN without any."""
    n = len(flags)
    if n == 0:
        return float("nan"), float("nan")
    share, squared = float(np.mean(flags)), _NORMAL_QUANTILE**2
    middle = (share + squared / (2 * n)) / (1 + squared / n)
    half = _NORMAL_QUANTILE / (1 + squared / n) * np.sqrt(share * (1 - share) / n + squared / (4 * n * n))
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))


def mean_interval(values: Sequence[float] | np.ndarray) -> tuple[float, float]:
    """Normal 95 % interval of the mean of independent values; NaN with fewer than two."""
    n = len(values)
    if n < 2:
        return float("nan"), float("nan")
    middle, half = float(np.mean(values)), float(np.std(values, ddof=1) / np.sqrt(n) * _NORMAL_QUANTILE)
    return middle - half, middle + half


def paired_interval(first: Sequence[float] | np.ndarray, second: Sequence[float] | np.ndarray) -> tuple[float, float]:
    """Student's 95 % interval of the mean of first - second, whose values belong together one by one (the same seed);
    NaN with fewer than two."""
    differences = np.asarray(first, float) - np.asarray(second, float)
    n = len(differences)
    if n < 2:
        return float("nan"), float("nan")
    half = float(stdtrit(n - 1, 0.975) * np.std(differences, ddof=1) / np.sqrt(n))
    middle = float(np.mean(differences))
    return middle - half, middle + half

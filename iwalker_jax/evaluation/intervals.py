"""Confidence intervals of rates and means."""

from collections.abc import Sequence

import numpy as np

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

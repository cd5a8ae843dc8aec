"""Confidence intervals of rates."""

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

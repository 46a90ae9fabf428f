"""The mean of a few values, and how sure it is. Pure."""

import math
import statistics
from collections.abc import Sequence
from typing import NamedTuple

T_95 = (
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
    2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
)  # fmt: skip
"""Two-sided 95 % quantiles of Student's t for 1 to 30 degrees of freedom."""
Z_95 = 1.960


class Mean(NamedTuple):
    """Mean and half-width of its 95 % interval; NaN half-width for a single value, NaN mean for none."""

    value: float
    half: float
    of: int

    def __str__(self) -> str:
        if not self.of:
            return "-"
        return f"{self.value:.3g}" if math.isnan(self.half) else f"{self.value:.3g} ± {self.half:.2g}"


def mean_of(values: Sequence[float]) -> Mean:
    """Mean with its 95 % t-interval (above 30 degrees of freedom 1.96 (1 + 1.25/df), within 0.1 % of t)."""
    n = len(values)
    if n < 2:
        return Mean(values[0] if n else math.nan, math.nan, n)
    t = T_95[n - 2] if n - 2 < len(T_95) else Z_95 * (1 + 1.25 / (n - 1))
    return Mean(statistics.fmean(values), t * statistics.stdev(values) / math.sqrt(n), n)

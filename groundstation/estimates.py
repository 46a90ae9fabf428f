"""What a sample tells about the whole: mean, median and share, each with its 95 % interval. Pure, no chance in it."""

import math
import statistics
from collections.abc import Sequence

import msgspec

from groundstation.means import Z_95, mean_of

MEAN, MEDIAN, SHARE = "Student's t", "order statistics (binomial)", "Wilson score"
"""How each interval is made."""


class Estimate(msgspec.Struct, frozen=True):
    """A value and its 95 % interval; None where the sample is too small to tell."""

    value: float | None
    low: float | None
    high: float | None
    of: int
    interval: str

    def __str__(self) -> str:
        if self.value is None:
            return "none"
        if self.low is None or self.high is None:
            return f"{self.value:.3f}"
        return f"{self.value:.3f} ({self.low:.3f} to {self.high:.3f})"


def mean(values: Sequence[float]) -> Estimate:
    """Mean with Student's t interval."""
    found = mean_of(values)
    if not found.of:
        return Estimate(None, None, None, 0, MEAN)
    if math.isnan(found.half):
        return Estimate(_rounded(found.value), None, None, found.of, MEAN)
    low, high = found.value - found.half, found.value + found.half
    return Estimate(_rounded(found.value), _rounded(low), _rounded(high), found.of, MEAN)


def median(values: Sequence[float]) -> Estimate:
    """Median between the two order statistics that enclose it with at least 95 %, whatever the distribution.

    Below six values no two do.
    """
    ordered, n = sorted(values), len(values)
    if not n:
        return Estimate(None, None, None, 0, MEDIAN)
    middle = _rounded(statistics.median(ordered))
    rank = _rank(n)
    if rank is None:
        return Estimate(middle, None, None, n, MEDIAN)
    return Estimate(middle, _rounded(ordered[rank]), _rounded(ordered[n - 1 - rank]), n, MEDIAN)


def share(count: int, of: int) -> Estimate:
    """Share of ``count`` in ``of`` with Wilson's score interval, which holds at 0 and at all."""
    if not of:
        return Estimate(None, None, None, 0, SHARE)
    p, square = count / of, Z_95 * Z_95
    middle = (p + square / (2 * of)) / (1 + square / of)
    half = Z_95 / (1 + square / of) * math.sqrt(p * (1 - p) / of + square / (4 * of * of))
    low, high = max(0.0, middle - half), min(1.0, middle + half)
    return Estimate(_rounded(p), 0.0 if not count else _rounded(low), 1.0 if count == of else _rounded(high), of, SHARE)


def _rank(n: int) -> int | None:
    """Largest k with P(fewer than k+1 of n fair coins show heads) <= 2.5 %; None where there is none."""
    tail, rank = 0.0, None
    for k in range((n + 1) // 2):
        tail += math.exp(math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1) - n * math.log(2))
        if tail > 0.025:
            break
        rank = k
    return rank


def _rounded(value: float) -> float:
    return round(value, 6)

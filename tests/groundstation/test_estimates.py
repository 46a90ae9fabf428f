"""Means, medians and shares with intervals that hold what they promise."""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.estimates import mean, median, share

numbers = st.lists(st.floats(0, 100), min_size=1, max_size=60)


@given(numbers)
def test_each_value_lies_in_its_interval(values: list[float]) -> None:
    for found in (mean(values), median(values)):
        assert found.value is not None
        if found.low is not None and found.high is not None:
            assert found.low - 1e-6 <= found.value <= found.high + 1e-6


def test_nothing_tells_nothing() -> None:
    assert [str(found) for found in (mean([]), median([]), share(0, 0))] == ["none"] * 3
    assert median([3.0] * 5).low is None
    assert mean([3.0]).low is None


@pytest.mark.parametrize(("n", "rank"), [(6, 0), (8, 0), (9, 1), (20, 5), (100, 39)])
def test_median_interval_has_the_ranks_of_the_tables(n: int, rank: int) -> None:
    found = median(list(range(n)))
    assert (found.low, found.high) == (rank, n - 1 - rank)


def test_share_of_none_and_of_all() -> None:
    none, every = share(0, 1000), share(1000, 1000)
    assert (none.low, every.high) == (0.0, 1.0)
    assert none.high == pytest.approx(0.00383, abs=1e-5)
    assert every.low == pytest.approx(1 - 0.00383, abs=1e-5)


@pytest.mark.parametrize("of", [10, 40])
def test_intervals_hold_the_truth_in_about_95_of_100_samples(of: int) -> None:
    rng = random.Random(5)
    held = {"mean": 0, "median": 0, "share": 0}
    for _ in range(400):
        sample = [rng.gauss(3.0, 1.0) for _ in range(of)]
        found = {
            "mean": mean(sample),
            "median": median(sample),
            "share": share(sum(rng.random() < 0.2 for _ in sample), of),
        }
        for name, truth in (("mean", 3.0), ("median", 3.0), ("share", 0.2)):
            low, high = found[name].low, found[name].high
            assert low is not None
            assert high is not None
            held[name] += low <= truth <= high
    for name, count in held.items():
        assert count >= 400 * 0.92, name
    assert math.isclose(held["mean"] / 400, 0.95, abs_tol=0.03)

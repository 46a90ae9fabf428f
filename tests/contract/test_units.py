"""What leaves for the wire is rounded as :func:`round` does it."""

import math
import struct

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from contract.units import fifth


def bits(value: float) -> bytes:
    return struct.pack("d", value)


@given(st.floats(allow_nan=False) | st.floats(-1000.0, 1000.0) | st.integers(-(10**8), 10**8).map(lambda k: k / 2e5))
@example(-0.0)
@example(-1e-7)
@example(math.inf)
@example(0.5e-5)
@example(1e7 - 3e-9)
@example(2.0**52 / 1e5)
@example(123456789012.34567)
def test_fifth_is_round_to_five_digits_bit_for_bit(value: float) -> None:
    for near in (value, math.nextafter(value, math.inf), math.nextafter(value, -math.inf)):
        assert bits(fifth(near)) == bits(round(near, 5))


def test_what_is_no_number_stays_none() -> None:
    assert math.isnan(fifth(math.nan))


@pytest.mark.parametrize("tie", [0.000005, 0.125005, 2.675005, -0.000015, 17.000025])
def test_halves_go_where_round_takes_them(tie: float) -> None:
    assert bits(fifth(tie)) == bits(round(tie, 5))

"""What a rim rolls at least, beside the same sums without any shortcut."""

from hypothesis import given
from hypothesis import strategies as st

from onboard.expected import Expected, Plant
from onboard.limits import respond

SPEEDS = st.sampled_from([0.0, -0.0, 0.3, -0.3, 0.8]) | st.floats(-1.0, 1.0)
SPANS = st.sampled_from([0.01, 1.0, 60.0]) | st.floats(0.0, 0.2)


def lesser(slow: float, quick: float) -> float:
    return min(abs(slow), abs(quick)) if slow * quick > 0.0 else 0.0


@given(st.lists(st.tuples(SPEEDS, SPANS), max_size=12), st.sampled_from([(1.6, 0.15), (100.0, 0.001), (2.0, 0.0)]))
def test_a_rim_that_is_at_its_command_rolls_as_any_other(asked: list[tuple[float, float]], plant: Plant) -> None:
    rim, slow_mps = Expected(Plant(*plant)), 0.0
    for command_mps, span_s in asked:
        slow_m, slow_mps = respond(slow_mps, command_mps, span_s, *plant)
        assert rim.roll(command_mps, span_s) == lesser(slow_m, command_mps * span_s)
        assert rim.speed_mps == lesser(slow_mps, command_mps)

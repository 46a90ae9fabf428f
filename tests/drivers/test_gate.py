"""The last gate: every state with every event, and what must hold for any input."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.base import WheelSpeeds
from drivers.gate import TOLERANCE, Gate, GateLimits, GateState

LIMITS = GateLimits(max_wheel_radps=10.0, max_slew_radps2=100.0, command_age_ns=100_000_000)
T0 = 1_000_000_000
NAN, INF = math.nan, math.inf
ANY = st.floats(allow_nan=True, allow_infinity=True)
FINITE = st.floats(allow_nan=False, allow_infinity=False)


def gate_in(state: GateState, last: tuple[float, float] = (0.0, 0.0)) -> Gate:
    gate = Gate(LIMITS)
    if state is not GateState.DISARMED:
        gate.arm(T0 - 1_000_000_000)
        gate.permit(WheelSpeeds(*last), T0 - 10_000_000, T0 - 10_000_000)
        gate.arm(T0 - 10_000_000) if last == (0.0, 0.0) else None
    if state is GateState.STOPPED:
        gate.stop(T0 - 10_000_000)
    if state is GateState.DISARMED:
        gate.disarm(T0 - 10_000_000)
    gate.counters.clear()
    return gate


EVENTS = {
    "zero": (0.0, 0.0, T0, T0),
    "negative zero": (-0.0, 0.0, T0, T0),
    "slow": (0.5, -0.5, T0, T0),
    "nan left": (NAN, 0.0, T0, T0),
    "nan right": (0.0, NAN, T0, T0),
    "infinite": (0.5, -INF, T0, T0),
    "own stamp": (0.5, 0.5, int("1000000000"), T0),
    "late stamp": (0.5, 0.5, T0 - 100_000_001, T0),
    "late stamp at once": (0.5, 0.5, T0 - 110_000_001, T0 - 10_000_000),
    "oldest stamp": (0.5, 0.5, T0 - 100_000_000, T0),
    "future stamp": (0.5, 0.5, T0 + 1, T0),
    "clock back": (0.5, 0.5, T0 - 10_000_001, T0 - 10_000_001),
    "stale zero": (0.0, 0.0, 0, T0),
    "zero clock back": (0.0, 0.0, T0, T0 - 500_000_000),
    "zero future": (0.0, 0.0, T0 + 10**12, T0),
}
PASSED = {"slow": (0.5, -0.5), "oldest stamp": (0.5, 0.5), "own stamp": (0.5, 0.5)}
REFUSED = {
    "nan left": "nonfinite",
    "nan right": "nonfinite",
    "infinite": "nonfinite",
    "late stamp": "stale",
    "late stamp at once": "stale",
    "future stamp": "clock",
    "clock back": "clock",
}


@pytest.mark.parametrize(("state", "event"), list(itertools.product(GateState, EVENTS)))
def test_every_state_with_every_command(state: GateState, event: str) -> None:
    gate = gate_in(state)
    left, right, stamp_ns, now_ns = EVENTS[event]
    speeds = WheelSpeeds(left, right)
    result = gate.permit(speeds, stamp_ns, now_ns)
    moving = event in PASSED or event in REFUSED
    if state is GateState.ARMED:
        assert result == PASSED.get(event, (0.0, 0.0))
        assert event not in PASSED or result is speeds, "the quick way"
        assert dict(gate.counters) == ({REFUSED[event]: 1} if event in REFUSED else {})
    else:
        assert result == (0.0, 0.0)
        assert dict(gate.counters) == ({state.value: 1} if moving else {})
    assert gate.state is state


def test_a_new_gate_is_disarmed() -> None:
    gate = Gate(LIMITS)
    assert gate.state is GateState.DISARMED
    assert gate.permit(WheelSpeeds(1.0, 1.0), T0, T0) == (0.0, 0.0)
    assert dict(gate.counters) == {"disarmed": 1}
    assert gate.tick(2 * T0) is None


TRANSITIONS = {
    ("disarmed", "arm"): "armed",
    ("disarmed", "disarm"): "disarmed",
    ("disarmed", "stop"): "disarmed",
    ("armed", "arm"): "armed",
    ("armed", "disarm"): "disarmed",
    ("armed", "stop"): "stopped",
    ("stopped", "arm"): "armed",
    ("stopped", "disarm"): "disarmed",
    ("stopped", "stop"): "stopped",
}


@pytest.mark.parametrize(("before", "event", "after"), [(*key, value) for key, value in TRANSITIONS.items()])
def test_every_transition(before: str, event: str, after: str) -> None:
    gate = gate_in(GateState(before), (0.5, 0.5))
    getattr(gate, event)(T0)
    assert gate.state is GateState(after)
    assert gate.tick(T0 + 100_000_000) is None
    assert gate.permit(WheelSpeeds(1.0, 1.0), T0, T0) == (0.0, 0.0), "slew starts from standstill, at no elapsed time"


@pytest.mark.parametrize("state", list(GateState))
@given(last=st.tuples(FINITE, FINITE), stamp=st.integers(), now=st.integers())
def test_a_zero_is_never_refused_or_counted(state: GateState, last: tuple[float, float], stamp: int, now: int) -> None:
    gate = gate_in(state, last)
    assert gate.permit(WheelSpeeds(0.0, 0.0), stamp, now) == (0.0, 0.0)
    assert not gate.counters


@given(
    commands=st.lists(
        st.tuples(ANY, ANY, st.integers(-(10**9), 10**9), st.integers(-(10**8), 10**9)), min_size=1, max_size=12
    )
)
def test_it_only_ever_shrinks_both_wheels_by_one_factor(commands: list[tuple[float, float, int, int]]) -> None:
    gate = Gate(LIMITS)
    gate.arm(T0)
    now_ns, last = T0, (0.0, 0.0)
    for left, right, age_ns, dt_ns in commands:
        now_ns += dt_ns
        out = gate.permit(WheelSpeeds(left, right), now_ns - age_ns, now_ns)
        for wanted, permitted, before in zip((left, right), out, last, strict=True):
            assert math.isfinite(permitted)
            assert abs(permitted) <= LIMITS.max_wheel_radps * (1 + 1e-9)
            assert permitted == 0.0 or (permitted > 0) == (wanted > 0)
            assert permitted == 0.0 or abs(permitted) <= abs(wanted)
            growth = LIMITS.max_slew_radps2 * max(dt_ns, 0) * 1e-9
            assert abs(permitted) <= abs(before) + growth + 1e-9
            if before and permitted and (before > 0) != (permitted > 0):
                assert abs(permitted) <= growth + 1e-9
        if min(map(abs, out)) > 1e-290:
            assert out[0] / left == pytest.approx(out[1] / right, rel=1e-6)
        last = out


@given(fraction=st.floats(0.0, 1.0), left=st.floats(-9.0, 9.0), right=st.floats(-9.0, 9.0))
def test_slowing_down_is_never_limited(fraction: float, left: float, right: float) -> None:
    gate = Gate(LIMITS)
    gate.arm(0)
    first = gate.permit(WheelSpeeds(left, right), T0, T0)
    assert first == (left, right)
    slower = WheelSpeeds(fraction * left, fraction * right)
    assert gate.permit(slower, T0, T0) == slower
    assert not gate.counters


@pytest.mark.parametrize(
    ("wanted", "permitted"),
    [
        ((40.0, -20.0), (10.0, -5.0)),
        ((-40.0, 20.0), (-10.0, 5.0)),
        ((20.0, -40.0), (5.0, -10.0)),
        ((40.0, 5.0), (10.0, 1.25)),
        ((-40.0, 5.0), (-10.0, 1.25)),
        ((5.0, 40.0), (1.25, 10.0)),
        ((5.0, -40.0), (1.25, -10.0)),
    ],
)
def test_over_speed_keeps_curvature_and_is_counted(wanted: tuple[float, float], permitted: tuple[float, float]) -> None:
    gate = gate_in(GateState.ARMED)
    gate.arm(0)
    assert gate.permit(WheelSpeeds(*wanted), T0, T0) == permitted
    assert dict(gate.counters) == {"overspeed": 1}


@pytest.mark.parametrize("excess", [1 + 1e-12, TOLERANCE])
def test_rounding_above_the_limit_is_shrunk_but_not_counted(excess: float) -> None:
    gate = gate_in(GateState.ARMED)
    gate.arm(0)
    assert gate.permit(WheelSpeeds(10.0 * excess, 0.0), T0, T0)[0] == pytest.approx(10.0, rel=1e-15)
    assert not gate.counters


def test_just_above_the_limit_is_counted() -> None:
    gate = gate_in(GateState.ARMED)
    gate.arm(0)
    assert gate.permit(WheelSpeeds(10.0 * (1 + 1e-8), 0.0), T0, T0)[0] == pytest.approx(10.0, rel=1e-12)
    assert dict(gate.counters) == {"overspeed": 1}


def test_slew_is_limited_from_the_last_permitted_speed() -> None:
    gate = gate_in(GateState.ARMED, (0.5, 0.25))
    assert gate.permit(WheelSpeeds(4.0, 2.0), T0, T0) == pytest.approx((1.5, 0.75))
    assert dict(gate.counters) == {"slew": 1}


@pytest.mark.parametrize(
    ("last", "wanted", "permitted"),
    [
        ((0.5, 0.25), (4.0, 0.25), (1.5, 0.09375)),
        ((0.5, 0.25), (0.5, 4.0), (0.15625, 1.25)),
        ((-0.5, -0.25), (-4.0, -0.25), (-1.5, -0.09375)),
        ((-0.5, -0.25), (-0.5, -4.0), (-0.15625, -1.25)),
        ((0.5, 0.5), (-1.5, 0.5), (-1.0, 1 / 3)),
        ((0.5, 0.5), (0.5, -1.5), (1 / 3, -1.0)),
        ((-0.5, -0.5), (1.5, -0.5), (1.0, -1 / 3)),
        ((-0.5, -0.5), (-0.5, 1.5), (-1 / 3, 1.0)),
        ((0.0, 0.0), (2.0, 0.0), (1.0, 0.0)),
        ((0.0, 0.0), (0.0, -2.0), (0.0, -1.0)),
    ],
)
def test_one_wheel_too_quick_shrinks_both(
    last: tuple[float, float], wanted: tuple[float, float], permitted: tuple[float, float]
) -> None:
    gate = gate_in(GateState.ARMED, last)
    assert gate.permit(WheelSpeeds(*wanted), T0, T0) == pytest.approx(permitted)
    assert dict(gate.counters) == {"slew": 1}


@pytest.mark.parametrize("wanted", [(1.5, 0.5), (-0.5, 0.5), (0.5, 1.5), (0.5, -0.5), (1.5, 1.5), (-0.5, -0.5)])
def test_growth_to_the_very_bound_passes_unchanged(wanted: tuple[float, float]) -> None:
    gate = gate_in(GateState.ARMED, (0.5, 0.5))
    speeds = WheelSpeeds(*wanted)
    assert gate.permit(speeds, T0, T0) is speeds, "the quick way"
    assert not gate.counters


@pytest.mark.parametrize("wanted", [(10.0, 1.0), (1.0, 10.0), (-10.0, 1.0), (1.0, -10.0)])
def test_the_very_top_speed_passes_unchanged(wanted: tuple[float, float]) -> None:
    gate = gate_in(GateState.ARMED)
    gate.arm(0)
    speeds = WheelSpeeds(*wanted)
    assert gate.permit(speeds, T0, T0) is speeds, "the quick way"
    assert not gate.counters


def test_growth_is_that_of_the_time_since_the_last_command() -> None:
    gate = gate_in(GateState.ARMED)
    assert gate.permit(WheelSpeeds(9.0, 9.0), T0, T0) == pytest.approx((1.0, 1.0))
    assert gate.permit(WheelSpeeds(9.0, 9.0), T0 + 20_000_000, T0 + 20_000_000) == pytest.approx((3.0, 3.0))


def test_the_oldest_stamp_may_be_shrunk_too() -> None:
    gate = gate_in(GateState.ARMED)
    assert gate.permit(WheelSpeeds(4.0, 2.0), T0 - 100_000_000, T0) == pytest.approx((1.0, 0.5))
    assert dict(gate.counters) == {"slew": 1}


def test_reversal_may_only_grow_from_zero() -> None:
    gate = gate_in(GateState.ARMED, (0.9, 0.9))
    assert gate.permit(WheelSpeeds(-4.0, -4.0), T0, T0) == pytest.approx((-1.0, -1.0))


@pytest.mark.parametrize(
    ("state", "age_ns", "last", "expected", "counted"),
    [
        ("disarmed", 10**9, (0.0, 0.0), None, {}),
        ("armed", 0, (0.5, 0.5), None, {}),
        ("armed", 110_000_000 - 10_000_000, (0.5, 0.5), None, {}),
        ("armed", 110_000_000 - 9_999_999, (0.5, 0.5), (0.0, 0.0), {"stale": 1}),
        ("armed", 10**9, (0.0, 0.0), (0.0, 0.0), {}),
        ("armed", -1, (0.5, 0.5), (0.0, 0.0), {"clock": 1}),
        ("armed", -1, (0.0, 0.0), (0.0, 0.0), {}),
        ("stopped", 10**9, (0.5, 0.5), (0.0, 0.0), {}),
        ("stopped", 50_000_000, (0.5, 0.5), None, {}),
    ],
)
def test_tick_sends_zeros_once_commands_stay_away(
    state: str, age_ns: int, last: tuple[float, float], expected: tuple[float, float] | None, counted: dict[str, int]
) -> None:
    gate = gate_in(GateState(state), last)
    now_ns = T0 - 10_000_000 + age_ns
    assert gate.tick(now_ns) == expected
    assert dict(gate.counters) == counted
    if expected is not None:
        assert gate.tick(now_ns + 1) is None, "the next zero is due only after another command_age"


def test_motion_after_a_stale_zero_starts_from_standstill() -> None:
    gate = gate_in(GateState.ARMED, (0.9, 0.9))
    gate.tick(T0 + 10**9)
    assert gate.permit(WheelSpeeds(5.0, 5.0), T0 + 10**9, T0 + 10**9 + 10_000_000) == pytest.approx((1.0, 1.0))


def test_a_command_is_stale_at_any_age_above_the_limit() -> None:
    gate = gate_in(GateState.ARMED)
    assert gate.permit(WheelSpeeds(0.5, 0.5), T0, 2 * T0) == (0.0, 0.0)
    assert dict(gate.counters) == {"stale": 1}


@pytest.mark.parametrize("last", [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.0, -0.5)])
def test_a_motion_of_any_sign_that_ends_in_silence_is_counted(last: tuple[float, float]) -> None:
    gate = gate_in(GateState.ARMED, last)
    assert gate.tick(T0 + 10**9) == (0.0, 0.0)
    assert dict(gate.counters) == {"stale": 1}

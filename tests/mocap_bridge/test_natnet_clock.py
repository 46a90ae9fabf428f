"""The clock: its error bound holds for every steady clock and every split of the round trip."""

from hypothesis import given
from hypothesis import strategies as st

from mocap_bridge.natnet.clock import ArrivalClock, EchoClock

HZ = 10_000_000


class TrueClock:
    """A server clock that gains ``ppm`` on the local one."""

    def __init__(self, ppm: float, epoch_ns: int) -> None:
        self.rate, self.epoch_ns = 1.0 + ppm * 1e-6, epoch_ns

    def ticks(self, local_ns: int) -> int:
        return int((self.epoch_ns + local_ns + local_ns * (self.rate - 1.0)) * HZ) // 1_000_000_000


echoes = st.lists(
    st.tuples(st.integers(20_000, 3_000_000), st.floats(0.0, 1.0)), min_size=1, max_size=45
)  # round trip in ns, share of it that is the way there


def run(clock: EchoClock, truth: TrueClock, samples: list[tuple[int, float]], start_ns: int) -> int:
    now_ns = start_ns
    for round_trip_ns, share in samples:
        clock.echo(now_ns, truth.ticks(now_ns + int(round_trip_ns * share)), now_ns + round_trip_ns)
        now_ns += 250_000_000
    return now_ns


@given(samples=echoes, ppm=st.floats(-400.0, 400.0), epoch_ns=st.integers(0, 10**15), ahead_ms=st.integers(0, 1000))
def test_error_stays_within_its_bound(
    samples: list[tuple[int, float]], ppm: float, epoch_ns: int, ahead_ms: int
) -> None:
    clock, truth = EchoClock(HZ), TrueClock(ppm, epoch_ns)
    now_ns = run(clock, truth, samples, 10**12)
    stamp_ns = now_ns + ahead_ms * 1_000_000
    ticks = truth.ticks(stamp_ns)
    slack_ns = 1_000  # floats of this test's own clock at 1e15 ns
    assert abs(clock.local_ns(ticks) - stamp_ns) <= clock.error_ns(ticks) + slack_ns


def test_skew_is_measured_and_followed() -> None:
    clock, truth = EchoClock(HZ), TrueClock(80.0, 5 * 10**12)
    now_ns = run(clock, truth, [(100_000, 0.5)] * 40, 10**12)
    assert abs(clock.skew + 80e-6) < 1e-6
    assert clock.error_ns(truth.ticks(now_ns)) < 200_000
    assert abs(clock.local_ns(truth.ticks(now_ns)) - now_ns) < 5_000


def test_slow_echoes_are_left_out() -> None:
    clock, truth = EchoClock(HZ), TrueClock(0.0, 0)
    now_ns = run(clock, truth, [(100_000, 0.5), (20_000_000, 1.0)] * 10, 10**12)
    assert clock.error_ns(truth.ticks(now_ns)) < 1_000_000


def test_echo_that_comes_before_it_left_is_ignored() -> None:
    clock = EchoClock(HZ)
    clock.echo(2_000, 5, 1_000)
    assert not clock.ready


def test_window_forgets() -> None:
    clock, truth = EchoClock(HZ), TrueClock(0.0, 0)
    now_ns = run(clock, truth, [(100_000, 0.0)] + [(400_000, 0.5)] * 60, 10**12)
    assert clock.round_trip_ns >= 400_000
    assert clock.error_ns(truth.ticks(now_ns)) >= 200_000


@given(st.lists(st.integers(0, 5_000_000), min_size=1, max_size=50), st.integers(-(10**12), 10**12))
def test_arrival_clock_never_points_past_the_arrival(delays_ns: list[int], offset_ns: int) -> None:
    clock = ArrivalClock()
    for number, delay_ns in enumerate(delays_ns):
        server_ns = 10**13 + number * 10_000_000
        received_ns = server_ns + offset_ns + delay_ns
        local_ns = clock.local_ns(server_ns, received_ns)
        assert local_ns <= received_ns
        assert local_ns == server_ns + offset_ns + min(delays_ns[: number + 1])

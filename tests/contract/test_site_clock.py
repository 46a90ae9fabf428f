"""Site time: identity on one computer, bounded error on two, never backwards, a jump is noticed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.site_clock import FIRST, HURRY_NS, JUMP_NS, MAX_DRIFT, MAX_SLEW, PERIOD_NS, UNKNOWN_NS, SiteClock

DAY_NS = 86_400 * 10**9
WAYS = st.lists(st.tuples(st.integers(0, 30_000_000), st.integers(0, 30_000_000)), min_size=FIRST, max_size=60)
"""Delay of a question and of its answer, ns."""


def play(ways: list[tuple[int, int]], offset_ns: int, drift: float = 0.0) -> list[tuple[SiteClock, int, int]]:
    """After each answer: the clock, own time and the site's time then."""
    clock, local_ns, found = SiteClock(), 10 * DAY_NS, []
    begin_ns = local_ns

    def site(at_ns: int) -> int:
        return at_ns + offset_ns + round((at_ns - begin_ns) * drift)

    for there_ns, back_ns in ways:
        assert clock.due(local_ns)
        asked_ns = clock.ask(local_ns)
        assert not clock.due(local_ns)
        local_ns += there_ns + back_ns
        clock.hear(asked_ns, site(asked_ns + there_ns), local_ns)
        found.append((clock, local_ns, site(local_ns)))
        local_ns += PERIOD_NS
    return found


@given(WAYS)
def test_on_the_same_computer_it_is_the_monotonic_clock_itself(ways: list[tuple[int, int]]) -> None:
    clock = SiteClock()
    assert clock.ns(5) == 5
    for clock, local_ns, _ in play(ways, 0):
        assert clock.ns(local_ns) == local_ns
        assert not clock.lost


@given(WAYS, st.integers(-9 * DAY_NS, 9 * DAY_NS), st.floats(-MAX_DRIFT, MAX_DRIFT))
def test_the_error_stays_within_its_bound(ways: list[tuple[int, int]], offset_ns: int, drift: float) -> None:
    clock, local_ns, site_ns = play(ways, offset_ns, drift)[-1]
    assert clock.ready
    assert not clock.lost
    assert abs(clock.ns(local_ns) - site_ns) <= clock.error_ns(local_ns) + 1
    later_ns = local_ns + 7 * 10**9
    assert abs(clock.ns(later_ns) - (site_ns + 7 * 10**9)) <= clock.error_ns(later_ns) + 7 * 10**9 * MAX_DRIFT + 1


@given(WAYS, st.integers(-9 * DAY_NS, 9 * DAY_NS), st.floats(-MAX_DRIFT, MAX_DRIFT))
def test_it_neither_jumps_nor_runs_backwards(ways: list[tuple[int, int]], offset_ns: int, drift: float) -> None:
    clock, local_ns = SiteClock(), 10 * DAY_NS
    last_ns, last_local_ns = None, 0
    for there_ns, back_ns in ways:
        asked_ns = clock.ask(local_ns)
        local_ns += there_ns + back_ns
        at_ns = asked_ns + there_ns
        clock.hear(asked_ns, at_ns + offset_ns + round((at_ns - 10 * DAY_NS) * drift), local_ns)
        for _ in range(3):
            if clock.ready:
                now_ns = clock.ns(local_ns)
                if last_ns is not None:
                    assert (
                        abs(now_ns - last_ns - (local_ns - last_local_ns)) <= MAX_SLEW * (local_ns - last_local_ns) + 1
                    )
                last_ns, last_local_ns = now_ns, local_ns
            local_ns += PERIOD_NS // 3


def test_a_late_answer_counts_for_nothing_beside_a_quick_one() -> None:
    quick, late = (300_000, 300_000), (0, 40_000_000)
    clock, local_ns, site_ns = play([quick] * FIRST + [late] * 5, DAY_NS)[-1]
    assert abs(clock.ns(local_ns) - site_ns) < 5_000
    assert clock.error_ns(local_ns) < 1_500_000


def test_what_was_not_asked_is_not_believed() -> None:
    clock = SiteClock()
    for answer in ((1, 2, 3), (10, 2, 9)):
        clock.hear(*answer)
    asked_ns = clock.ask(100)
    for _ in range(FIRST + 1):
        clock.hear(asked_ns, 10_000, 120)
    assert not clock.ready
    assert clock.error_ns(120) == UNKNOWN_NS


def test_questions_hurry_until_the_first_answers_are_there() -> None:
    clock = SiteClock()
    clock.ask(0)
    assert not clock.due(HURRY_NS - 1)
    assert clock.due(HURRY_NS)
    clock, local_ns, _ = play([(0, 0)] * FIRST, 5)[-1]
    clock.ask(local_ns)
    assert not clock.due(local_ns + PERIOD_NS - 1)
    assert clock.due(local_ns + PERIOD_NS)


@pytest.mark.parametrize("jump_ns", [JUMP_NS * 2, -JUMP_NS * 2, 3 * DAY_NS])
def test_another_clock_is_noticed_and_not_followed(jump_ns: int) -> None:
    clock, local_ns, site_ns = play([(500_000, 500_000)] * 8, DAY_NS)[-1]
    asked_ns = clock.ask(local_ns + PERIOD_NS)
    clock.hear(asked_ns, site_ns + PERIOD_NS + jump_ns, asked_ns + 1_000_000)
    assert clock.lost
    assert abs(clock.ns(asked_ns) - (site_ns + PERIOD_NS)) < 1_000_000

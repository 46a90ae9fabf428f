"""What is worked out of a message before it is needed: the same as what would be worked out then."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import onboard.foreseen
import onboard.foresight
from contract.messages import NeighbourState
from onboard.courses import cut_way
from onboard.cut import PIVOT_M, limit_cut
from onboard.foreseen import AGE_STEP_S
from onboard.foresight import Foresight, Foretold, foresee
from onboard.hulls import least
from onboard.limits import Neighbour, Told
from tests.onboard.cut_adversary import BOUNDS
from tests.onboard.samples import state

speeds = st.floats(-0.8, 0.8)
pairs = st.tuples(speeds, speeds)
messages = st.builds(
    lambda x, y, heading, rims, asked: state("r02", x, y, heading_rad=heading, rims_mps=rims, asked_mps=asked),
    st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.floats(-4, 4), pairs, pairs,
)  # fmt: skip
ages = st.floats(0.0, 0.3)
MOVING = state("r02", 0.5, 0.0, heading_rad=math.pi, rims_mps=(0.5, 0.5), asked_mps=(0.6, 0.4))


def plain(message: NeighbourState) -> Told:
    assert message.rims_mps is not None
    assert message.asked_mps is not None
    return Told((message.x_m, message.y_m, message.heading_rad), message.rims_mps, message.asked_mps)


def neighbour(told: Told | None, silence_s: float) -> Neighbour:
    return Neighbour(0.5, 0.0, -0.5, 0.0, 0.01, silence_s, told)


@given(st.lists(messages, min_size=1, max_size=2), ages, ages, ages, speeds, st.floats(-8, 8), pairs, pairs)
def test_a_command_is_the_same_bit_for_bit(heard, first_s, guess_s, later_s, v, omega, wheels, asked) -> None:
    foresight = Foresight(BOUNDS)
    command = (v, omega, (0.0, 0.0, 0.0), wheels, asked)
    for message in heard:
        foresight.hear(message, guess_s)
        for silence_s in (first_s, first_s + later_s):
            others = [neighbour(foresight.told(message), silence_s)]
            expected = limit_cut(*command, [neighbour(plain(message), silence_s)], BOUNDS)
            assert limit_cut(*command, others, BOUNDS) == expected
            foresight.look_ahead(others, later_s)


@pytest.mark.parametrize("both", [True, False])
def test_after_a_command_nothing_is_left_to_work_out_of_what_it_looked_at(monkeypatch, both: bool) -> None:
    foresight = Foresight(BOUNDS)
    foresight.hear(MOVING, 0.02)
    before = neighbour(foresight.told(MOVING), 0.02)
    looked_at = foresee(before, BOUNDS)
    ways = [looked_at.brakes()] + ([looked_at.cut_off()] if both else [])
    foresight.look_ahead([before, neighbour(None, 0.02), neighbour(plain(MOVING), 0.02)], 0.01 + AGE_STEP_S)
    newer = state("r02", 0.49, 0.0, seq=2, heading_rad=3.0, rims_mps=(0.5, 0.5), asked_mps=(0.6, 0.4))
    foresight.hear(newer, 0.02)
    with monkeypatch.context() as patch:
        patch.setattr(onboard.foreseen, "brake_way", None)
        patch.setattr(onboard.foreseen, "cut_way", None)
        patch.setattr(onboard.foresight, "heard", None)
        assert looked_at.brakes() is ways[0]
        for told, silence_s in ((before.told, 0.03 + AGE_STEP_S), (foresight.told(newer), 0.02)):
            found = foresee(neighbour(told, silence_s), BOUNDS)
            assert found.brakes() != ways[0]
            if both:
                assert found.cut_off() != ways[1]
            else:
                with pytest.raises(TypeError):
                    found.cut_off()


def test_what_nobody_looks_at_is_not_worked_out(monkeypatch) -> None:
    monkeypatch.setattr(onboard.foresight, "heard", None)
    foresight = Foresight(BOUNDS)
    for message in (MOVING, state("r02", seq=2, rims_mps=(0.5, 0.5), asked_mps=(0.6, 0.4))):
        foresight.hear(message, 0.02)
        foresight.look_ahead([neighbour(foresight.told(message), 0.02)], 0.01)


def test_a_message_is_kept_until_the_next_and_one_without_rims_says_nothing() -> None:
    foresight = Foresight(BOUNDS)
    told = foresight.told(MOVING)
    assert type(told) is Foretold
    assert (told.place, told.rims, told.asked) == ((0.5, 0.0, math.pi), MOVING.rims_mps, MOVING.asked_mps)
    assert foresight.told(MOVING) is told
    assert foresight.told(state("r02", seq=2)) is None
    assert foresight.told(state("r02", seq=3, rims_mps=(0.0, 0.0))) is None
    foresight.hear(MOVING, 0.02)
    again = foresight.told(MOVING)
    assert again is not None
    assert (again.place, again.rims, again.asked) == (told.place, told.rims, told.asked)


def test_a_message_too_old_to_be_trusted_is_not_looked_ahead() -> None:
    foresight = Foresight(BOUNDS)
    before = neighbour(foresight.told(MOVING), 0.21)
    foresee(before, BOUNDS).brakes()
    foresight.look_ahead([before], 0.02)
    assert type(before.told) is Foretold
    assert list(before.told.by_age) == [math.ceil(0.21 / AGE_STEP_S)]


def test_it_may_do_what_it_was_asked_or_what_its_wheels_do_or_have_been_asked_anew() -> None:
    place, rims = (0.5, 0.0, math.pi), (0.5, 0.6)

    def came(asked: tuple[float, float], silence_s: float, *to: tuple[float, float]) -> None:
        told = Told(place, rims, asked)
        age_s = AGE_STEP_S * math.ceil(silence_s / AGE_STEP_S)
        ways = [cut_way((*place, *rims), *command, BOUNDS.standing_s + age_s, BOUNDS) for command in to]
        assert foresee(neighbour(told, silence_s), BOUNDS).cut_off() == [point for way in ways for point in way]

    came((0.6, 0.65), 0.0, (0.6, 0.65), rims)
    came((0.6, 0.7), 0.0, (0.6, 0.7))
    came((0.6, 0.7), 0.02, (0.6, 0.7))
    came((0.3, 0.7), 0.0, (0.3, 0.7), rims)
    came((0.3, 0.7), 0.02, (0.3, 0.7), (0.5, 0.7), rims)
    came((0.3, 0.4), 0.02, rims)
    came((0.3, 0.45), 0.02, (0.3, 0.45), rims)
    came((-0.3, 0.6), 0.02, (-0.3, 0.6), rims)


@given(messages, ages, st.floats(-4, 4))
def test_no_way_leads_farther_into_a_direction_than_it_says(message, silence_s, bearing) -> None:
    found = foresee(neighbour(plain(message), silence_s), BOUNDS)
    away = math.cos(bearing), math.sin(bearing)
    at_m = found.x_m * away[0] + found.y_m * away[1]
    for way, most_m in ((found.brakes(), found.stop_m), (found.cut_off(), found.cut_m)):
        assert -least(way, -away[0], -away[1]) - at_m <= found.ahead(*away) * most_m + PIVOT_M


def test_a_message_from_a_clock_that_is_far_ahead_is_as_new() -> None:
    foresight = Foresight(BOUNDS)
    before = neighbour(foresight.told(MOVING), 0.02)
    foresee(before, BOUNDS).cut_off()
    newer = state("r02", 0.49, 0.0, seq=2, rims_mps=(0.5, 0.5), asked_mps=(0.6, 0.4))
    foresight.hear(newer, -1e6)
    told = foresight.told(newer)
    assert told is not None
    assert list(told.by_age) == [0]

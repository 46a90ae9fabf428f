"""Which link the field profile proposes to give up, and over which detour: the longest one that has a shorter way."""

import itertools
import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from onboard import unicycle
from onboard.ahdc.field_law import REMOVAL_PAUSE_S, REMOVE_SHARE, FieldLaw
from onboard.ahdc.link_state import ON, Entry
from onboard.ahdc.parameters import Vector
from onboard.ahdc.plan import Motion
from onboard.ahdc.stopping import Brake, stop_distance_m
from onboard.ahdc.view import Heard, Sighted, View
from tests.onboard.samples import field_parameters, state

PARAMETERS = field_parameters(4)
LONGEST_WAY_M = stop_distance_m(
    PARAMETERS.max_speed_mps, Brake(PARAMETERS.brake_deceleration_mps2[0], PARAMETERS.motor_lag_s[1])
)
LIMIT_M = REMOVE_SHARE * (PARAMETERS.link_radius_m - LONGEST_WAY_M / 2)
"""Links longer than this are tried."""
OWN = (2.0, 1.0)
places = st.tuples(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9))
Links = dict[str, set[str]]


def make_law(others: dict[str, Vector], robot: str = "r01") -> FieldLaw:
    law = FieldLaw(robot, 1, PARAMETERS, 0.01, unicycle.steer)
    law.joined = True
    law.links.entries.update({name: Entry(ON) for name in others})
    return law


def look(
    others: dict[str, Vector], links_on: Links | None = None, now_s: float = 0.5, silent: str = "", unseen: str = ""
) -> View:
    """Others, relative to the robot, each linked to all others or as said, and in some state to the robot itself."""
    sighted, heard = {}, {}
    for name, (dx, dy) in others.items():
        x, y = OWN[0] + dx, OWN[1] + dy
        on = others.keys() - {name} if links_on is None else links_on.get(name, set())
        if name != unseen:
            sighted[name] = Sighted(x, y, 0.0, 0.0, 0.0, True)
        told = state(name, x, y, links_on=tuple(sorted(on)), links_kept=("r01", "r04"))
        heard[name] = Heard(told, 0.0, name == silent)
    return View(now_s, Motion(*OWN, 0.0, 0.0, 0.0), sighted, heard, {}, 0.0, True)


def proposed(law: FieldLaw) -> tuple[str, ...] | None:
    """The path of the removal that is open."""
    locks = [message.path for message in law.links.outbox if message.kind == "lock"]
    return None if law.links.removal is None else locks[-1]


def proposal(
    others: dict[str, Vector], links_on: Links | None = None, robot: str = "r01", silent: str = "", unseen: str = ""
) -> tuple[str, ...] | None:
    law = make_law(others, robot)
    law.keep_links(look(others, links_on, silent=silent, unseen=unseen))
    return proposed(law)


TRIANGLE = {"r02": (0.3, 0.3), "r03": (0.6, 0.6)}


@given(st.lists(places, min_size=2, max_size=4))
def test_the_longest_link_with_a_detour_of_shorter_ones_is_given_up_over_the_shortest_of_them(
    found: list[Vector],
) -> None:
    others = {f"r{k + 2:02d}": place for k, place in enumerate(found)}
    lengths = {name: math.hypot(*place) for name, place in others.items()}
    gaps = {(a, b): math.dist(others[a], others[b]) for a in others for b in others if a != b}
    values = sorted([*lengths.values(), *(gap for (a, b), gap in gaps.items() if a < b), LIMIT_M])
    assume(all(b - a > 1e-6 for a, b in itertools.pairwise(values)))
    expected = None
    for end in sorted((name for name in others if lengths[name] > LIMIT_M), key=lengths.__getitem__, reverse=True):
        longer = {middle: max(lengths[middle], gaps[middle, end]) for middle in others if middle != end}
        best = min(longer, key=longer.__getitem__)
        if longer[best] < lengths[end]:
            expected = ("r01", best, end)
            break
    assert proposal(others) == expected


@pytest.mark.parametrize(("length_m", "tried"), [(LIMIT_M - 1e-3, False), (LIMIT_M + 1e-3, True)])
def test_only_links_that_could_soon_make_wait_are_tried(length_m: float, tried: bool) -> None:
    others = {"r02": (length_m / 2, 0.0), "r03": (length_m, 0.0)}
    assert (proposal(others) is not None) is tried


def test_the_lower_id_coordinates() -> None:
    assert proposal(TRIANGLE) == ("r01", "r02", "r03")
    assert proposal(TRIANGLE, robot="r04") is None


def test_a_detour_needs_a_neighbour_linked_to_both() -> None:
    assert proposal(TRIANGLE, {"r02": {"r01"}}) is None
    assert proposal(TRIANGLE, {"r02": {"r03"}}) is not None


def test_a_neighbour_that_is_silent_unseen_or_not_linked_is_no_detour_and_another_is_taken() -> None:
    others = TRIANGLE | {"r04": (0.5, 0.1)}
    assert proposal(others) == ("r01", "r02", "r03")
    assert proposal(others, silent="r02") == ("r01", "r04", "r03")
    assert proposal(others, unseen="r02") == ("r01", "r04", "r03")
    assert proposal(others, {"r04": {"r03"}}) == ("r01", "r04", "r03")
    law = make_law(others)
    del law.links.entries["r02"]
    law.keep_links(look(others))
    assert proposed(law) == ("r01", "r04", "r03")


def test_a_detour_as_long_as_the_link_is_none() -> None:
    unit_m = 5 / 32  # a triangle of sides 3, 4, 5: no rounding
    assert proposal({"r02": (3 * unit_m, 4 * unit_m), "r03": (5 * unit_m, 0.0)}) is None
    assert proposal({"r02": (3 * unit_m, 3.9 * unit_m), "r03": (5 * unit_m, 0.0)}) is not None


def test_nothing_is_given_up_before_it_has_joined() -> None:
    law = make_law(TRIANGLE)
    law.joined = False
    law.keep_links(look(TRIANGLE | {"r04": (0.1, 0.4)}))
    assert not law.joined
    assert proposed(law) is None


def test_it_pauses_between_removals() -> None:
    law = make_law(TRIANGLE)
    law.keep_links(look(TRIANGLE, now_s=0.5))
    removal = law.links.removal
    assert removal is not None
    assert removal.started_s == 0.5
    law.keep_links(look(TRIANGLE, now_s=0.51))
    assert law.links.removal is removal
    law.links.removal = None
    law.links.entries["r03"].state = ON
    law.keep_links(look(TRIANGLE, now_s=0.5 + 0.9 * REMOVAL_PAUSE_S))
    assert law.links.removal is None
    law.keep_links(look(TRIANGLE, now_s=0.5 + 1.1 * REMOVAL_PAUSE_S))
    assert proposed(law) == ("r01", "r02", "r03")

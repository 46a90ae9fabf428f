"""Who is asked about the end of a link: each robot on the detour, and last the far end, asks itself."""

import pytest

from contract.messages import TransactionId
from onboard.ahdc.links import INQUIRE_S, Link, LinkTable
from tests.onboard.link_ends import PATH, TX, after, life, linked, message, tell


def agreed() -> LinkTable:
    """The far end, having agreed."""
    table = linked("r04", "r01", "r03", "r05")
    tell(table, "r03", "lock", TX, 0.0, PATH, 3)
    assert table.state("r01") is Link.DOUBT
    return table


def test_a_robot_on_the_way_passes_on_what_it_vouches_for() -> None:
    table = linked("r02", "r01", "r03")
    assert tell(table, "r01", "lock", TX, 0.0, PATH, 1) == [message("r03", "lock", TX, PATH, 2)]
    assert table.vouched() == ["r01", "r03"]


@pytest.mark.parametrize("silent", ["r02", "r04"])
def test_a_robot_on_the_way_refuses_for_either_of_its_links(silent: str) -> None:
    table = linked("r03", "r02", "r04")
    table.note_silence([silent])
    assert tell(table, "r02", "lock", TX, 0.0, PATH, 2) == [message("r02", "nack", TX, PATH, 1)]


def test_a_refusal_goes_back_the_way_it_came() -> None:
    table = linked("r03", "r02", "r04")
    assert tell(table, "r04", "nack", TX, 0.0, PATH, 2) == [message("r02", "nack", TX, PATH, 1)]
    first = linked("r02", "r01", "r03")
    assert tell(first, "r03", "nack", TX, 0.0, PATH, 1) == [message("r01", "nack", TX, PATH, 0)]


@pytest.mark.parametrize(("path", "hop"), [(PATH, 0), (PATH, 1), (PATH, 3), (PATH, 4), (PATH, 9), ((), 2), ((), 0)])
def test_a_refusal_that_makes_no_sense_goes_nowhere(path: tuple[str, ...], hop: int) -> None:
    table = linked("r03", "r02", "r04")
    assert tell(table, "r04", "nack", TX, 0.0, path, hop) == []
    starting = linked("r01", "r02", "r04")
    assert tell(starting, "r02", "nack", TX, 0.0, PATH, 0) == []


@pytest.mark.parametrize(
    ("sender", "path", "hop"),
    [
        ("r02", PATH, 1),
        ("r02", PATH, 3),
        ("r04", PATH, 2),
        ("r02", PATH, 4),
        ("r02", PATH, 9),
        ("r02", ("r03", "r02"), 0),
        ("r01", ("r01", "r03"), 1),
        ("r02", ("r02", "r03", "r04"), 1),
        ("r02", (), 0),
    ],
    ids=["before", "behind", "wrong way", "at the end", "beyond it", "before it", "no detour", "not his", "no way"],
)
def test_a_question_that_makes_no_sense_is_not_answered(sender: str, path: tuple[str, ...], hop: int) -> None:
    """Neither passed on nor agreed to; ``not his`` is one about a removal that another robot coordinates."""
    table = linked("r03", "r01", "r02", "r04")
    assert tell(table, sender, "lock", TX, 0.0, path, hop) == []
    assert table.vouched() == ["r01", "r02", "r04"]


def test_a_robot_does_not_take_part_in_its_own_removal() -> None:
    table = linked("r01", "r02", "r03")
    ring = ("r01", "r02", "r01", "r03")
    assert tell(table, "r02", "lock", TX, 0.0, ring, 2) == []


def test_the_far_end_agrees_and_stops_vouching() -> None:
    table = linked("r04", "r01", "r03")
    assert tell(table, "r03", "lock", TX, 0.0, PATH, 3) == [message("r01", "yes", TX)]
    assert table.enforces("r01")
    assert table.vouched() == ["r03"]


def test_a_detour_of_one_robot_is_enough() -> None:
    table = linked("r03", "r01", "r02")
    assert tell(table, "r02", "lock", TX, 0.0, ("r01", "r02", "r03"), 2) == [message("r01", "yes", TX)]


def test_the_far_end_agrees_again_to_what_it_has_agreed_to() -> None:
    """Its answer may have been lost; what it vouches for by then does not matter."""
    table = agreed()
    table.note_silence(["r01", "r03"])
    assert tell(table, "r03", "lock", TX, 0.0, PATH, 3) == [message("r01", "yes", TX)]


@pytest.mark.parametrize("silent", ["r01", "r03"])
def test_the_far_end_refuses_for_either_of_its_links(silent: str) -> None:
    table = linked("r04", "r01", "r03")
    table.note_silence([silent])
    assert tell(table, "r03", "lock", TX, 0.0, PATH, 3) == [message("r03", "nack", TX, PATH, 2)]
    assert table.state("r01") is Link.ON


def test_the_far_end_refuses_a_second_removal_while_it_has_agreed_to_one() -> None:
    table = agreed()
    other = life("r01", 2)
    assert tell(table, "r03", "lock", other, 0.0, PATH, 3) == [message("r03", "nack", other, PATH, 2)]
    assert tell(table, "r01", "commit", TX) == [message("r01", "ack", TX)]


def test_the_far_end_refuses_the_end_of_a_link_that_it_does_not_have() -> None:
    table = linked("r04", "r03")
    assert tell(table, "r03", "lock", TX, 0.0, PATH, 3) == [message("r03", "nack", TX, PATH, 2)]
    assert table.enforced() == ["r03"]


def test_the_far_end_gives_the_link_up_once_told_and_says_so_each_time() -> None:
    table = agreed()
    for _ in range(2):
        assert tell(table, "r01", "commit", TX) == [message("r01", "ack", TX)]
        assert table.state("r01") is Link.OFF
    assert tell(table, "r01", "add", life("r01", 5)) == [], "the life that ended"
    assert after(table, 9.0) == []


def test_a_removal_that_the_far_end_closed_is_not_begun_again() -> None:
    table = agreed()
    tell(table, "r01", "commit", TX)
    for kind in ("add", "confirm"):
        tell(table, "r01", kind, life("r01", 7))
    assert tell(table, "r03", "lock", TX, 0.0, PATH, 3) == [message("r03", "nack", TX, PATH, 2)]
    assert table.state("r01") is Link.ON


def test_the_far_end_keeps_the_link_when_the_removal_is_given_up() -> None:
    table = agreed()
    assert tell(table, "r01", "abort", TX) == []
    assert table.vouched() == ["r01", "r03", "r05"]
    assert tell(table, "r03", "lock", TX, 0.0, PATH, 3) == [message("r03", "nack", TX, PATH, 2)]


def test_a_removal_given_up_before_it_was_heard_of_is_refused() -> None:
    table = linked("r04", "r01", "r03")
    tell(table, "r01", "abort", TX)
    assert tell(table, "r03", "lock", TX, 0.0, PATH, 3) == [message("r03", "nack", TX, PATH, 2)]
    assert table.state("r01") is Link.ON


@pytest.mark.parametrize("tx", [life("r01", 9), life("r04", 1)])
def test_the_end_of_another_removal_changes_nothing(tx: TransactionId) -> None:
    table = agreed()
    assert tell(table, "r01", "commit", tx) == []
    assert tell(table, "r01", "abort", tx) == []
    assert tell(table, "r05", "commit", TX) == []
    assert tell(table, "r05", "abort", TX) == []
    assert (table.state("r01"), table.state("r05")) == (Link.DOUBT, Link.ON)


def test_an_end_that_was_never_agreed_to_changes_nothing() -> None:
    """Not even one that names what made the link."""
    table = linked("r04", "r01", "r03")
    for tx in (TX, life("r01", 5)):
        assert tell(table, "r01", "commit", tx) == []
        assert table.state("r01") is Link.ON


def test_a_far_end_left_in_doubt_inquires_until_it_is_told() -> None:
    table = agreed()
    for due_s in (INQUIRE_S, 2 * INQUIRE_S):
        assert after(table, due_s - 0.01) == []
        assert after(table, due_s) == [message("r01", "inquire", TX)]
    tell(table, "r01", "abort", TX)
    assert after(table, 9.0) == []


def test_a_late_acceptance_does_not_keep_a_far_end_from_inquiring() -> None:
    table = linked("r04", "r03")
    table.offer("r01", 0.0)
    tell(table, "r01", "accept", life("r04", 1))
    tell(table, "r03", "lock", TX, 0.0, PATH, 3)
    tell(table, "r01", "accept", life("r04", 1), 0.2)
    assert after(table, 0.21 + INQUIRE_S) == [message("r01", "inquire", TX)]


def test_a_removal_that_its_coordinator_forgot_makes_the_link_anew() -> None:
    table = agreed()
    assert tell(table, "r01", "unknown", TX) == [message("r01", "add", life("r04", 1))]
    assert table.state("r01") is Link.OFFERED
    assert after(table, 9.0) == [message("r01", "add", life("r04", 1))]
    assert tell(table, "r01", "add", life("r01", 5)) == [], "the life that ended"


@pytest.mark.parametrize(("sender", "tx"), [("r01", life("r01", 9)), ("r05", TX), ("r05", life("r05", 5))])
def test_what_is_unknown_but_not_open_changes_nothing(sender: str, tx: TransactionId) -> None:
    table = agreed()
    assert tell(table, sender, "unknown", tx) == []
    assert (table.state("r01"), table.state("r05")) == (Link.DOUBT, Link.ON)


def test_only_its_coordinator_ends_a_removal() -> None:
    table = linked("r04", "r01", "r03", "r05")
    assert tell(table, "r05", "abort", TX) == []
    assert tell(table, "r03", "lock", TX, 0.0, PATH, 3) == [message("r01", "yes", TX)]
    for kind in ("abort", "commit"):
        assert tell(table, "r05", kind, TX) == []
    assert (table.state("r01"), table.state("r05")) == (Link.DOUBT, Link.ON)
    tell(table, "r01", "abort", TX)
    assert table.state("r01") is Link.ON


def test_nobody_offers_in_the_name_of_another() -> None:
    table = linked("r04", "r01")
    assert tell(table, "r05", "add", life("r01", 9)) == []
    assert table.state("r05") is Link.OFF
    assert tell(table, "r01", "add", life("r01", 9)) == [message("r01", "accept", life("r01", 9))]

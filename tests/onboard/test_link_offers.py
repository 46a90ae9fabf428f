"""How a link comes about: each end enforces from its own first message on, and vouches once it knows of the other."""

import pytest

from contract.messages import TransactionId
from onboard.ahdc.links import OFFER_REPEAT_S, Link, LinkTable
from tests.onboard.link_ends import after, life, linked, message, sent, tell


def offered(robot: str, other: str) -> LinkTable:
    table = LinkTable(robot, boot=1)
    table.offer(other, 0.0)
    sent(table)
    return table


def test_a_robot_never_heard_of_has_no_link() -> None:
    table = LinkTable("r01", boot=1)
    assert table.state("r02") is Link.OFF
    assert not table.enforces("r02")
    assert not table.vouches("r02")
    assert "r02" not in table
    assert (table.enforced(), table.vouched()) == ([], [])


def test_a_link_is_asked_for_by_the_name_of_a_robot() -> None:
    table = linked("r01", "r02")
    assert "r02" in table
    assert None not in table
    assert 2 not in table


def test_an_offer_enforces_at_once_and_does_not_vouch() -> None:
    table = LinkTable("r01", boot=3)
    table.offer("r02", 0.0)
    assert sent(table) == [message("r02", "add", life("r01", 1, boot=3))]
    assert table.enforced() == ["r02"]
    assert table.vouched() == []
    assert "r02" in table


def test_every_offer_has_its_own_number() -> None:
    table = LinkTable("r01", boot=1)
    for other in ("r02", "r03"):
        table.offer(other, 0.0)
    assert [said.tx for said in sent(table)] == [life("r01", 1), life("r01", 2)]


def test_a_handshake_ends_in_a_link_that_both_vouch_for() -> None:
    maker, other = LinkTable("r01", boot=1), LinkTable("r02", boot=1)
    maker.offer("r02", 0.0)
    other.hear("r01", maker.outbox.pop(), 0.0)
    assert other.outbox == [message("r01", "accept", life("r01", 1))]
    assert (other.enforced(), other.vouched()) == (["r01"], [])
    maker.hear("r02", other.outbox.pop(), 0.0)
    assert maker.outbox == [message("r02", "confirm", life("r01", 1))]
    assert maker.vouched() == ["r02"]
    other.hear("r01", maker.outbox.pop(), 0.0)
    assert other.vouched() == ["r01"]
    assert other.outbox == []


def test_offers_and_acceptances_are_repeated_until_they_are_answered() -> None:
    maker, other = offered("r01", "r02"), LinkTable("r02", boot=1)
    tell(other, "r01", "add", life("r01", 1))
    for table, to, kind in ((maker, "r02", "add"), (other, "r01", "accept")):
        for due_s in (OFFER_REPEAT_S, 2 * OFFER_REPEAT_S):
            assert after(table, due_s - 0.01) == []
            assert after(table, due_s) == [message(to, kind, life("r01", 1))]
    tell(maker, "r02", "accept", life("r01", 1))
    tell(other, "r01", "confirm", life("r01", 1))
    assert after(maker, 9.0) == after(other, 9.0) == []


def test_a_link_that_is_on_or_off_keeps_none_of_the_others_waiting() -> None:
    table = linked("r01", "r02", "r03")
    table.forget("r02")
    table.offer("r04", 0.0)
    table.offer("r05", 0.0)
    sent(table)
    assert [(said.to, said.kind) for said in after(table, OFFER_REPEAT_S)] == [("r04", "add"), ("r05", "add")]


def test_an_acceptance_heard_again_is_confirmed_again() -> None:
    """The confirmation may have been lost; it names the life of the link, whatever the link is in by then."""
    table = linked("r01", "r03")
    table.offer("r02", 0.0)
    sent(table)
    for _ in range(2):
        assert tell(table, "r02", "accept", life("r01", 1)) == [message("r02", "confirm", life("r01", 1))]
    table.propose_removal(["r01", "r03", "r02"], 0.0)
    sent(table)
    assert tell(table, "r02", "accept", life("r01", 1)) == [message("r02", "confirm", life("r01", 1))]
    assert table.state("r02") is Link.DOUBT


@pytest.mark.parametrize("tx", [life("r01", 2), life("r01", 1, boot=2), life("r03", 1)])
def test_an_acceptance_of_what_was_never_offered_is_unknown(tx: TransactionId) -> None:
    table = offered("r01", "r02")
    assert tell(table, "r02", "accept", tx) == [message("r02", "unknown", tx)]
    assert table.state("r02") is Link.OFFERED


def test_an_acceptance_of_a_link_that_is_over_is_unknown() -> None:
    table = offered("r01", "r02")
    table.forget("r02")
    assert tell(table, "r02", "accept", life("r01", 1)) == [message("r02", "unknown", life("r01", 1))]
    assert table.state("r02") is Link.OFF


def test_only_the_life_that_was_accepted_is_confirmed() -> None:
    table = LinkTable("r02", boot=1)
    tell(table, "r01", "add", life("r01", 4))
    tell(table, "r01", "confirm", life("r01", 3))
    assert table.state("r01") is Link.ACCEPTED
    offering = offered("r01", "r02")
    tell(offering, "r02", "confirm", life("r01", 1))
    assert offering.state("r02") is Link.OFFERED


def test_an_offer_heard_twice_is_accepted_twice_and_not_once_the_link_is_on() -> None:
    table = LinkTable("r02", boot=1)
    for _ in range(2):
        assert tell(table, "r01", "add", life("r01", 4)) == [message("r01", "accept", life("r01", 4))]
    tell(table, "r01", "confirm", life("r01", 4))
    assert tell(table, "r01", "add", life("r01", 4)) == []
    assert table.state("r01") is Link.ON


def test_the_offer_that_made_a_link_changes_nothing_in_the_middle_of_its_removal() -> None:
    table = linked("r01", "r02", "r03")
    table.propose_removal(["r01", "r03", "r02"], 0.0)
    sent(table)
    for state in (Link.DOUBT, Link.LEAVING):
        assert tell(table, "r02", "add", life("r02", 5)) == []
        assert table.state("r02") is state
        tell(table, "r02", "yes", life("r01", 1))


def test_of_two_offers_that_cross_the_lower_ids_counts() -> None:
    low, high = offered("r01", "r02"), offered("r02", "r01")
    assert tell(low, "r02", "add", life("r02", 1)) == []
    assert low.state("r02") is Link.OFFERED
    assert tell(high, "r01", "add", life("r01", 1)) == [message("r01", "accept", life("r01", 1))]
    assert high.state("r01") is Link.ACCEPTED
    assert tell(high, "r01", "accept", life("r02", 1)) == [message("r01", "unknown", life("r02", 1))]


def test_nothing_is_offered_where_a_link_is_in_good_state() -> None:
    table = linked("r01", "r02", "r03", "r05", "r06")
    table.offer("r04", 0.0)
    table.propose_removal(["r01", "r03", "r02"], 0.0)
    tell(table, "r02", "yes", life("r01", 2))
    table.propose_removal(["r01", "r03", "r05"], 0.0)
    tell(table, "r07", "add", life("r07", 1))
    tell(table, "r03", "lock", life("r06", 9), path=("r06", "r03", "r01"), hop=2)
    sent(table)
    states = {name: entry.state for name, entry in table.entries.items()}
    assert set(states.values()) == {Link.ON, Link.OFFERED, Link.ACCEPTED, Link.LEAVING, Link.DOUBT}
    for name in states:
        table.offer(name, 0.0)
    assert sent(table) == []
    assert {name: entry.state for name, entry in table.entries.items()} == states


@pytest.mark.parametrize("removing", [False, True])
def test_a_new_life_takes_the_place_of_one_that_its_maker_forgot(removing: bool) -> None:
    """Also in the middle of a removal of that very link, which is then over."""
    table = linked("r01", "r02", "r03")
    if removing:
        assert table.propose_removal(["r01", "r03", "r02"], 0.0)
        sent(table)
    assert tell(table, "r02", "add", life("r02", 7)) == [message("r02", "accept", life("r02", 7))]
    assert table.state("r02") is Link.ACCEPTED
    assert table.removal is None
    assert after(table, 9.0) == [message("r02", "accept", life("r02", 7))]
    tell(table, "r02", "confirm", life("r02", 7))
    assert table.state("r02") is Link.ON
    assert tell(table, "r02", "add", life("r02", 5)) == []


def test_a_new_life_of_one_link_leaves_the_removal_of_another_alone() -> None:
    table = linked("r01", "r02", "r03")
    table.propose_removal(["r01", "r03", "r02"], 0.0)
    sent(table)
    tell(table, "r03", "add", life("r03", 7))
    assert table.removal is not None
    assert [said.kind for said in tell(table, "r02", "yes", life("r01", 1))] == ["commit"]


def test_a_new_life_is_taken_while_the_old_one_leaves() -> None:
    table = linked("r01", "r02", "r03")
    table.propose_removal(["r01", "r03", "r02"], 0.0)
    tell(table, "r02", "yes", life("r01", 1))
    assert tell(table, "r02", "add", life("r02", 7)) == [message("r02", "accept", life("r02", 7))]
    assert tell(table, "r02", "ack", life("r01", 1)) == []
    assert table.state("r02") is Link.ACCEPTED


def test_a_life_that_is_over_is_not_taken_again() -> None:
    table = LinkTable("r02", boot=1)
    tell(table, "r01", "add", life("r01", 4))
    table.forget("r01")
    assert tell(table, "r01", "add", life("r01", 4)) == []
    assert table.state("r01") is Link.OFF
    tell(table, "r01", "add", life("r01", 5))
    assert table.state("r01") is Link.ACCEPTED


def test_after_a_reboot_numbers_begin_anew() -> None:
    table = linked("r02", "r01", number=5)
    table.note_boot("r01", 1)
    table.note_boot("r01", 2)
    assert tell(table, "r01", "add", life("r01", 6)) == []
    assert table.state("r01") is Link.DOUBT
    assert tell(table, "r01", "add", life("r01", 1, boot=2)) == [message("r01", "accept", life("r01", 1, boot=2))]
    assert tell(table, "r01", "add", life("r01", 6)) == []


def test_each_robots_offers_are_counted_by_themselves() -> None:
    table = linked("r03", "r01", number=5)
    assert tell(table, "r02", "add", life("r02", 1)) == [message("r02", "accept", life("r02", 1))]


def test_what_is_for_others_of_nobody_or_of_nothing_is_not_heard() -> None:
    table = LinkTable("r02", boot=1)
    table.hear("r01", message("r03", "add", life("r01", 1)), 0.0)
    table.hear("r02", message("r02", "add", life("r02", 1)), 0.0)
    table.hear("r01", message("r02", "add", None), 0.0)
    assert sent(table) == []
    assert table.enforced() == []

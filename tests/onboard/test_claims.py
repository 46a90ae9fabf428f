"""Claims passed on from robot to robot: they arrive, the newest word counts, and they are forgotten."""

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from contract.messages import NeighbourState, ToldClaim
from onboard.ahdc.claims import CLAIM_HOPS, CLAIM_LIFE_S, CLAIMS_A_MESSAGE, ClaimBook
from onboard.ahdc.cotr import Claim
from onboard.ahdc.view import Heard, Sighted

SPEED_MPS = 0.8


def state(robot: str, seq: int, claim: int = -1, left_m: float = 0.0, **told: object) -> NeighbourState:
    """A robot at the origin with a claim ``left_m`` ahead."""
    here = {"x_m": 0.0, "y_m": 0.0, "heading_rad": 0.0, "vx_mps": 0.0, "vy_mps": 0.0}
    return NeighbourState(
        robot=robot, boot=1, seq=seq, stamp_ns=0, **here, stop_long=(0.0, 0.0), stop_short=(0.0, 0.0),
        claim=claim, claim_at=None if claim < 0 else (left_m, 0.0), **told,
    )  # fmt: skip


def chain(length: int, rounds: int, claim_of_the_first: int) -> list[ClaimBook]:
    """Robots in a row, each hearing the next ones; all tell what they have heard once a round."""
    books = [ClaimBook(f"r{k:02d}", SPEED_MPS) for k in range(length)]
    for turn in range(rounds):
        now_s = 0.03 * turn
        claims = [claim_of_the_first] + [-1] * (length - 1)
        said = [
            state(book.robot, turn, claim, 0.5, claims=book.to_tell(now_s))
            for book, claim in zip(books, claims, strict=True)
        ]
        for k, book in enumerate(books):
            for other in (k - 1, k + 1):
                if 0 <= other < length:
                    book.learn(books[other].robot, said[other], now_s)
    return books


def test_a_claim_reaches_robots_up_to_the_hop_limit_and_none_beyond() -> None:
    for hops, book in enumerate(chain(CLAIM_HOPS + 3, 12, 7)):
        expected = [Claim("r00", 7, 0.5)] if 1 <= hops <= CLAIM_HOPS else []
        assert book.claims({}, {}, 0.4) == expected


def test_a_claim_given_up_is_known_to_be_given_up_and_silence_forgets_the_rest() -> None:
    book = ClaimBook("r09", SPEED_MPS)
    book.learn("r02", state("r02", 1, claims=(ToldClaim(robot="r01", number=4, target=7, left_m=0.3, hops=2),)), 0.0)
    assert book.claims({}, {}, 0.1) == [Claim("r01", 7, 0.3)]
    older = ToldClaim(robot="r01", number=3, target=9, left_m=0.1, hops=2)
    book.learn("r03", state("r03", 1, claims=(older,)), 0.1)
    assert book.claims({}, {}, 0.1) == [Claim("r01", 7, 0.3)]
    newer = ToldClaim(robot="r01", number=5, target=-1, left_m=0.0, hops=2)
    book.learn("r03", state("r03", 2, claims=(newer,)), 0.2)
    assert book.claims({}, {}, 0.2) == []
    book.learn("r03", state("r03", 3, claims=(ToldClaim(robot="r01", number=6, target=7, left_m=0.2, hops=2),)), 0.3)
    assert book.claims({}, {}, 0.3 + CLAIM_LIFE_S) == []
    assert book.to_tell(0.3 + CLAIM_LIFE_S) == ()
    rebooted = ToldClaim(robot="r01", number=0, target=3, left_m=0.2, hops=2)
    book.learn("r03", state("r03", 4, claims=(rebooted,)), 0.3 + CLAIM_LIFE_S)
    assert book.claims({}, {}, 0.4 + CLAIM_LIFE_S) == [Claim("r01", 3, 0.2)]


def test_a_neighbour_in_sight_is_measured_where_it_is_seen_and_its_hold_counts_as_way() -> None:
    book = ClaimBook("r09", SPEED_MPS)
    told = state("r02", 1, 7, 1.0, claim_wait_s=0.5)
    book.learn("r02", told, 0.0)
    seen = {"r02": Sighted(0.25, 0.0, 0.0, 0.0, 0.0, True)}
    assert book.claims({"r02": Heard(told, 0.0, False)}, seen, 0.0) == [Claim("r02", 7, 0.75 + 0.5 * SPEED_MPS)]
    assert book.claims({}, {}, 0.0) == [Claim("r02", 7, 1.0 + 0.5 * SPEED_MPS)]


def test_only_a_newer_word_keeps_a_claim_alive() -> None:
    book = ClaimBook("r09", SPEED_MPS)
    said = state("r02", 1, 7, 0.5)
    book.learn("r02", said, 10.0)
    book.learn("r02", said, 10.0 + CLAIM_LIFE_S)
    assert book.claims({}, {}, 10.0 + CLAIM_LIFE_S) == [], "the same message again"
    passed = ToldClaim(robot="r01", number=4, target=7, left_m=0.3, hops=2)
    book.learn("r03", state("r03", 1, claims=(passed,)), 20.0)
    book.learn("r04", state("r04", 1, claims=(passed,)), 20.3)
    book.learn("r05", state("r05", 1, claims=(replace(passed, number=3, target=9),)), 20.4)
    assert book.claims({}, {}, 20.4) == [Claim("r01", 7, 0.3)], "an older word"
    assert book.claims({}, {}, 20.0 + CLAIM_LIFE_S) == [], "the same word by another way"


def test_claims_on_one_target_are_those_on_it_and_else_all_there_are() -> None:
    book = ClaimBook("r09", SPEED_MPS)
    near = {f"r0{k}": Heard(state(f"r0{k}", 1, claim, 0.5), 0.0, False) for k, claim in enumerate((-1, 0, 7), 1)}
    far = [ToldClaim(robot=f"r1{k}", number=1, target=k - 1, left_m=0.3, hops=2) for k in range(3)]
    book.learn("r01", state("r01", 1, claims=tuple(far)), 0.0)
    on_0 = [Claim("r02", 0, 0.5), Claim("r11", 0, 0.3)]
    assert book.claims(near, {}, 0.0, 0) == on_0
    assert book.claims(near, {}, 0.0, 7) == [Claim("r03", 7, 0.5)]
    assert book.claims(near, {}, 0.0) == [on_0[0], Claim("r03", 7, 0.5), on_0[1], Claim("r12", 1, 0.3)]


def test_who_claims_nothing_passes_that_on() -> None:
    book = ClaimBook("r09", SPEED_MPS)
    book.learn("r02", state("r02", 1), 0.0)
    assert book.to_tell(0.0) == (ToldClaim(robot="r02", number=1, target=-1, left_m=0.0, hops=2),)


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 9), st.integers(-1, 5), st.integers(1, 9)), max_size=30))
def test_what_is_passed_on_is_bounded_never_own_and_never_too_far(words: list[tuple[int, int, int, int]]) -> None:
    book = ClaimBook("r05", SPEED_MPS)
    for seq, (robot, number, target, hops) in enumerate(words):
        told = ToldClaim(robot=f"r{robot:02d}", number=number, target=target, left_m=0.5, hops=hops)
        book.learn("r99", state("r99", seq, claims=(told,)), 0.0)
    passed = book.to_tell(0.0)
    assert len(passed) <= CLAIMS_A_MESSAGE
    assert all(told.robot != "r05" and told.hops <= CLAIM_HOPS for told in passed)
    assert [told.hops for told in passed] == sorted(told.hops for told in passed)


def test_a_robot_that_has_fallen_silent_claims_nothing_though_it_is_in_sight() -> None:
    book = ClaimBook("r09", SPEED_MPS)
    told = state("r01", 1, claim=7, left_m=0.1)
    here = {"r01": Sighted(0.0, 0.0, 0.0, 0.0, 0.01, 0.0)}
    assert book.claims({"r01": Heard(told, 0.02, False)}, here, 0.1) == [Claim("r01", 7, 0.1)]
    assert book.claims({"r01": Heard(told, 0.9, True)}, here, 0.9) == []

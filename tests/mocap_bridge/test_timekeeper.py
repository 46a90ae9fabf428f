"""The bridge tells whoever asks what time it is on the site, and nobody else."""

from types import SimpleNamespace
from typing import Any

import pytest

from contract.codec import decode, encode
from contract.keys import Keys
from contract.messages import ClockAsk, ClockTell
from mocap_bridge import timekeeper
from mocap_bridge.timekeeper import Timekeeper


class Session:
    def __init__(self) -> None:
        self.ear: Any = None
        self.said: list[tuple[str, ClockTell]] = []

    def declare_subscriber(self, key: str, ear: Any) -> None:
        assert key == "lab/clock/ask/*"
        self.ear = ear

    def ask(self, key: str, payload: bytes) -> None:
        self.ear(SimpleNamespace(key_expr=key, payload=SimpleNamespace(to_bytes=lambda: payload)))


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Session:
    made = Session()

    def publisher(_: object, key: str, channel: str) -> Any:
        assert channel == "clock_tell"
        return SimpleNamespace(put=lambda payload: made.said.append((key, decode(ClockTell, payload))))

    monkeypatch.setattr(timekeeper, "publisher", publisher)
    monkeypatch.setattr(timekeeper, "time", SimpleNamespace(monotonic_ns=lambda: 77))
    return made


def test_everybody_is_told_on_a_key_of_his_own(session: Session) -> None:
    keeper = Timekeeper(Keys("lab"), session)  # type: ignore[arg-type]
    for _ in range(2):
        session.ask("lab/clock/ask/r06", encode(ClockAsk(asked_ns=5)))
    session.ask("lab/clock/ask/station", encode(ClockAsk(asked_ns=6)))
    told = ClockTell(asked_ns=5, told_ns=77)
    own = ("lab/clock/tell/station", ClockTell(asked_ns=6, told_ns=77))
    assert session.said == [("lab/clock/tell/r06", told), ("lab/clock/tell/r06", told), own]
    assert not keeper.counters


@pytest.mark.parametrize(
    ("key", "payload"),
    [("lab/clock/ask/r06", b"{"), ("lab/clock/ask/R 6", b'{"asked_ns":5}'), ("lab/clock/ask/r06", b"")],
)
def test_what_is_no_question_is_counted_and_not_answered(session: Session, key: str, payload: bytes) -> None:
    keeper = Timekeeper(Keys("lab"), session)  # type: ignore[arg-type]
    session.ask(key, payload)
    assert not session.said
    assert keeper.counters.total() == 1


def test_a_flood_of_names_does_not_fill_the_memory(session: Session) -> None:
    keeper = Timekeeper(Keys("lab"), session)  # type: ignore[arg-type]
    for number in range(3 * timekeeper.MOST):
        session.ask(f"lab/clock/ask/n{number}", encode(ClockAsk(asked_ns=5)))
    assert len(session.said) == 3 * timekeeper.MOST
    assert len(keeper._speakers) <= timekeeper.MOST

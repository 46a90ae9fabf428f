"""A robot's way to the site's time: asks until it is told, and believes no pose while it cannot know its age."""

from types import SimpleNamespace
from typing import Any

import pytest

from contract.codec import decode, encode
from contract.keys import Keys
from contract.messages import ClockAsk, ClockTell
from contract.site_clock import FIRST, HURRY_NS, JUMP_NS, PERIOD_NS
from onboard import site_time
from onboard.runtime import Runtime
from onboard.site_time import SiteTime

KEYS = Keys("lab")
AHEAD_NS = 7 * 86_400 * 10**9
MS = 1_000_000


class Site:
    """A bridge that tells the time at once, and the robot's clock."""

    def __init__(self) -> None:
        self.local_ns = 10**12
        self.ahead_ns = AHEAD_NS
        self.way_ns = MS // 2
        self.silent = False
        self.asked = 0
        self._ear: Any = None

    def declare_subscriber(self, key: str, handler: Any) -> None:
        assert key == "lab/clock/tell/r06"
        self._ear = handler.callback

    def declare_publisher(self, key: str, **qos: object) -> "Site":
        assert key == "lab/clock/ask/r06"
        return self

    def put(self, payload: bytes) -> None:
        self.asked += 1
        if self.silent:
            return
        asked_ns = decode(ClockAsk, payload).asked_ns
        self.local_ns += self.way_ns
        told = ClockTell(asked_ns=asked_ns, told_ns=self.local_ns + self.ahead_ns)
        self.local_ns += self.way_ns
        self._ear(SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: encode(told))))

    def turn(self, subject: SiteTime, times: int, pause_ns: int) -> None:
        for _ in range(times):
            subject.turn()
            self.local_ns += pause_ns
        subject.turn()


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch) -> Site:
    made = Site()

    def sleep(seconds: float) -> None:
        made.local_ns += round(seconds * 1e9)

    monkeypatch.setattr(site_time, "time", SimpleNamespace(monotonic_ns=lambda: made.local_ns, sleep=sleep))
    return made


@pytest.fixture
def subject(site: Site) -> SiteTime:
    return SiteTime(site, KEYS, "r06", 20 * MS)


def test_it_reads_the_sites_time_once_it_was_told(site: Site, subject: SiteTime) -> None:
    assert not subject.sure
    subject.wait(lambda: False)
    assert subject.sure
    assert abs(subject.now_ns() - site.local_ns - AHEAD_NS) <= MS


def test_it_is_on_its_way_out_when_it_is_told_to_end_before(site: Site, subject: SiteTime) -> None:
    site.silent = True
    subject.wait(lambda: site.asked >= 3)
    assert not subject.sure
    assert not subject.clock.ready


def test_it_says_whom_it_waits_for(site: Site, subject: SiteTime, capsys: pytest.CaptureFixture[str]) -> None:
    site.silent = True
    subject.wait(lambda: site.asked > 300)
    assert "r06: waits for the site's time: does the motion-capture bridge run?" in capsys.readouterr().err


def test_a_slow_way_makes_it_unsure(site: Site, subject: SiteTime) -> None:
    site.way_ns = 25 * MS
    site.turn(subject, FIRST + 2, HURRY_NS)
    assert subject.clock.ready
    assert not subject.sure


def test_silence_makes_it_unsure_in_the_end(site: Site, subject: SiteTime) -> None:
    subject.wait(lambda: False)
    site.silent = True
    site.turn(subject, 100, PERIOD_NS)
    assert subject.sure
    site.turn(subject, 100, PERIOD_NS)
    assert not subject.sure


def test_another_time_is_noticed(site: Site, subject: SiteTime) -> None:
    subject.wait(lambda: False)
    site.ahead_ns -= 2 * JUMP_NS
    site.turn(subject, 2, PERIOD_NS)
    assert subject.clock.lost
    assert not subject.sure


def test_what_does_not_decode_is_no_answer(site: Site, subject: SiteTime) -> None:
    site._ear(SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: b"{")))
    subject.wait(lambda: False)
    assert subject.sure


@pytest.mark.parametrize(("sure", "heard"), [(True, ["stop", "frame", "beat"]), (False, ["stop", "beat"])])
def test_no_pose_is_believed_while_its_age_cannot_be_known(sure: bool, heard: list[str]) -> None:
    """STOP and the station's orders are heard whatever the time."""
    runtime: Any = Runtime.__new__(Runtime)
    arrived = [(KEYS.stop, b"stop"), (KEYS.mocap_frame, b"frame"), (KEYS.heartbeat, b"beat")]
    refused: list[str] = []
    taken: list[str] = []
    runtime._keys = KEYS
    runtime._time = SimpleNamespace(sure=sure)
    runtime._inbox = SimpleNamespace(take=lambda: arrived)
    runtime._agent = SimpleNamespace(refuse=refused.append)
    runtime._urgency = {KEYS.stop: 0, KEYS.heartbeat: 1, KEYS.mocap_frame: 2}
    runtime._take = lambda key, payload, now_ns: bool(taken.append(payload.decode()))
    runtime._receive(0)
    assert taken == heard
    assert refused == ([] if sure else ["frame while unsure of the site's time"])

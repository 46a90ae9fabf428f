"""The inbox: newest wins, stop first, and only messages that are what their key says."""

import select

import pytest

from contract.codec import WireError, encode
from contract.keys import Keys
from contract.messages import RobotReport, StopRequest
from onboard.inbox import Inbox, read

KEYS = Keys("lab")
STOP = StopRequest(stamp_ns=1, source="x", stop_id=2)
REPORT = RobotReport(robot="r06", boot=1, stamp_ns=1, run="disarmed")


@pytest.fixture
def inbox():
    box = Inbox({"stop": 0, "heartbeat": 1, "frame": 2})
    yield box
    box.close()


def ready(inbox: Inbox) -> bool:
    return bool(select.select([inbox.fileno()], [], [], 0)[0])


def test_newest_payload_of_each_key_most_urgent_first(inbox: Inbox) -> None:
    assert not ready(inbox)
    for key, payload in (("state", b"1"), ("frame", b"1"), ("frame", b"2"), ("stop", b"1"), ("heartbeat", b"1")):
        inbox.put(key, payload)
    assert ready(inbox)
    assert inbox.take() == [("stop", b"1"), ("heartbeat", b"1"), ("frame", b"2"), ("state", b"1")]
    assert not ready(inbox)
    assert inbox.take() == []


def test_waking_brings_nothing(inbox: Inbox) -> None:
    inbox.wake()
    assert ready(inbox)
    assert inbox.take() == []


def test_a_message_is_what_its_key_says() -> None:
    assert read(KEYS, KEYS.stop, encode(STOP)) == STOP
    assert read(KEYS, KEYS.report("r06"), encode(REPORT)) == REPORT


@pytest.mark.parametrize(
    ("key", "payload", "words"),
    [
        ("lab/nonsense", b"{}", "key: lab/nonsense is not a key of site lab"),
        ("other/stop", encode(STOP), "key: other/stop"),
        (KEYS.stop, b"", "StopRequest"),
        (KEYS.stop, b"\xff{", "StopRequest"),
        (KEYS.stop, encode(REPORT), "StopRequest"),
        (KEYS.report("r08"), encode(REPORT), "RobotReport: robot r06 on the key of r08"),
    ],
)
def test_anything_else_is_refused_by_name(key: str, payload: bytes, words: str) -> None:
    with pytest.raises(WireError) as caught:
        read(KEYS, key, payload)
    assert str(caught.value).startswith(words)

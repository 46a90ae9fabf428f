"""The client as a table: every state meets every kind of datagram, and silence."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocap_bridge.natnet import handshake, modeldef, version
from mocap_bridge.natnet.client import Client
from mocap_bridge.natnet.frame_encode import Content, encode_frame
from mocap_bridge.natnet.handshake import ServerInfo
from mocap_bridge.natnet.modeldef import BodyModel
from mocap_bridge.natnet.version import Version
from mocap_bridge.natnet.wire import MessageId, open_packet, packet

V41 = Version(4, 1)
LAYOUT = version.layout(V41)
INFO = ServerInfo("Motive", (3, 1, 0, 0), V41, 10_000_000, 1511, False, "239.255.42.99")
SECOND = 1_000_000_000
T0 = 100 * SECOND

DATAGRAMS = {
    "info": handshake.encode_server_info(INFO),
    "newer": handshake.encode_server_info(INFO._replace(natnet=Version(4, 4))),
    "other": handshake.encode_server_info(INFO._replace(name="Another")),
    "models": modeldef.encode_models([BodyModel("r06", 1)], LAYOUT),
    "frame": encode_frame(Content(5, transmit_ticks=0, timestamp_s=1.0), LAYOUT),
    "echo": handshake.encode_echo_response(T0, 77),
    "answer": handshake.encode_float_answer(100.0),
    "unrecognized": packet(MessageId.UNRECOGNIZED),
    "text": packet(MessageId.MESSAGESTRING, b"hello\0"),
    "unknown": packet(55, b"x"),
    "empty": b"",
    "short_frame": packet(MessageId.FRAME, b"abcd"),
}


def client_in(state: str) -> Client:
    client = Client("test", V41, multicast=False)
    client.outbox(T0)
    if state in ("models", "streaming"):
        client.receive(DATAGRAMS["info"], T0)
    if state == "streaming":
        client.receive(DATAGRAMS["models"], T0)
    if state == "refused":
        client.receive(DATAGRAMS["newer"], T0)
    client.outbox(T0)
    assert client.state == state
    return client


NEXT = {
    "searching": {"info": "models", "newer": "refused", "other": "models"},
    "models": {"models": "streaming", "newer": "refused"},
    "streaming": {"newer": "refused", "other": "models"},
    "refused": {"info": "models", "other": "models"},
}
GIVES_FRAME = {("models", "frame"), ("streaming", "frame")}


@pytest.mark.parametrize("event", DATAGRAMS)
@pytest.mark.parametrize("state", NEXT)
def test_every_state_meets_every_datagram(state: str, event: str) -> None:
    client = client_in(state)
    result = client.receive(DATAGRAMS[event], T0 + 1_000_000)
    assert client.state == NEXT[state].get(event, state)
    assert (result is not None) == ((state, event) in GIVES_FRAME)
    assert client.counters["malformed"] == (event in ("empty", "short_frame") and _decoded(state, event))
    client.outbox(T0 + 2_000_000)


def _decoded(state: str, event: str) -> bool:
    """A frame is not even decoded before the server has said its version."""
    return event == "empty" or state in ("models", "streaming")


def ids(datagrams: list[bytes]) -> list[int]:
    return [open_packet(datagram).id for datagram in datagrams]


def test_connect_is_retried_quickly_then_every_second() -> None:
    client = Client("test", V41, multicast=False)
    sent = [now for now in range(T0, T0 + 10 * SECOND, 10_000_000) if client.outbox(now)]
    assert sum(now < T0 + 2 * SECOND for now in sent) == 20
    assert sum(now >= T0 + 3 * SECOND for now in sent) in (6, 7)


def test_handshake_asks_for_models_clock_rate_and_unit() -> None:
    client = Client("test", V41, multicast=False)
    assert ids(client.outbox(T0)) == [MessageId.CONNECT]
    client.receive(DATAGRAMS["info"], T0)
    sent = ids(client.outbox(T0))
    assert sent == [MessageId.REQUEST_MODELDEF, MessageId.KEEPALIVE, MessageId.ECHO_REQUEST, MessageId.REQUEST]
    client.receive(DATAGRAMS["answer"], T0)
    assert client.nominal_rate_hz == 100.0
    assert handshake.decode_text(open_packet(client.outbox(T0)[-1])) == "UnitsToMillimeters"


def test_multicast_client_keeps_no_connection_alive_and_asks_for_no_version() -> None:
    client = Client("test", V41, multicast=True)
    assert handshake.decode_connect(open_packet(client.outbox(T0)[0])).bitstream == handshake.ANY_VERSION
    client.receive(DATAGRAMS["info"], T0)
    assert MessageId.KEEPALIVE not in ids(client.outbox(T0))
    assert client.layout.version == V41


@pytest.mark.parametrize(
    ("wanted", "servers", "multicast", "used"),
    [
        ((4, 1), (3, 1), False, (3, 1)),
        ((3, 0), (4, 1), False, (3, 0)),
        ((3, 0), (4, 1), True, (4, 1)),
        ((4, 1), (2, 9), False, (2, 9)),
    ],
)
def test_version_negotiation(
    wanted: tuple[int, int], servers: tuple[int, int], multicast: bool, used: tuple[int, int]
) -> None:
    client = Client("test", Version(*wanted), multicast)
    client.receive(handshake.encode_server_info(INFO._replace(natnet=Version(*servers))), T0)
    assert client.layout.version == used


def test_unknown_version_is_refused_by_name_and_asked_again() -> None:
    client = client_in("refused")
    assert "Motive: NatNet 4.4 is not supported: 2.6 to 4.3 are" in client.problem
    assert ids(client.outbox(T0 + 2 * SECOND)) == [MessageId.CONNECT]


def test_bit_stream_that_is_not_the_announced_one_is_found() -> None:
    client = client_in("streaming")
    layout = version.layout(Version(3, 1))
    frames = [encode_frame(Content(n, bodies=[(1, *[0.0] * 8, 1)], timestamp_s=n), layout) for n in range(1, 12)]
    decoded = [client.receive(frame, T0 + n) for n, frame in enumerate(frames)]
    assert [entry is not None for entry in decoded] == [False] * 5 + [True] * 6
    assert client.counters["other_bitstream"] == 1


def test_silence_leads_to_a_new_connection() -> None:
    client = client_in("streaming")
    client.outbox(T0 + SECOND + 1_000_000)
    assert client.state == "searching"
    assert client.counters["silence"] == 1
    client.receive(DATAGRAMS["info"], T0 + 2 * SECOND)
    assert client.state == "models"
    assert client.restarts == 0


def test_another_server_is_a_restart() -> None:
    client = client_in("streaming")
    client.receive(DATAGRAMS["other"], T0)
    assert client.restarts == 1


def test_stamps_wait_for_the_clock_then_follow_it() -> None:
    client = client_in("streaming")
    frame = encode_frame(Content(5, timestamp_s=1.0, exposure_ticks=900_000, transmit_ticks=1_000_000), LAYOUT)
    assert client.receive(frame, T0 + 1) is None
    assert client.counters["before_clock"] == 1
    client.receive(handshake.encode_echo_response(T0, 1_000_000), T0 + 100_000)
    stamped = client.receive(frame, T0 + 200_000)
    assert stamped is not None
    assert abs(stamped.transmit_ns - (T0 + 50_000)) <= 100
    assert stamped.transmit_ns - stamped.exposure_ns == 10_000_000
    assert 50_000 <= stamped.clock_error_ns < 60_000


def test_server_without_echo_is_stamped_by_arrival() -> None:
    client = client_in("streaming")
    frame = encode_frame(Content(5, timestamp_s=1.0, exposure_ticks=900_000, transmit_ticks=1_000_000), LAYOUT)
    stamped = client.receive(frame, T0 + 2 * SECOND)
    assert stamped is not None
    assert (stamped.transmit_ns, stamped.exposure_ns) == (T0 + 2 * SECOND, T0 + 2 * SECOND - 10_000_000)
    assert client.counters["unsynchronised"] == 1


@given(st.lists(st.one_of(st.sampled_from(list(DATAGRAMS.values())), st.binary(max_size=60)), max_size=30))
def test_no_order_of_datagrams_breaks_it(datagrams: list[bytes]) -> None:
    client = Client("test", V41, multicast=False)
    for number, datagram in enumerate(datagrams):
        now_ns = T0 + number * 300_000_000
        client.outbox(now_ns)
        client.receive(datagram, now_ns)
        assert client.next_due_ns(now_ns) <= now_ns + 2 * SECOND
        assert len(client.outbox(now_ns)) <= 5

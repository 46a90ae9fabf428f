"""What real systems and other people's servers do that the emulated one does not."""

import select
import socket
import struct
import time
from collections.abc import Sequence

import pytest

from contract.arena import Arena
from mocap_bridge.health import Health, _body
from mocap_bridge.mock.bodies import BodyState, ServerSettings
from mocap_bridge.mock.server import EmulatedServer
from mocap_bridge.natnet import handshake, modeldef, version
from mocap_bridge.natnet.client import QUICK_RETRY_NS, Client
from mocap_bridge.natnet.frame import TRACKING_VALID, Body
from mocap_bridge.natnet.frame_encode import Channels, Content, Marker, encode_frame
from mocap_bridge.natnet.handshake import ServerInfo
from mocap_bridge.natnet.modeldef import BodyModel
from mocap_bridge.natnet.version import Version
from mocap_bridge.natnet.wire import MessageId, packet
from mocap_bridge.sources.choose import open_natnet
from mocap_bridge.sources.natnet_receiver import NatNetReceiver
from mocap_bridge.track import Track
from tests.mocap_bridge.lockstep import arena
from tests.mocap_bridge.test_mocap_bridge import on_free_ports
from tests.mocap_bridge.test_natnet_modeldef import others

MILLISECOND = 1_000_000
T0 = 100_000 * MILLISECOND
PERIOD_NS = 8_333_333
INFO = ServerInfo("Motive", (2, 1, 0, 0), Version(3, 0), 3_312_787, 1511, True, "239.255.42.99")
ROBOTS = (BodyModel("r06", 1, markers=((0.0, 0.0, 0.0),) * 4), BodyModel("r08", 2, markers=((0.0, 0.0, 0.0),) * 4))
EVERY_VERSION = [Version(*v) for v in ((2, 6), (2, 7), (2, 9), (2, 11), (3, 0), (3, 1), (4, 0), (4, 1), (4, 2), (4, 3))]


def body(identity: int, x: float = 1.0, params: int = TRACKING_VALID) -> Body:
    return (identity, x, 0.05, -1.0, 0.0, 0.0, 0.0, 1.0, 0.0005, params)


def busy(number: int, bodies: Sequence[Body], ticks: int = 0, timestamp_s: float | None = None) -> Content:
    """A frame with everything that a laboratory's Motive streams beside its rigid bodies."""
    bones = [(k << 16 | 5, 0.1 * k, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.001, 1) for k in range(1, 22)]
    labeled = [
        Marker(1 << 16 | 1, (1.0, 0.1, -1.0), 0.0214, 0x0A, 0.0002),
        Marker(1 << 16 | 2, (0.0, 0.0, 0.0), 0.0214, 0x0B, 0.0),
        Marker(50_007, (0.17, 1.5, -0.84), 0.0202, 0x12, 0.0006),
        Marker(3 << 16 | 1, (0.17, 1.5, -0.84), 0.0202, 0x2C, 0.0006),
    ]
    return Content(
        number,
        bodies=bodies,
        body_markers={entry[0]: [(1.0, 0.1, -1.0)] * 4 for entry in bodies},
        marker_sets=[("r06", [(1.0, 0.1, -1.0)] * 4), ("Skelett \u00fc", [(0.0, 0.0, 0.0)] * 37), ("all", [])],
        unlabeled=[(0.2, 1.4, -0.9)] * 5,
        skeletons=[(5, bones)],
        assets=[(7, [body(1)], labeled[:2])],
        labeled=labeled,
        force_plates=[Channels(1, tuple((0.1,) * 10 for _ in range(6)))],
        devices=[Channels(1, ((0.1,) * 10, ()))],
        timecode=(0x17_22_11_05, 3),
        timestamp_s=1356.0 + number / 120.0 if timestamp_s is None else timestamp_s,
        exposure_ticks=max(ticks - 60_000, 0),
        received_ticks=max(ticks - 10_000, 0),
        transmit_ticks=ticks,
        precision=(1_700_000_000, 4_000_000_000),
        params=0x01,
    )


class Session:
    """A receiver connected to a server that says :data:`INFO`, or as told."""

    def __init__(self, info: ServerInfo = INFO, models: Sequence[BodyModel] = ROBOTS, multicast: bool = True) -> None:
        self.receiver = NatNetReceiver("test", Version(4, 1), multicast)
        self.layout = version.layout(info.natnet)
        self.now_ns = T0
        self.number = 0
        self.receiver.outbox(T0)
        self.receiver.receive(handshake.encode_server_info(info), T0)
        self.list(models)

    def list(self, models: Sequence[BodyModel], layout: version.Layout | None = None) -> None:
        layout = layout or self.layout
        datagram = modeldef.encode_models(models, layout, others(layout.version >= (3, 0), layout.version))
        self.receiver.receive(datagram, self.now_ns)

    def frame(self, bodies: Sequence[Body], **content: object) -> object:
        self.now_ns += PERIOD_NS
        self.number += 1
        return self.receiver.receive(encode_frame(busy(self.number, bodies, **content), self.layout), self.now_ns)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", EVERY_VERSION, ids=str)
def test_everything_a_laboratory_streams_leaves_the_bodies_as_they_are(name: Version) -> None:
    session = Session(INFO._replace(natnet=name, tick_hz=0))
    assert session.receiver.client.state == "streaming"
    frame = session.frame([body(1), body(2, 1.5, 0)])
    assert frame is not None
    assert {key: entry[1] for key, entry in frame.bodies.items()} == {"r06": 1.0, "r08": 1.5}  # type: ignore[attr-defined]
    assert session.receiver.status().malformed == 0


def test_subset_of_the_bodies_is_what_is_there() -> None:
    session = Session()
    session.now_ns += 1_100 * MILLISECOND
    assert set(session.frame([body(2)]).bodies) == {"r08"}  # type: ignore[attr-defined]
    assert not session.receiver.counters


def test_id_that_is_not_in_the_list_is_asked_for_and_hides_nobody() -> None:
    session = Session()
    session.now_ns += 1_100 * MILLISECOND
    assert set(session.frame([body(1), body(99)]).bodies) == {"r06"}  # type: ignore[attr-defined]
    assert packet(MessageId.REQUEST_MODELDEF) in session.receiver.outbox(session.now_ns + 1_000 * MILLISECOND)


def test_two_bodies_of_one_frame_with_the_same_id_are_nobodys() -> None:
    session = Session()
    session.now_ns += 1_100 * MILLISECOND
    assert set(session.frame([body(1), body(1, 2.0), body(2)]).bodies) == {"r08"}  # type: ignore[attr-defined]
    assert session.receiver.counters["repeated_id"] == 1


def test_bodies_that_share_a_streaming_id_are_refused_by_name() -> None:
    session = Session(models=(*ROBOTS, BodyModel("spare", 1)))
    status = session.receiver.status()
    assert (status.names, status.duplicate_ids) == ({"r08"}, {"r06", "spare"})
    track = Track("r06", "r06", 0.0)
    assert _body(track, status).reason == "duplicate_id"
    assert Health(120.0).message(status, [track], 1, T0).bodies[0].reason == "duplicate_id"


def test_list_with_shared_ids_is_asked_for_until_it_is_put_right() -> None:
    session = Session(models=(*ROBOTS, BodyModel("spare", 1)))
    request = packet(MessageId.REQUEST_MODELDEF)
    session.receiver.outbox(T0)
    session.now_ns = T0 + 1_900 * MILLISECOND
    session.frame([body(2)])
    assert request not in session.receiver.outbox(session.now_ns)
    assert request in session.receiver.outbox(T0 + 2_100 * MILLISECOND)
    session.list(ROBOTS)
    assert request not in session.receiver.outbox(T0 + 9_000 * MILLISECOND)
    assert session.receiver.status().names == {"r06", "r08"}


def test_body_that_is_listed_twice_alike_is_one() -> None:
    assert Session(models=(*ROBOTS, ROBOTS[0])).receiver.status().names == {"r06", "r08"}


@pytest.mark.parametrize("theirs", EVERY_VERSION[2:], ids=str)
@pytest.mark.parametrize("announced", [(3, 1), (4, 1), (4, 3)])
def test_model_list_in_another_layout_than_announced_is_read(announced: tuple[int, int], theirs: Version) -> None:
    session = Session(INFO._replace(natnet=Version(*announced)), models=())
    session.list(ROBOTS, version.layout(theirs))
    assert session.receiver.client.models.names == {1: "r06", 2: "r08"}


def test_body_model_with_markers_packed_otherwise_keeps_name_and_id() -> None:
    data = b"r06\0" + struct.pack("<ii3f", 1, -1, 0.0, 0.0, 0.0) + struct.pack("<5f", 0.5, 0.5, 0.5, 0.5, 0.1)
    datagram = packet(MessageId.MODELDEF, struct.pack("<iii", 1, modeldef.RIGID_BODY, len(data)) + data)
    session = Session(INFO._replace(natnet=Version(4, 1)), models=())
    session.receiver.receive(datagram, T0)
    assert session.receiver.client.models.names == {1: "r06"}


@pytest.mark.parametrize("message", [MessageId.DISCONNECT, MessageId.DISCONNECT_BY_TIMEOUT])
def test_client_that_is_shown_the_door_connects_again_at_once(message: MessageId) -> None:
    session = Session()
    session.receiver.receive(packet(message), T0)
    assert session.receiver.outbox(T0)[0][:2] == b"\0\0"
    session.receiver.receive(handshake.encode_server_info(INFO), T0)
    session.list(ROBOTS)
    assert (session.receiver.client.state, session.receiver.session) == ("streaming", 0)


def stamps(session: Session, count: int, **content: object) -> list[int]:
    """Ages of the poses in microseconds, frame by frame."""
    session.now_ns += 1_100 * MILLISECOND
    frames = [session.frame([body(1)], **content) for _ in range(count)]
    assert None not in frames
    return [(frame.received_ns - frame.exposure_ns) // 1000 for frame in frames]  # type: ignore[attr-defined]


@pytest.mark.parametrize("tick_hz", [0, 1, 10_000_000])
def test_server_whose_time_stands_still_is_stamped_by_arrival(tick_hz: int) -> None:
    session = Session(INFO._replace(tick_hz=tick_hz))
    assert stamps(session, 400, timestamp_s=0.0) == [0] * 400


def test_ticks_of_a_clock_without_a_frequency_are_not_used() -> None:
    assert max(stamps(Session(INFO._replace(tick_hz=0)), 300, ticks=123_456_789)) < 1_000


def test_exposure_that_the_server_does_not_know_is_the_transmission() -> None:
    session = Session()
    client = session.receiver.client
    session.receiver.receive(handshake.encode_echo_response(T0, 10_000), T0 + 100_000)
    for exposure in (0, 20_000):
        content = Content(session.number + 1, exposure_ticks=exposure, transmit_ticks=10_000)
        session.number += 1
        stamped = client.receive(encode_frame(content, session.layout), T0 + MILLISECOND)
        assert stamped is not None
        assert stamped.exposure_ns == stamped.transmit_ns


def test_frames_from_a_server_that_does_not_answer_are_named() -> None:
    receiver = NatNetReceiver("test", Version(4, 1), multicast=True)
    for number in range(30):
        receiver.outbox(T0 + number * QUICK_RETRY_NS)
        receiver.receive(encode_frame(busy(number, [body(1)]), version.layout(Version(4, 1))), T0)
    assert "does not answer on its command port" in receiver.status().problem


def test_version_that_is_too_old_is_told_to_update() -> None:
    client = Client("test", Version(4, 1), multicast=False)
    client.receive(handshake.encode_server_info(INFO._replace(natnet=Version(2, 5))), T0)
    assert client.state == "refused"
    assert "NatNet 2.5 is not supported" in client.problem
    assert "update Motive" in client.problem


# --- on sockets -------------------------------------------------------------------------------------


class PlainServer:
    """One socket for everything: frames leave from the command port to the client's data port."""

    def __init__(self, site: Arena) -> None:
        mocap = site.mocap
        self._server = EmulatedServer(ServerSettings(mocap=mocap), ["r06"])
        self._data_port = mocap.data_port
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((mocap.server, mocap.command_port))

    def turn(self) -> None:
        while select.select([self._socket], [], [], 0)[0]:
            datagram, sender = self._socket.recvfrom(65535)
            if b"UnitsToMillimeters" not in datagram:
                for answer in self._server.receive(datagram, sender, time.monotonic_ns()):
                    self._socket.sendto(answer.data, sender)
        now_ns = time.monotonic_ns()
        if now_ns >= self._server.next_due_ns:
            for frame in self._server.stream(now_ns, [BodyState("r06", 1.0, 1.0, 0.0)]):
                self._socket.sendto(frame.data, (frame.to[0], self._data_port))

    def close(self) -> None:
        self._socket.close()


def test_server_that_unicasts_to_the_data_port_is_heard() -> None:
    site = on_free_ports(arena())
    server, source = PlainServer(site), open_natnet(site)
    try:
        limit = time.monotonic() + 10.0
        frames: list[object] = []
        while len(frames) < 5:
            assert time.monotonic() < limit, source.status()
            server.turn()
            source.wait(0.001)
            frames += source.receive(time.monotonic_ns())
    finally:
        source.close()
        server.close()
    assert source.status().counters["command_unanswered"]


def test_one_datagram_of_a_socket_is_taken_a_wake_and_all_of_them_without_one() -> None:
    site = on_free_ports(arena())
    source, frame = open_natnet(site), encode_frame(busy(1, [body(1)]), version.layout(Version(4, 1)))
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.bind((site.mocap.server, site.mocap.command_port))
    try:
        source.send(time.monotonic_ns())
        _, client = sender.recvfrom(65535)
        for _ in range(4):
            sender.sendto(frame, client)
        taken = []
        for waits in (True, True, False, True):
            if waits:
                source.wait(0.0)
            assert source.receive(time.monotonic_ns()) == []
            taken.append(source.receiver.counters["early_frame"] + source.receiver.client.counters["early_frame"])
    finally:
        source.close()
        sender.close()
    assert taken == [1, 2, 4, 4]

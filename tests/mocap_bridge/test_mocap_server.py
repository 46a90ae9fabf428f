"""The emulated server: due times without drift, versions by client, axes, the habits clients rely on."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import astuple

from contract.arena import Mocap
from mocap_bridge.frames import ArenaFrame
from mocap_bridge.mock.bodies import BodyState, ServerSettings
from mocap_bridge.mock.script import KINDS, ScriptError, parse
from mocap_bridge.mock.server import CLIENT_TIMEOUT_NS, EmulatedServer
from mocap_bridge.natnet import handshake, modeldef, version
from mocap_bridge.natnet.frame import decode_frame
from mocap_bridge.natnet.handshake import Connect
from mocap_bridge.natnet.version import Version
from mocap_bridge.natnet.wire import MessageId, open_packet, packet

CLIENT = ("10.0.0.2", 4000)
POSES = [BodyState("r06", 1.0, 2.0, 0.5)]


def server(**mocap: object) -> EmulatedServer:
    return EmulatedServer(ServerSettings(mocap=Mocap(**mocap)), ["r06"])  # type: ignore[arg-type]


def connect(emulated: EmulatedServer, asked: Version = handshake.ANY_VERSION) -> None:
    [answer] = emulated.receive(handshake.encode_connect(Connect("c", Version(4, 1), False, asked)), CLIENT, 0)
    assert (answer.from_data_port, answer.to) == (False, CLIENT)


@pytest.mark.parametrize("rate_hz", [100.0, 120.0, 240.0, 360.0])
def test_rate_does_not_drift_however_late_the_calls(rate_hz: float) -> None:
    emulated = server(frame_rate_hz=rate_hz)
    connect(emulated)
    period_ns = 1e9 / rate_hz
    count, now_ns = 0, 0
    for step in range(2000):
        emulated.receive(packet(MessageId.KEEPALIVE), CLIENT, now_ns)
        count += len(emulated.stream(now_ns, POSES))
        now_ns = emulated.next_due_ns + (step * 7919) % round(0.9 * period_ns)
    assert count == 2000
    assert abs(emulated.next_due_ns - 2000 * period_ns) < 2000, "half a nanosecond a period at most"


def test_missed_frames_are_missing_numbers() -> None:
    emulated = server(frame_rate_hz=100.0)
    connect(emulated)
    first = emulated.stream(0, POSES)[0].data
    second = emulated.stream(45_000_000, POSES)[0].data
    layout = version.layout(Version(4, 1))
    assert [decode_frame(data, layout).number for data in (first, second)] == [0, 4]
    assert emulated.next_due_ns == 50_000_000


@pytest.mark.parametrize("own", [(2, 9), (3, 0), (3, 1), (4, 0), (4, 1), (4, 2), (4, 3)])
@pytest.mark.parametrize("asked", [(0, 0), (2, 9), (3, 1), (4, 3), (9, 9)])
def test_unicast_client_gets_the_version_it_asks_for(own: tuple[int, int], asked: tuple[int, int]) -> None:
    emulated = server(version=f"{own[0]}.{own[1]}")
    connect(emulated, Version(*asked))
    used = Version(*(min(asked, own) if asked[0] else own))
    [datagram] = emulated.stream(0, POSES)
    frame = decode_frame(datagram.data, version.layout(used))
    assert (datagram.from_data_port, datagram.to) == (True, CLIENT)
    assert frame.bodies[0][9] == 1
    [models] = emulated.receive(packet(MessageId.REQUEST_MODELDEF), CLIENT, 0)
    assert [b.name for b in modeldef.decode_models(open_packet(models.data), version.layout(used))] == ["r06"]


def test_multicast_goes_to_the_group_in_the_servers_own_version() -> None:
    emulated = server(multicast_group="239.255.42.99", version="3.1")
    connect(emulated, Version(2, 9))
    [datagram] = emulated.stream(0, POSES)
    assert datagram.to == ("239.255.42.99", 1511)
    assert decode_frame(datagram.data, version.layout(Version(3, 1))).bodies


def test_client_that_falls_silent_gets_no_more_frames() -> None:
    emulated = server()
    connect(emulated)
    emulated.stream(0, POSES)
    assert emulated.stream(CLIENT_TIMEOUT_NS, POSES)
    assert not emulated.stream(CLIENT_TIMEOUT_NS + 20_000_000, POSES)
    assert emulated.counters["client_timeout"] == 1


def test_commands() -> None:
    emulated = server(frame_rate_hz=240.0)
    connect(emulated)

    def answer(text: str) -> bytes:
        return emulated.receive(handshake.encode_command(text), CLIENT, 0)[0].data

    assert handshake.decode_float_answer(open_packet(answer("FrameRate"))) == 240.0
    assert handshake.decode_float_answer(open_packet(answer("UnitsToMillimeters"))) == 1000.0
    assert answer("Bitstream,3.1") == handshake.encode_integer_answer(0)
    assert decode_frame(emulated.stream(0, POSES)[0].data, version.layout(Version(3, 1))).bodies
    assert open_packet(answer("MakeCoffee")).id == MessageId.UNRECOGNIZED


@given(st.binary(max_size=300), st.integers(0, 15))
def test_garbage_is_counted_and_harms_nothing(data: bytes, message: int) -> None:
    emulated = server()
    connect(emulated)
    emulated.receive(data, CLIENT, 0)
    emulated.receive(packet(message, data), ("10.0.0.3", 1), 0)
    assert emulated.receive(packet(MessageId.REQUEST_MODELDEF), CLIENT, 0)


angle = st.floats(-3.1, 3.1)


@given(
    x=st.floats(-5.0, 5.0),
    y=st.floats(-5.0, 5.0),
    heading=angle,
    axis=st.sampled_from(["y", "z"]),
    origin=st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)),
    rotation=angle,
    offset=angle,
)
def test_axes_there_and_back(
    x: float, y: float, heading: float, axis: str, origin: tuple[float, float], rotation: float, offset: float
) -> None:
    frame = ArenaFrame(Mocap(up_axis=axis, origin_m=origin, rotation_rad=rotation))  # type: ignore[arg-type]
    position, turned = frame.source(x, y, heading, 0.1, offset)
    pose = frame.pose(position, turned, offset)
    assert math.dist((pose.x_m, pose.y_m, pose.z_m), (x, y, 0.1)) < 1e-9
    assert abs(math.remainder(pose.heading_rad - heading, math.tau)) < 1e-9
    assert pose.up == pytest.approx(1.0)


def test_axes_golden() -> None:
    """A quarter turn to the left: about +y where y is up, about +z where z is up."""
    half = math.sqrt(0.5)
    assert astuple(ArenaFrame(Mocap(up_axis="y")).pose((1.0, 3.0, -2.0), (0.0, half, 0.0, half))) == pytest.approx(
        (1.0, 2.0, 3.0, math.pi / 2, 1.0)
    )
    assert astuple(ArenaFrame(Mocap(up_axis="z")).pose((1.0, 2.0, 3.0), (0.0, 0.0, half, half))) == pytest.approx(
        (1.0, 2.0, 3.0, math.pi / 2, 1.0)
    )
    moved = ArenaFrame(Mocap(up_axis="z", origin_m=(1.0, 2.0), rotation_rad=math.pi / 2))
    assert astuple(moved.pose((1.0, 3.0, 0.0), (0.0, 0.0, half, half))) == pytest.approx((1.0, 0.0, 0.0, 0.0, 1.0))


def test_script_reads_every_kind() -> None:
    lines = [f"1 2 {kind} a b 0.5" if kind == "swap" else f"1 2 {kind} a 0.5" for kind in KINDS]
    for line, kind in zip(lines, KINDS, strict=True):
        words = line.replace(" a ", " ") if kind not in ("swap",) else "1 2 swap a b"
        for text in (line, words):
            try:
                [fault] = parse(f"# comment\n{text}\n").faults
            except ScriptError:
                continue
            assert (fault.kind, fault.start_s, fault.duration_s) == (kind, 1.0, 2.0)
            break
        else:
            pytest.fail(kind)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 2", "line 1: START DURATION KIND"),
        ("\n1 2 nonsense", "line 2: 'nonsense' is no fault"),
        ("1 x drop", "'x' is not a number"),
        ("-1 1 drop", "negative"),
        ("1 1 swap r06", "swap needs 2"),
        ("1 1 jump r06", "jump takes a value"),
        ("1 1 drop 0.5 0.5", "at most one value"),
        ("1 nan drop", "usable"),
    ],
)
def test_script_faults_are_named(text: str, said: str) -> None:
    with pytest.raises(ScriptError, match=said):
        parse(text)


def test_habits_of_clients_are_borne() -> None:
    """Sizes that count the header, requests with a NUL more, a question for the bit stream in words."""
    emulated = server(version="4.2")
    [info] = emulated.receive(b"\0\0\4\0", CLIENT, 0)
    assert handshake.decode_server_info(open_packet(info.data)).natnet == Version(4, 2)
    assert emulated.receive(b"\4\0\4\0", CLIENT, 0)[0].data[:2] == b"\5\0"
    assert emulated.receive(b"\4\0\0\0\0", CLIENT, 0)[0].data[:2] == b"\5\0"
    [answer] = emulated.receive(handshake.encode_command("Bitstream"), CLIENT, 0)
    assert answer.data == b"\3\0\x0d\0Bitstream,4.2"
    assert emulated.receive(packet(MessageId.DISCOVERY, b"x" * 264), CLIENT, 0)[0].data == info.data
    assert emulated.counters["malformed"] == 0

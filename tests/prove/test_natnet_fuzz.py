"""A million mangled datagrams through every NatNet decoder, client and server: one kind of error, no memory."""

import random
import tracemalloc

import pytest

from contract.arena import Mocap
from contract.codec import encode
from contract.messages import ExternalBody, ExternalFrame
from mocap_bridge.mock.bodies import ServerSettings
from mocap_bridge.mock.server import EmulatedServer
from mocap_bridge.natnet import handshake, modeldef, version
from mocap_bridge.natnet.client import Client
from mocap_bridge.natnet.frame import decode_frame
from mocap_bridge.natnet.frame_encode import Channels, Content, Marker, encode_frame
from mocap_bridge.natnet.modeldef import BodyModel
from mocap_bridge.natnet.version import Version
from mocap_bridge.natnet.wire import Malformed, MessageId, open_packet
from mocap_bridge.sources.external_receiver import ExternalReceiver
from tests.mocap_bridge.lockstep import arena

VERSIONS = [Version(*v) for v in ((2, 6), (2, 9), (2, 11), (3, 0), (4, 0), (4, 1), (4, 3))]
ROUNDS = 1_000_000
MEMORY_BYTES = 2_000_000
BODY = (7, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.0005, 1)
INTERESTING = (b"\0\0\0\0", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0\0\x80\x7f", b"\1\0\0\0")


def datagrams(name: Version) -> list[bytes]:
    layout = version.layout(name)
    content = Content(
        9,
        bodies=[BODY, BODY],
        body_markers={7: [(1.0, 2.0, 3.0)]},
        marker_sets=[("all", [(0.0, 0.0, 0.0)])],
        unlabeled=[(1.0, 1.0, 1.0)],
        skeletons=[(1, [BODY])],
        assets=[(2, [BODY], [Marker(1, (0.0, 0.0, 0.0))])],
        labeled=[Marker(1, (0.0, 0.0, 0.0))],
        force_plates=[Channels(1, ((1.0, 2.0),))],
        devices=[Channels(2, ((1.0,), ()))],
        timestamp_s=2.5,
    )
    plain = Content(9, bodies=[BODY], labeled=[Marker(1, (0.0, 0.0, 0.0))], timestamp_s=1.0)
    info = handshake.ServerInfo("Motive", (3, 1, 0, 0), name, 10_000_000)
    return [
        encode_frame(content, layout),
        encode_frame(plain, layout),
        modeldef.encode_models([BodyModel("r06", 1, markers=((0.0, 0.0, 0.0),))], layout, [(2, b"man\0" + bytes(8))]),
        handshake.encode_server_info(info),
        handshake.encode_echo_response(1, 2),
        handshake.encode_connect(handshake.Connect("me", name)),
        handshake.encode_float_answer(120.0),
        handshake.encode_command(f"Bitstream,{name}"),
    ]


def mangled(draw: random.Random, datagram: bytes) -> bytes:
    data = bytearray(datagram)
    for _ in range(draw.randrange(1, 5)):
        match draw.randrange(4):
            case 0:
                data[draw.randrange(len(data))] = draw.randrange(256)
            case 1:
                at = draw.randrange(len(data))
                data[at : at + 4] = draw.choice(INTERESTING)
            case 2:
                data[draw.randrange(len(data)) :] = b""
                data += b"" if len(data) > 4 else b"\7\0\0\0"
            case _:
                at = draw.randrange(len(data))
                data[at:at] = data[at : at + draw.randrange(40)]
    return bytes(data)


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", VERSIONS, ids=str)
def test_a_million_mangled_datagrams(name: Version) -> None:
    draw = random.Random(repr(name))
    seeds, layout = datagrams(name), version.layout(name)
    client = Client("fuzz", name, multicast=False)
    server = EmulatedServer(ServerSettings(mocap=Mocap(version=str(name))), ["r06"])
    refused = 0
    for number in range(ROUNDS // len(VERSIONS)):
        if number == ROUNDS // len(VERSIONS) * 9 // 10:
            tracemalloc.start()
        data = mangled(draw, seeds[number % len(seeds)])
        try:
            opened = open_packet(data)
            if opened.id == MessageId.FRAME:
                assert 38 * len(decode_frame(data, layout).bodies) <= len(data)
            elif opened.id == MessageId.MODELDEF:
                modeldef.decode_models(opened, layout)
            elif opened.id == MessageId.SERVERINFO:
                handshake.decode_server_info(opened)
            elif opened.id == MessageId.ECHO_RESPONSE:
                handshake.decode_echo_response(opened)
        except Malformed:
            refused += 1
        client.receive(data, 10**9 + number * 1_000_000)
        server.receive(data, ("10.0.0.2", number % 100), number * 1_000_000)
        if number % 50 == 0:
            client.outbox(10**9 + number * 1_000_000)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < MEMORY_BYTES
    assert refused > ROUNDS // len(VERSIONS) // 20


@pytest.mark.timeout(1200)
def test_mangled_external_poses() -> None:
    draw = random.Random("external")
    body = ExternalBody(body="r06", x_m=1.0, y_m=2.0, heading_rad=0.5)
    seeds = [encode(ExternalFrame(seq=k, stamp_ns=10**12, bodies=(body,) * k)) for k in range(4)]
    receiver = ExternalReceiver(arena())
    for number in range(ROUNDS // 5):
        if number == ROUNDS // 5 * 9 // 10:
            tracemalloc.start()
        receiver.receive(mangled(draw, seeds[number % len(seeds)]), 10**12 + number)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < MEMORY_BYTES
    assert receiver.counters["malformed"] > ROUNDS // 20

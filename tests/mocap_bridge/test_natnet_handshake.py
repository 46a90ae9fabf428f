"""Connect, server info, echo, commands: the payload sizes in use, golden bytes, garbage."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocap_bridge.natnet import handshake
from mocap_bridge.natnet.handshake import Connect, ServerInfo
from mocap_bridge.natnet.version import Version
from mocap_bridge.natnet.wire import Malformed, MessageId, open_packet, packet

INFO = ServerInfo("Motive", (3, 1, 0, 0), Version(4, 1), 10_000_000, 1511, True, "239.255.42.99")


def test_server_info_golden() -> None:
    golden = (
        bytes.fromhex("0100 1701")
        + b"Motive".ljust(256, b"\0")
        + bytes.fromhex("03010000 04010000 8096980000000000 e705 01 efff2a63")
    )
    assert len(golden) == 4 + 279
    assert handshake.encode_server_info(INFO) == golden
    assert handshake.decode_server_info(open_packet(golden)) == INFO


def test_server_info_before_3_0_has_no_clock() -> None:
    old = INFO._replace(natnet=Version(2, 9))
    datagram = handshake.encode_server_info(old)
    assert len(datagram) == 4 + 264
    assert handshake.decode_server_info(open_packet(datagram)).tick_hz == 0


@pytest.mark.parametrize("tick_hz", [0, 999, 1 << 63])
def test_clock_that_does_not_tick_is_none(tick_hz: int) -> None:
    info = handshake.decode_server_info(open_packet(handshake.encode_server_info(INFO._replace(tick_hz=tick_hz))))
    assert info == INFO._replace(tick_hz=0)


@pytest.mark.parametrize("size", [0, 5, 264, 269, 271, 273])
def test_connect_of_every_size_in_use(size: int) -> None:
    full = handshake.encode_connect(Connect("me", Version(4, 1), True, Version(3, 1)))[4:]
    assert len(full) == 269
    payload = b"Ping\0" if size == 5 else full[:size].ljust(size, b"\0")
    connect = handshake.decode_connect(open_packet(packet(MessageId.CONNECT, payload)))
    assert connect.bitstream == (Version(3, 1) if size >= 269 else handshake.ANY_VERSION)
    assert connect.name == {0: "", 5: "Ping"}.get(size, "me")


def test_echo_golden() -> None:
    assert handshake.encode_echo_request(1) == bytes.fromhex("0c00 0800 0100000000000000")
    answer = bytes.fromhex("0d00 1000 0100000000000000 0200000000000000")
    assert handshake.encode_echo_response(1, 2) == answer
    assert handshake.decode_echo_response(open_packet(answer)) == (1, 2)


def test_command_golden() -> None:
    assert handshake.encode_command("FrameRate") == b"\x02\x00\x0a\x00FrameRate\0"
    assert handshake.decode_float_answer(open_packet(handshake.encode_float_answer(120.0))) == 120.0


def test_keepalive_introduces_the_client() -> None:
    assert len(handshake.encode_keepalive("me", Version(4, 1))) == 4 + 264


@given(st.binary(max_size=320), st.integers(0, 15))
def test_garbage_raises_nothing_but_malformed(payload: bytes, message: int) -> None:
    for datagram in (payload, packet(message, payload), struct.pack("<HH", message, 65535) + payload):
        try:
            opened = open_packet(datagram)
        except Malformed:
            continue
        handshake.decode_connect(opened)
        handshake.decode_text(opened)
        for decode in (
            handshake.decode_server_info,
            handshake.decode_echo_request,
            handshake.decode_echo_response,
            handshake.decode_float_answer,
        ):
            try:
                decode(opened)
            except Malformed:
                continue

"""Everything but frames and model lists: connect, server info, echo, commands and their answers."""

import struct
from typing import NamedTuple

from mocap_bridge.natnet.version import Version
from mocap_bridge.natnet.wire import Malformed, MessageId, Packet, cstring, fixed, packet

_SENDER = struct.Struct("<256s4B4B")
_SUBSCRIPTION = struct.Struct("<B4B")
_CLOCK = struct.Struct("<QHB4B")
_ECHO = struct.Struct("<Q")
_ECHO_ANSWER = struct.Struct("<QQ")

ANY_VERSION = Version(0, 0)
"""Bit stream of a client that takes the server's own."""


class Connect(NamedTuple):
    """What a client says of itself. Payloads of 0, 5, 264 and 269 bytes and more are in use."""

    name: str = ""
    natnet: Version = ANY_VERSION
    subscribed_only: bool = False
    bitstream: Version = ANY_VERSION
    """Version it asks for; honoured in unicast only."""


class ServerInfo(NamedTuple):
    """What a server says of itself."""

    name: str
    app: tuple[int, int, int, int]
    natnet: Version
    tick_hz: int = 0
    """Ticks per second of the server's stamps; 0 before 3.0, and where its clock does not tick."""
    data_port: int = 1511
    multicast: bool = True
    group: str = "239.255.42.99"


def _text(data: bytes) -> str:
    return data.split(b"\0", 1)[0].decode("utf-8", "replace")


def sender_block(name: str, natnet: Version) -> bytes:
    """The 264 bytes that introduce either side; the application version is 1.0."""
    return _SENDER.pack(fixed(name), 1, 0, 0, 0, natnet.major, natnet.minor, 0, 0)


def encode_connect(connect: Connect) -> bytes:
    """A CONNECT datagram of 269 bytes of payload."""
    tail = _SUBSCRIPTION.pack(connect.subscribed_only, connect.bitstream.major, connect.bitstream.minor, 0, 0)
    return packet(MessageId.CONNECT, sender_block(connect.name, connect.natnet) + tail)


def decode_connect(opened: Packet) -> Connect:
    """Any payload in use; one too short for a field leaves it at its default."""
    payload = opened.data[4 : opened.end]
    if len(payload) < _SENDER.size:
        return Connect(name=_text(payload))
    fields = _SENDER.unpack_from(payload)
    connect = Connect(_text(fields[0]), Version(fields[5], fields[6]))
    if len(payload) < _SENDER.size + _SUBSCRIPTION.size:
        return connect
    subscribed, major, minor, _, _ = _SUBSCRIPTION.unpack_from(payload, _SENDER.size)
    return connect._replace(subscribed_only=bool(subscribed), bitstream=Version(major, minor))


def encode_keepalive(name: str, natnet: Version) -> bytes:
    """A KEEPALIVE datagram in the long form that every server takes."""
    return packet(MessageId.KEEPALIVE, sender_block(name, natnet))


def encode_server_info(info: ServerInfo) -> bytes:
    """A SERVERINFO datagram; clock and addresses from 3.0 on."""
    payload = _SENDER.pack(fixed(info.name), *info.app, info.natnet.major, info.natnet.minor, 0, 0)
    if info.natnet >= (3, 0):
        group = tuple(int(part) for part in info.group.split("."))
        payload += _CLOCK.pack(info.tick_hz, info.data_port, info.multicast, *group)
    return packet(MessageId.SERVERINFO, payload)


def decode_server_info(opened: Packet) -> ServerInfo:
    """The server's answer to CONNECT.

    A clock that does not tick as clocks do counts as none.

    :raises Malformed: too short for the name and versions.
    """
    left = opened.end - 4
    if left < _SENDER.size:
        raise Malformed("server info", f"{left} bytes, at least {_SENDER.size} needed")
    fields = _SENDER.unpack_from(opened.data, 4)
    app = (fields[1], fields[2], fields[3], fields[4])
    info = ServerInfo(_text(fields[0]), app, Version(fields[5], fields[6]))
    if left < _SENDER.size + _CLOCK.size:
        return info
    tick_hz, data_port, multicast, *group = _CLOCK.unpack_from(opened.data, 4 + _SENDER.size)
    if not 1_000 <= tick_hz <= 100_000_000_000:
        tick_hz = 0
    return info._replace(
        tick_hz=tick_hz, data_port=data_port, multicast=bool(multicast), group=".".join(map(str, group))
    )


def encode_echo_request(client_time: int) -> bytes:
    """An ECHO_REQUEST with the client's own time, any unit."""
    return packet(MessageId.ECHO_REQUEST, _ECHO.pack(client_time))


def decode_echo_request(opened: Packet) -> int:
    """The client's time.

    :raises Malformed: shorter than 8 bytes.
    """
    if opened.end - 4 < _ECHO.size:
        raise Malformed("echo request", f"{opened.end - 4} bytes, 8 needed")
    value: int = _ECHO.unpack_from(opened.data, 4)[0]
    return value


def encode_echo_response(client_time: int, server_ticks: int) -> bytes:
    """An ECHO_RESPONSE."""
    return packet(MessageId.ECHO_RESPONSE, _ECHO_ANSWER.pack(client_time, server_ticks))


def decode_echo_response(opened: Packet) -> tuple[int, int]:
    """The client's own time as it sent it, and the server's ticks.

    :raises Malformed: shorter than 16 bytes.
    """
    if opened.end - 4 < _ECHO_ANSWER.size:
        raise Malformed("echo response", f"{opened.end - 4} bytes, 16 needed")
    client_time, ticks = _ECHO_ANSWER.unpack_from(opened.data, 4)
    return client_time, ticks


def encode_command(text: str) -> bytes:
    """A REQUEST such as ``FrameRate``."""
    return packet(MessageId.REQUEST, cstring(text))


def decode_text(opened: Packet) -> str:
    """The text of a REQUEST or MESSAGESTRING, up to its NUL."""
    return _text(opened.data[4 : opened.end])


def encode_float_answer(value: float) -> bytes:
    """A RESPONSE of one number."""
    return packet(MessageId.RESPONSE, struct.pack("<f", value))


def encode_integer_answer(value: int) -> bytes:
    """A RESPONSE of one integer; 0 is success."""
    return packet(MessageId.RESPONSE, struct.pack("<i", value))


def encode_text_answer(text: str) -> bytes:
    """A RESPONSE of words; without a NUL, which clients would read as part of the last one."""
    return packet(MessageId.RESPONSE, text.encode("utf-8"))


def decode_float_answer(opened: Packet) -> float:
    """The number in a RESPONSE.

    :raises Malformed: not 4 bytes.
    """
    if opened.end - 4 != 4:
        raise Malformed("response", f"{opened.end - 4} bytes, 4 needed")
    value: float = struct.unpack_from("<f", opened.data, 4)[0]
    return value

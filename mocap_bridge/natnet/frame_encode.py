"""Encode a frame of motion-capture data with every section, for the emulated server and the tests."""

import struct
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from mocap_bridge.natnet.frame import Body
from mocap_bridge.natnet.version import Layout
from mocap_bridge.natnet.wire import MessageId, cstring, packet

Point3 = tuple[float, float, float]


class Marker(NamedTuple):
    """A labeled marker; ``id`` is the body's id times 65536 plus the marker's."""

    id: int
    position: Point3
    size: float = 0.014
    params: int = 0
    residual: float = 0.0


class Channels(NamedTuple):
    """A force plate or device: its id and the values of each channel."""

    id: int
    channels: tuple[tuple[float, ...], ...]


class Content(NamedTuple):
    """Everything a frame can carry; a layout leaves out what it has no section for."""

    number: int
    bodies: Sequence[Body] = ()
    body_markers: Mapping[int, Sequence[Point3]] = MappingProxyType({})
    """Markers of a body by its id, sent inside the body before 3.0."""
    marker_sets: Sequence[tuple[str, Sequence[Point3]]] = ()
    unlabeled: Sequence[Point3] = ()
    skeletons: Sequence[tuple[int, Sequence[Body]]] = ()
    assets: Sequence[tuple[int, Sequence[Body], Sequence[Marker]]] = ()
    labeled: Sequence[Marker] = ()
    force_plates: Sequence[Channels] = ()
    devices: Sequence[Channels] = ()
    timecode: tuple[int, int] = (0, 0)
    timestamp_s: float = 0.0
    exposure_ticks: int = 0
    received_ticks: int = 0
    transmit_ticks: int = 0
    precision: tuple[int, int] = (0, 0)
    params: int = 0
    latency_s: float = 0.0


_BODY = struct.Struct("<i8fh")


def encode_frame(content: Content, layout: Layout, transmit_ticks: Callable[[], int] | None = None) -> bytes:
    """A FRAME datagram.

    :param transmit_ticks: asked when all else is encoded, as a server stamps what it is about to send.
    """
    sections = [
        _section(layout, len(content.marker_sets), b"".join(_marker_set(*entry) for entry in content.marker_sets)),
        _section(layout, len(content.unlabeled), _points(content.unlabeled)),
        _section(layout, len(content.bodies), b"".join(_body(layout, b, content.body_markers) for b in content.bodies)),
        _section(layout, len(content.skeletons), b"".join(_skeleton(layout, *entry) for entry in content.skeletons)),
    ]
    if layout.assets:
        sections.append(_section(layout, len(content.assets), b"".join(_asset(*entry) for entry in content.assets)))
    sections.append(_section(layout, len(content.labeled), b"".join(_marker(layout, m) for m in content.labeled)))
    if layout.force_plates:
        sections.append(_section(layout, len(content.force_plates), b"".join(map(_channels, content.force_plates))))
    if layout.devices:
        sections.append(_section(layout, len(content.devices), b"".join(map(_channels, content.devices))))
    head = struct.pack("<i", content.number) + b"".join(sections)
    if transmit_ticks is not None:
        content = content._replace(transmit_ticks=transmit_ticks())
    payload = head + _suffix(content, layout)
    return packet(MessageId.FRAME, payload)


def _section(layout: Layout, count: int, data: bytes) -> bytes:
    return struct.pack("<ii", count, len(data)) + data if layout.sized else struct.pack("<i", count) + data


def _points(points: Sequence[Point3]) -> bytes:
    return b"".join(struct.pack("<3f", *point) for point in points)


def _marker_set(name: str, points: Sequence[Point3]) -> bytes:
    return cstring(name) + struct.pack("<i", len(points)) + _points(points)


def _body(layout: Layout, body: Body, markers: Mapping[int, Sequence[Point3]]) -> bytes:
    if not layout.marker_lists:
        return _BODY.pack(*body)
    points = markers.get(body[0], ())
    size = len(points)
    labels_and_sizes = struct.pack(f"<{size}i{size}f", *range(1, size + 1), *([0.014] * size))
    head = struct.pack("<i7fi", *body[:8], size)
    return head + _points(points) + labels_and_sizes + struct.pack("<fh", *body[8:])


def _skeleton(layout: Layout, identity: int, bones: Sequence[Body]) -> bytes:
    return struct.pack("<ii", identity, len(bones)) + b"".join(_body(layout, bone, {}) for bone in bones)


def _marker(layout: Layout, marker: Marker) -> bytes:
    data = struct.pack("<i4fh", marker.id, *marker.position, marker.size, marker.params)
    return data + struct.pack("<f", marker.residual) if layout.residuals else data


def _asset(identity: int, bodies: Sequence[Body], markers: Sequence[Marker]) -> bytes:
    packed = b"".join(struct.pack("<i4fhf", m.id, *m.position, m.size, m.params, m.residual) for m in markers)
    head = struct.pack("<ii", identity, len(bodies)) + b"".join(_BODY.pack(*body) for body in bodies)
    return head + struct.pack("<i", len(markers)) + packed


def _channels(device: Channels) -> bytes:
    values = b"".join(struct.pack(f"<i{len(channel)}f", len(channel), *channel) for channel in device.channels)
    return struct.pack("<ii", device.id, len(device.channels)) + values


def _suffix(content: Content, layout: Layout) -> bytes:
    parts = [] if layout.ticks else [struct.pack("<f", content.latency_s)]
    parts.append(struct.pack("<II", *content.timecode))
    parts.append(struct.pack("<d" if layout.wide_timestamp else "<f", content.timestamp_s))
    if layout.ticks:
        parts.append(struct.pack("<QQQ", content.exposure_ticks, content.received_ticks, content.transmit_ticks))
    if layout.sized:
        parts.append(struct.pack("<II", *content.precision))
    parts.append(struct.pack("<hi", content.params, 0))
    return b"".join(parts)

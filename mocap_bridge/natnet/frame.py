"""Decode a frame of motion-capture data: its rigid bodies and its time, the rest is skipped."""

import struct
from typing import NamedTuple

from mocap_bridge.natnet.version import Layout
from mocap_bridge.natnet.wire import Malformed, MessageId, Reader

Body = tuple[int, float, float, float, float, float, float, float, float, int]
"""``(id, x, y, z, qx, qy, qz, qw, mean marker error, params)``, in the stream's axes and unit."""

BODY_BYTES = 38
"""Of a body in a frame, in this order."""
TRACKING_VALID = 0x01
"""Bit of a body's params."""
RECORDING, MODELS_CHANGED, EDIT_MODE, BITSTREAM_CHANGED = 0x01, 0x02, 0x04, 0x08
"""Bits of a frame's params."""

_BODY = struct.Struct("<i8fh")
_START = struct.Struct("<HHiii")
_SECTION = struct.Struct("<ii")
_TWO_SECTIONS = struct.Struct("<4i")
_THREE_SECTIONS = struct.Struct("<6i")
_TAIL = struct.Struct("<4iIIdQQQIIhi")
_TIMECODE = struct.Struct("<II")
_SUFFIX = struct.Struct("<IIdQQQ")
_PRECISION = struct.Struct("<II")
_END = struct.Struct("<hi")
_PARAMS = struct.Struct("<h")
_FLOAT = struct.Struct("<f")
_DOUBLE = struct.Struct("<d")
_FRAME = int(MessageId.FRAME)
_TAIL_BYTES = _TAIL.size
_new = tuple.__new__


class Frame(NamedTuple):
    """What the bridge takes from one frame."""

    number: int
    body_data: bytes
    """38 bytes a body; :attr:`bodies` makes tuples of them."""
    timestamp_s: float
    """Seconds since the server started."""
    exposure_ticks: int
    """Middle of the camera exposure on the server's clock; 0 where the version has no ticks."""
    received_ticks: int
    transmit_ticks: int
    precision: tuple[int, int]
    """Raw precision stamp (4.1): seconds and a fraction of unstated scale."""
    params: int
    latency_s: float
    """The server's own processing time (before 3.0)."""

    @property
    def bodies(self) -> list[Body]:
        """The rigid bodies; made afresh by every access."""
        return list(_BODY.iter_unpack(self.body_data))


def decode_frame(datagram: bytes, layout: Layout) -> Frame:
    """A FRAME datagram in the given layout.

    :raises Malformed: not a frame, or sizes and counts that do not fit; no other exception.
    """
    try:
        sized = layout.sized
        if sized and (frame := _decode_usual(datagram)) is not None:
            return frame
        frame = _decode_sized(datagram) if sized else _decode_walked(datagram, layout)
    except struct.error:
        raise Malformed("frame", f"datagram of {len(datagram)} bytes ends inside a field") from None
    if frame.number < 0 or not 0.0 <= frame.timestamp_s < 1e10:
        raise Malformed("suffix", f"frame {frame.number} at {frame.timestamp_s} s: neither may be negative or absurd")
    return frame


def _decode_usual(data: bytes) -> Frame | None:
    """The sections that most frames leave empty, read in four strides; None for any other frame.

    Whatever it takes, :func:`_decode_sized` takes with the same result; it only makes half the calls.
    """
    message, size, number, count, skip = _START.unpack_from(data)
    end, offset = size + 4, 16 + skip
    if message != _FRAME or end > len(data) or count < 0 or skip < 0 or offset + 16 > end:
        return None
    loose, loose_bytes, count, skip = _TWO_SECTIONS.unpack_from(data, offset)
    start = offset + 16
    offset = start + skip
    if loose or loose_bytes or skip < 0 or skip != count * 38 or offset + 24 > end:
        return None
    skeletons, bones, assets, parts, count, skip = _THREE_SECTIONS.unpack_from(data, offset)
    bodies = data[start:offset]
    offset += 24 + skip
    if skeletons or bones or assets or parts or count < 0 or skip < 0 or offset + _TAIL_BYTES != end:
        return None
    plates, a, devices, b, _, _, timestamp_s, exposure, received, transmit, sec, frac, params, tag = _TAIL.unpack_from(
        data, offset
    )
    if plates or a or devices or b or tag or number < 0 or not 0.0 <= timestamp_s < 1e10:
        return None
    # Frame(...) without its own Python call
    return _new(Frame, (number, bodies, timestamp_s, exposure, received, transmit, (sec, frac), params, 0.0))


def _decode_sized(data: bytes) -> Frame:
    message, size, number, count, skip = _START.unpack_from(data)
    end = size + 4
    if message != _FRAME or end > len(data):
        raise Malformed("header", f"id {message}, {size} bytes announced, {len(data) - 4} came")
    offset = 16 + skip
    if count < 0 or skip < 0 or offset > end:
        raise Malformed("marker sets", f"{count} sets in {skip} bytes do not fit")
    unpack = _SECTION.unpack_from
    count, skip = unpack(data, offset)
    offset += 8 + skip
    if count < 0 or skip < 0 or offset > end:
        raise Malformed("unlabeled markers", f"{count} markers in {skip} bytes do not fit")
    count, skip = unpack(data, offset)
    start = offset + 8
    offset = start + skip
    if skip != count * 38 or skip < 0 or offset > end:
        raise Malformed("rigid bodies", f"{count} bodies in {skip} bytes do not fit")
    bodies = data[start:offset]
    for name in ("skeletons", "assets", "labeled markers", "force plates", "devices"):
        count, skip = unpack(data, offset)
        offset += 8 + skip
        if count < 0 or skip < 0 or offset > end:
            raise Malformed(name, f"{count} items in {skip} bytes do not fit")
    return _suffix(data, offset, end, number, bodies, 0.0)


def _decode_walked(data: bytes, layout: Layout) -> Frame:
    """Layouts before 4.1, whose sections have no size."""
    message, size, number = struct.unpack_from("<HHi", data)
    if message != _FRAME or size + 4 > len(data):
        raise Malformed("header", f"id {message}, {size} bytes announced, {len(data) - 4} came")
    reader = Reader(data, 8, size + 4)
    for _ in range(reader.count("marker sets", 5)):
        reader.string_end("marker set name")
        reader.block(12, "marker set")
    reader.block(12, "unlabeled markers")
    bodies = _bodies(reader, layout)
    for _ in range(reader.count("skeletons", 8)):
        reader.skip(4, "skeleton id")
        _bodies(reader, layout)
    marker_bytes = 26 if layout.residuals else 22
    reader.block(marker_bytes, "labeled markers")
    if layout.force_plates:
        _channels(reader, "force plates")
    if layout.devices:
        _channels(reader, "devices")
    if layout.ticks:
        return _suffix(data, reader.offset, reader.end, number, bodies, 0.0)
    return _old_suffix(reader, layout, number, bodies)


def _bodies(reader: Reader, layout: Layout) -> bytes:
    """The bodies without the marker lists that they have before 3.0."""
    count = reader.count("rigid bodies", 38)
    start = reader.offset
    if not layout.marker_lists:
        reader.skip(38 * count, "rigid bodies")
        return reader.data[start : reader.offset]
    parts: list[bytes] = []
    for _ in range(count):
        start = reader.offset
        reader.skip(32, "rigid body")
        parts.append(reader.data[start : reader.offset])
        markers = reader.count("rigid body markers", 20)
        reader.skip(20 * markers, "rigid body markers")
        start = reader.offset
        reader.skip(6, "rigid body")
        parts.append(reader.data[start : reader.offset])
    return b"".join(parts)


def _channels(reader: Reader, where: str) -> None:
    for _ in range(reader.count(where, 8)):
        reader.skip(4, where)
        for _ in range(reader.count(where, 4)):
            reader.block(4, where)


def _suffix(data: bytes, offset: int, end: int, number: int, bodies: bytes, latency_s: float) -> Frame:
    """Time and flags from 3.0 on.

    Sources conflict on the version that brought the precision stamp, and some servers leave the end
    tag off, so both are told from the bytes that are left: they can not be confused.
    """
    if offset + 40 > end:
        raise Malformed("suffix", f"{end - offset} bytes left, at least 42 needed")
    _, _, timestamp_s, exposure, received, transmit = _SUFFIX.unpack_from(data, offset)
    offset += 40
    left = end - offset
    precision = (0, 0)
    if left in (14, 10):
        precision = _PRECISION.unpack_from(data, offset)
        offset += 8
    elif left not in (6, 2):
        raise Malformed("suffix", f"{left} bytes after the stamps; 14 or 6 expected")
    params, tag = _END.unpack_from(data, offset) if left in (14, 6) else (_PARAMS.unpack_from(data, offset)[0], 0)
    if tag:
        raise Malformed("end tag", f"{tag}, not 0")
    return Frame(number, bodies, timestamp_s, exposure, received, transmit, precision, params, latency_s)


def _old_suffix(reader: Reader, layout: Layout, number: int, bodies: bytes) -> Frame:
    """Time and flags before 3.0."""
    latency_s = reader.unpack(_FLOAT, "latency")[0]
    reader.skip(_TIMECODE.size, "timecode")
    timestamp_s = reader.unpack(_DOUBLE if layout.wide_timestamp else _FLOAT, "timestamp")[0]
    left = reader.end - reader.offset
    if left not in (2, 6):
        raise Malformed("suffix", f"{left} bytes after the timestamp; 6 expected")
    params = reader.unpack(_PARAMS, "params")[0]
    if left == 6 and (tag := reader.integer("end tag")):
        raise Malformed("end tag", f"{tag}, not 0")
    return Frame(number, bodies, timestamp_s, 0, 0, 0, (0, 0), params, latency_s)  # type: ignore[arg-type]

"""The model list: the only place where rigid bodies have names."""

import struct
from collections.abc import Sequence
from typing import NamedTuple

from mocap_bridge.natnet.version import Layout, Version
from mocap_bridge.natnet.wire import Malformed, MessageId, Packet, Reader, cstring, packet

MARKER_SET, RIGID_BODY, SKELETON, FORCE_PLATE, DEVICE, CAMERA, ASSET = range(7)

_FIXED = struct.Struct("<ii3f")
_ROTATION = struct.Struct("<4f")

Point3 = tuple[float, float, float]


class BodyModel(NamedTuple):
    """One rigid body of the model list."""

    name: str
    id: int
    parent: int = -1
    offset: Point3 = (0.0, 0.0, 0.0)
    markers: tuple[Point3, ...] = ()
    """Marker positions in the body's frame (3.0 on)."""


def encode_models(
    bodies: Sequence[BodyModel], layout: Layout, others: Sequence[tuple[int, bytes]] = (), with_sets: bool = True
) -> bytes:
    """A MODELDEF datagram: a marker set per body, then the bodies, then ``others`` (type, body) as given."""
    items: list[tuple[int, bytes]] = []
    if with_sets:
        items += [(MARKER_SET, _marker_set(body)) for body in bodies]
    items += [(RIGID_BODY, _body(body, layout.version)) for body in bodies]
    items += others
    payload = struct.pack("<i", len(items))
    for kind, data in items:
        payload += struct.pack("<ii", kind, len(data)) if layout.sized else struct.pack("<i", kind)
        payload += data
    return packet(MessageId.MODELDEF, payload)


def _marker_set(body: BodyModel) -> bytes:
    names = b"".join(cstring(f"Marker{k + 1}") for k in range(len(body.markers)))
    return cstring(body.name) + struct.pack("<i", len(body.markers)) + names


def _body(body: BodyModel, version: Version) -> bytes:
    data = cstring(body.name) + _FIXED.pack(body.id, body.parent, *body.offset)
    if version >= (4, 2):
        data += _ROTATION.pack(0.0, 0.0, 0.0, 1.0)
    if version >= (3, 0):
        count = len(body.markers)
        data += struct.pack("<i", count) + b"".join(struct.pack("<3f", *point) for point in body.markers)
        data += struct.pack(f"<{count}i", *([0] * count))
        if version >= (4, 0):
            data += b"".join(cstring(f"Marker{k + 1}") for k in range(count))
    return data


def decode_models(opened: Packet, layout: Layout) -> list[BodyModel]:
    """The rigid bodies of a MODELDEF; other models are skipped.

    Sources conflict on whether the bones of a skeleton carry marker lists (3.0 to 4.0, where no
    size tells): the reading that ends where the payload ends is taken.

    :raises Malformed: sizes and counts that do not fit; no other exception.
    """
    first: Malformed | None = None
    for bone_markers in (False, True):
        reader = Reader(opened.data, 4, opened.end)
        try:
            bodies = _walk(reader, layout, bone_markers)
        except Malformed as fault:
            first = first or fault
            continue
        if reader.end - reader.offset < 4:
            return bodies
    raise first or Malformed("model list", "bytes left after the last model")


def _walk(reader: Reader, layout: Layout, bone_markers: bool) -> list[BodyModel]:
    bodies: list[BodyModel] = []
    for _ in range(reader.count("models", 5)):
        kind = reader.integer("model type")
        if layout.sized:
            start = reader.offset + 4
            reader.skip(reader.count("model size"), "model")
            if kind == RIGID_BODY:
                bodies.append(_read_sized(Reader(reader.data, start, reader.offset), layout.version))
        elif kind == RIGID_BODY:
            bodies.append(_read_body(reader, layout.version))
        else:
            _skip_model(reader, kind, layout.version, bone_markers)
    return bodies


def _read_sized(item: Reader, version: Version) -> BodyModel:
    """A body in an item of its own; markers packed in another way than this version's are left out."""
    start = item.offset
    try:
        return _read_body(item, version)
    except Malformed:
        item.offset = start
        return _read_body(item, version, markers=False)


def _read_body(reader: Reader, version: Version, markers: bool = True) -> BodyModel:
    name = reader.string("body name")
    identity, parent, x, y, z = reader.unpack(_FIXED, "body")
    if version >= (4, 2):
        reader.skip(_ROTATION.size, "body rotation")
    points: tuple[Point3, ...] = ()
    if markers and version >= (3, 0):
        count = reader.count("body markers", 16)
        start = reader.offset
        reader.skip(16 * count, "body markers")
        points = tuple(struct.iter_unpack("<3f", reader.data[start : start + 12 * count]))
        if version >= (4, 0):
            for _ in range(count):
                reader.string_end("marker name")
    return BodyModel(name, identity, parent, (x, y, z), points)  # type: ignore[arg-type]


def _skip_model(reader: Reader, kind: int, version: Version, bone_markers: bool) -> None:
    """Move past a model whose size is not sent (before 4.1). Layouts: SDK 3.1's PacketClient."""
    if kind == MARKER_SET:
        reader.string_end("marker set name")
        _skip_names(reader, "marker names")
    elif kind == SKELETON:
        reader.string_end("skeleton name")
        reader.skip(4, "skeleton id")
        for _ in range(reader.count("bones", 21)):
            _read_body(reader, version, bone_markers)
    elif kind == FORCE_PLATE:
        reader.skip(4, "force plate id")
        reader.string_end("force plate serial")
        reader.skip(4 * (2 + 3 + 144 + 12 + 2), "force plate")
        _skip_names(reader, "force plate channels")
    elif kind == DEVICE:
        reader.skip(4, "device id")
        reader.string_end("device name")
        reader.string_end("device serial")
        reader.skip(8, "device")
        _skip_names(reader, "device channels")
    elif kind == CAMERA:
        reader.string_end("camera name")
        reader.skip(28, "camera")
    else:
        raise Malformed("model type", f"{kind} is not known in NatNet {version}")


def _skip_names(reader: Reader, where: str) -> None:
    for _ in range(reader.count(where)):
        reader.string_end(where)

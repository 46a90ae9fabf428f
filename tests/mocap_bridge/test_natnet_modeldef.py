"""Model lists: round trips, models of every kind skipped, both readings of skeletons, garbage."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocap_bridge.natnet import modeldef, version
from mocap_bridge.natnet.modeldef import BodyModel
from mocap_bridge.natnet.version import Version
from mocap_bridge.natnet.wire import Malformed, MessageId, open_packet, packet

VERSIONS = [Version(*v) for v in ((2, 9), (2, 11), (3, 0), (3, 1), (4, 0), (4, 1), (4, 2), (4, 3))]
ROBOT = BodyModel("r06", 1, -1, (0.0, 0.5, 0.0), ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)))


def bone(with_markers: bool, name: Version) -> bytes:
    data = b"hip\0" + struct.pack("<ii3f", 1, 0, 0.0, 0.0, 0.0)
    if name >= (4, 2):
        data += struct.pack("<4f", 0.0, 0.0, 0.0, 1.0)
    if with_markers and name >= (3, 0):
        data += struct.pack("<i3fi", 1, 0.0, 0.0, 0.0, 0) + (b"m\0" if name >= (4, 0) else b"")
    return data


def others(with_markers: bool, name: Version) -> list[tuple[int, bytes]]:
    skeleton = b"man\0" + struct.pack("<ii", 5, 2) + bone(with_markers, name) * 2
    plate = struct.pack("<i", 1) + b"SN\0" + struct.pack("<161f", *[0.0] * 161) + struct.pack("<iii", 0, 0, 1) + b"Fx\0"
    device = struct.pack("<i", 1) + b"ADC\0SN\0" + struct.pack("<iii", 0, 0, 2) + b"a\0b\0"
    camera = b"Prime\0" + struct.pack("<7f", *[0.0] * 7)
    return [
        (modeldef.SKELETON, skeleton),
        (modeldef.FORCE_PLATE, plate),
        (modeldef.DEVICE, device),
        (modeldef.CAMERA, camera),
    ]


def test_golden_model_list() -> None:
    datagram = modeldef.encode_models([BodyModel("b", 7)], version.layout(Version(4, 1)), with_sets=False)
    body = b"b\0" + bytes.fromhex("07000000 ffffffff 00000000 00000000 00000000 00000000")
    assert datagram == bytes.fromhex("0500 2600 01000000 01000000 1a000000") + body


@pytest.mark.parametrize("bone_markers", [False, True])
@pytest.mark.parametrize("name", VERSIONS)
def test_bodies_are_found_among_all_other_models(name: Version, bone_markers: bool) -> None:
    layout = version.layout(name)
    datagram = modeldef.encode_models([ROBOT, ROBOT._replace(name="r08", id=2)], layout, others(bone_markers, name))
    bodies = modeldef.decode_models(open_packet(datagram), layout)
    assert [(b.name, b.id, b.offset) for b in bodies] == [("r06", 1, (0.0, 0.5, 0.0)), ("r08", 2, (0.0, 0.5, 0.0))]
    assert bodies[0].markers == (ROBOT.markers if name >= (3, 0) else ())


def test_models_of_unknown_type_are_skipped_by_size_and_refused_without() -> None:
    new = version.layout(Version(4, 1))
    datagram = modeldef.encode_models([ROBOT], new, [(17, b"whatever")])
    assert [b.name for b in modeldef.decode_models(open_packet(datagram), new)] == ["r06"]
    old = version.layout(Version(3, 1))
    with pytest.raises(Malformed, match="17 is not known in NatNet 3"):
        modeldef.decode_models(open_packet(modeldef.encode_models([ROBOT], old, [(17, b"whatever")])), old)


names = st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=20)
models = st.lists(
    st.builds(
        BodyModel,
        name=names,
        id=st.integers(-5, 100_000),
        parent=st.integers(-1, 10),
        offset=st.just((0.0, 0.5, 0.0)),
        markers=st.lists(st.just((0.5, 0.25, 0.0)), max_size=4).map(tuple),
    ),
    max_size=5,
)


@given(bodies=models, name=st.sampled_from(VERSIONS))
def test_round_trip(bodies: list[BodyModel], name: Version) -> None:
    layout = version.layout(name)
    decoded = modeldef.decode_models(open_packet(modeldef.encode_models(bodies, layout)), layout)
    assert [(b.name, b.id, b.parent) for b in decoded] == [(b.name, b.id, b.parent) for b in bodies]


@given(
    payload=st.binary(max_size=300),
    flips=st.lists(st.tuples(st.integers(0, 4000), st.integers(0, 255)), max_size=4),
    name=st.sampled_from(VERSIONS),
)
def test_garbage_raises_nothing_but_malformed(payload: bytes, flips: list[tuple[int, int]], name: Version) -> None:
    layout = version.layout(name)
    mangled = bytearray(modeldef.encode_models([ROBOT], layout, others(False, name))[4:])
    for position, value in flips:
        mangled[position % len(mangled)] = value
    for data in (payload, bytes(mangled), bytes(mangled[: len(payload)])):
        try:
            bodies = modeldef.decode_models(open_packet(packet(MessageId.MODELDEF, data)), layout)
        except Malformed:
            continue
        else:
            assert len(bodies) <= len(data)

"""Frames: golden bytes of the layout, round trips at every version, and nothing but Malformed from garbage."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocap_bridge.natnet import version
from mocap_bridge.natnet.frame import Frame, _decode_sized, _decode_usual, decode_frame
from mocap_bridge.natnet.frame_encode import Channels, Content, Marker, encode_frame
from mocap_bridge.natnet.version import Version
from mocap_bridge.natnet.wire import Malformed

VERSIONS = [
    Version(*v) for v in ((2, 6), (2, 7), (2, 9), (2, 10), (2, 11), (3, 0), (3, 1), (4, 0), (4, 1), (4, 2), (4, 3))
]
BODY = (7, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.5, 1)
GOLDEN_BODY = bytes.fromhex("07000000 0000803f 00000040 00004040 00000000 00000000 00000000 0000803f 0000003f 0100")
GOLDEN_31 = (
    bytes.fromhex("0700 7400 2a000000")
    + bytes.fromhex("00000000 00000000 01000000")
    + GOLDEN_BODY
    + bytes.fromhex("00000000 00000000 00000000 00000000")
    + bytes.fromhex("01000000 02000000 000000000000f83f")
    + bytes.fromhex("0a00000000000000 0b00000000000000 0c00000000000000 0200 00000000")
)
GOLDEN_41 = (
    bytes.fromhex("0700 a000 2a000000")
    + bytes.fromhex("00000000 00000000 00000000 00000000 01000000 26000000")
    + GOLDEN_BODY
    + bytes.fromhex("00000000 00000000") * 5
    + bytes.fromhex("01000000 02000000 000000000000f83f")
    + bytes.fromhex("0a00000000000000 0b00000000000000 0c00000000000000 03000000 04000000 0200 00000000")
)
GOLDEN_29 = (
    bytes.fromhex("0700 7400 2a000000 00000000 00000000 01000000")
    + GOLDEN_BODY[:32]
    + bytes.fromhex("01000000 0000803f 0000803f 0000803f 01000000 0000803c")
    + GOLDEN_BODY[32:]
    + bytes.fromhex("00000000 00000000 00000000")
    + bytes.fromhex("0000003e 01000000 02000000 000000000000f83f 0200 00000000")
)
FRAME = Frame(42, GOLDEN_BODY, 1.5, 10, 11, 12, (0, 0), 2, 0.0)


@pytest.mark.parametrize(
    ("golden", "version_of", "expected"),
    [
        (GOLDEN_31, (3, 1), FRAME),
        (GOLDEN_31, (4, 0), FRAME),
        (GOLDEN_41, (4, 1), FRAME._replace(precision=(3, 4))),
        (GOLDEN_41, (4, 3), FRAME._replace(precision=(3, 4))),
        (GOLDEN_29, (2, 9), FRAME._replace(exposure_ticks=0, received_ticks=0, transmit_ticks=0, latency_s=0.125)),
    ],
)
def test_golden_frames_decode(golden: bytes, version_of: tuple[int, int], expected: Frame) -> None:
    frame = decode_frame(golden, version.layout(Version(*version_of)))
    assert frame == expected
    assert frame.bodies == [BODY]


def test_golden_frames_encode() -> None:
    content = Content(
        42,
        bodies=[BODY],
        timecode=(1, 2),
        timestamp_s=1.5,
        exposure_ticks=10,
        received_ticks=11,
        transmit_ticks=12,
        precision=(3, 4),
        params=2,
        latency_s=0.125,
    )
    assert encode_frame(content, version.layout(Version(3, 1))) == GOLDEN_31
    assert encode_frame(content, version.layout(Version(4, 1))) == GOLDEN_41


@pytest.mark.parametrize(("name", "fixed"), [((3, 1), 82), ((4, 1), 126)])
@pytest.mark.parametrize("count", [0, 1, 35])
def test_size_without_markers(name: tuple[int, int], fixed: int, count: int) -> None:
    assert len(encode_frame(Content(1, bodies=[BODY] * count), version.layout(Version(*name)))) == fixed + 38 * count


def test_end_tag_and_late_precision_stamp_are_optional() -> None:
    without_tag = GOLDEN_41[:2] + struct.pack("<H", 0xA0 - 4) + GOLDEN_41[4:-4]
    assert decode_frame(without_tag, version.layout(Version(4, 1))).precision == (3, 4)
    stamp = GOLDEN_31[:2] + struct.pack("<H", 0x74 + 8) + GOLDEN_31[4:-6] + b"\1\0\0\0\2\0\0\0" + GOLDEN_31[-6:]
    assert decode_frame(stamp, version.layout(Version(4, 0))).precision == (1, 2)


real = st.floats(-100.0, 100.0, width=32)
point = st.tuples(real, real, real)
body = st.tuples(
    st.integers(0, 1000), real, real, real, real, real, real, real, st.floats(0.0, 1.0, width=32), st.integers(0, 3)
)
marker = st.builds(Marker, st.integers(0, 1 << 30), point, st.just(0.0), st.integers(0, 63), st.just(0.0))
channels = st.builds(
    Channels, st.integers(0, 9), st.lists(st.lists(real, max_size=3).map(tuple), max_size=3).map(tuple)
)
few = {"max_size": 3}
contents = st.builds(
    Content,
    number=st.integers(0, (1 << 31) - 1),
    bodies=st.lists(body, **few),
    body_markers=st.dictionaries(st.integers(0, 1000), st.lists(point, max_size=4), max_size=3),
    marker_sets=st.lists(st.tuples(st.text(max_size=8).filter(lambda t: "\0" not in t), st.lists(point, **few)), **few),
    unlabeled=st.lists(point, **few),
    skeletons=st.lists(st.tuples(st.integers(0, 9), st.lists(body, **few)), **few),
    assets=st.lists(st.tuples(st.integers(0, 9), st.lists(body, **few), st.lists(marker, **few)), **few),
    labeled=st.lists(marker, **few),
    force_plates=st.lists(channels, **few),
    devices=st.lists(channels, **few),
    timecode=st.just((1, 2)),
    timestamp_s=st.floats(0.0, 1e6, width=32),
    exposure_ticks=st.integers(0, (1 << 64) - 1),
    received_ticks=st.integers(0, (1 << 64) - 1),
    transmit_ticks=st.integers(0, (1 << 64) - 1),
    precision=st.tuples(st.integers(0, (1 << 32) - 1), st.integers(0, (1 << 32) - 1)),
    params=st.integers(0, 15),
    latency_s=st.floats(0.0, 1.0, width=32),
)


@given(content=contents, name=st.sampled_from(VERSIONS))
def test_round_trip_at_every_version(content: Content, name: Version) -> None:
    layout = version.layout(name)
    frame = decode_frame(encode_frame(content, layout), layout)
    assert frame.bodies == list(content.bodies)
    assert (frame.number, frame.params, frame.timestamp_s) == (content.number, content.params, content.timestamp_s)
    if layout.ticks:
        assert (frame.exposure_ticks, frame.transmit_ticks) == (content.exposure_ticks, content.transmit_ticks)
    else:
        assert frame.latency_s == content.latency_s
    assert frame.precision == (content.precision if layout.sized else (0, 0))


@given(content=contents, empty=st.booleans(), flips=st.lists(st.tuples(st.integers(0, 999), st.integers(0, 255))))
def test_the_quick_way_and_the_general_one_agree(content: Content, empty: bool, flips: list[tuple[int, int]]) -> None:
    if empty:
        content = content._replace(unlabeled=(), skeletons=(), assets=(), force_plates=(), devices=())
    data = bytearray(encode_frame(content, version.layout(Version(4, 1))))
    assert not empty or _decode_usual(bytes(data)) is not None
    for position, value in flips[:2]:
        data[position % len(data)] = value
    try:
        quick = _decode_usual(bytes(data))
    except struct.error:
        return
    if quick is not None:
        general = _decode_sized(bytes(data))
        assert repr(quick) == repr(general), "repr, since a NaN is not equal to itself"


RICH = Content(
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


@pytest.mark.parametrize("name", VERSIONS)
def test_every_truncation_is_malformed(name: Version) -> None:
    layout = version.layout(name)
    datagram = encode_frame(RICH, layout)
    for size in range(len(datagram)):
        with pytest.raises(Malformed):
            decode_frame(datagram[:size], layout)
        shortened = datagram[:2] + struct.pack("<H", max(size - 4, 0)) + datagram[4:size]
        try:
            decode_frame(shortened, layout)
        except Malformed:
            continue
        assert len(datagram) - size in (4, 8, 12), "only the end tag and the precision stamp may be missing"


@pytest.mark.parametrize("name", VERSIONS)
def test_absurd_counts_are_malformed(name: Version) -> None:
    layout = version.layout(name)
    datagram = encode_frame(Content(1), layout)
    step = 8 if layout.sized else 4
    for offset in range(8, len(datagram) - 60, step):
        for count in (-1, 1 << 30, (1 << 31) - 1):
            mangled = datagram[:offset] + struct.pack("<i", count) + datagram[offset + 4 :]
            try:
                assert decode_frame(mangled, layout).bodies == []
            except Malformed:
                continue


@given(data=st.binary(max_size=400), name=st.sampled_from(VERSIONS))
def test_noise_raises_nothing_but_malformed(data: bytes, name: Version) -> None:
    datagram = struct.pack("<HH", 7, len(data)) + data
    for candidate in (data, datagram):
        try:
            decode_frame(candidate, version.layout(name))
        except Malformed:
            continue


@given(
    flips=st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), min_size=1, max_size=4),
    name=st.sampled_from(VERSIONS),
)
def test_mangled_frames_raise_nothing_but_malformed(flips: list[tuple[int, int]], name: Version) -> None:
    layout = version.layout(name)
    datagram = bytearray(encode_frame(RICH, layout))
    for position, value in flips:
        datagram[position % len(datagram)] = value
    try:
        frame = decode_frame(bytes(datagram), layout)
    except Malformed:
        return
    assert len(frame.bodies) * 38 <= len(datagram)


def test_versions_without_a_layout_are_named() -> None:
    for seen in ((2, 5), (4, 4), (5, 0)):
        with pytest.raises(version.UnsupportedVersion, match=rf"{seen[0]}\.{seen[1]} is not supported"):
            version.layout(Version(*seen))
    with pytest.raises(version.UnsupportedVersion, match="four"):
        version.parse("four")

"""LAWICEL text from both ends (LAWICEL CANUSB manual v1.0D): reader and hub share no parser."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can.frame import CanFrame
from drivers.can.slcan_text import SlcanReader, encode, parse
from drivers.mock.slcan import Hub


@st.composite
def frames(draw: st.DrawFn) -> CanFrame:
    extended, remote = draw(st.booleans()), draw(st.booleans())
    can_id = draw(st.integers(0, 2**29 - 1 if extended else 2**11 - 1))
    if remote:
        return CanFrame(can_id, b"", extended, True, draw(st.integers(0, 8)))
    return CanFrame(can_id, draw(st.binary(max_size=8)), extended)


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (CanFrame(0x10, b"\x11\x33"), b"t01021133\r"),
        (CanFrame(0x100, b"\x11\x33", extended=True), b"T0000010021133\r"),
        (CanFrame(0x7FF, remote=True, dlc=8), b"r7FF8\r"),
        (CanFrame(0x1FFFFFFF, extended=True, remote=True, dlc=0), b"R1FFFFFFF0\r"),
    ],
)
def test_golden_lines(frame: CanFrame, text: bytes) -> None:
    assert encode(frame) == text
    assert parse(text[:-1]) == frame


@given(st.lists(frames(), max_size=8), st.lists(st.integers(0, 200), max_size=5))
def test_frames_survive_the_hub_in_any_chunks(sent: list[CanFrame], cuts: list[int]) -> None:
    hub = Hub()
    first, second = hub.add_port(), hub.add_port()
    for port in (first, second):
        hub.receive(port, b"\rC\rS5\r\rO\rO\r", 0)
    second.output.clear()
    data = b"".join(map(encode, sent))
    bounds = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    for a, b in pairwise(bounds):
        hub.receive(first, data[a:b], 0)
    reader = SlcanReader()
    received = [frame for byte in bytes(second.output) for frame in reader.feed(bytes((byte,)))]
    assert received == sent
    assert SlcanReader().feed(bytes(second.output)) == sent
    assert not reader.counters
    assert not hub.counters


def test_pitfall_blank_lines_and_a_double_open_are_survived() -> None:
    hub = Hub()
    port = hub.add_port()
    hub.receive(port, b"\r\rS5\rO\rO\r", 0)
    assert port.open
    assert bytes(port.output) == b"\r\r\r\r\a"
    reader = SlcanReader()
    assert reader.feed(bytes(port.output)) == []
    assert not reader.counters, "refusals before the first frame belong to the handshake"


def test_pitfall_an_acknowledgement_is_not_a_frame_and_hides_none() -> None:
    reader = SlcanReader()
    assert reader.feed(b"z\rz\rt0011AA\rZ\rt0021BB\r") == [CanFrame(1, b"\xaa"), CanFrame(2, b"\xbb")]


def test_a_refusal_after_the_handshake_is_counted() -> None:
    reader = SlcanReader()
    assert reader.feed(b"z\r\at0011AA\r") == [CanFrame(1, b"\xaa")]
    assert reader.counters == {"slcan_refused": 1}


@given(st.binary(max_size=200))
def test_any_bytes_are_survived_by_both_ends(data: bytes) -> None:
    for frame in SlcanReader().feed(data):
        assert encode(frame).upper() in data.upper()
    hub = Hub()
    hub.receive(hub.add_port(), data, 0)


@pytest.mark.parametrize(
    "line", [b"t80021122", b"t0019", b"t001211", b"t00121122FF", b"x", b"t0g12", b"T000001", b"r0011FF"]
)
def test_malformed_lines_are_refused_by_both_ends(line: bytes) -> None:
    reader, hub = SlcanReader(), Hub()
    assert reader.feed(line + b"\r") == []
    assert reader.counters == {"slcan_garbage": 1}
    port, other = hub.add_port(), hub.add_port()
    hub.receive(port, b"O\r" + line + b"\r", 0)
    hub.receive(other, b"O\r", 0)
    assert bytes(port.output).endswith(b"\a")
    assert sum(hub.counters.values()) == 1


def test_a_line_without_end_is_dropped_at_both_ends() -> None:
    reader, hub = SlcanReader(), Hub()
    reader.feed(b"t" * 1000)
    assert reader.counters["slcan_garbage"] >= 1
    hub.receive(hub.add_port(), b"t" * 1000, 0)
    assert hub.counters["garbage_line"] >= 1


@given(frame=frames(), position=st.integers(0, 40))
def test_one_flipped_high_bit_is_refused(frame: CanFrame, position: int) -> None:
    text = bytearray(encode(frame))
    text[position % len(text)] ^= 0x80
    hub = Hub()
    port = hub.add_port()
    hub.receive(port, b"O\r" + bytes(text) + b"\r", 0)
    assert sum(hub.counters.values()) == 1


def test_a_port_at_another_bit_rate_hears_and_says_nothing() -> None:
    hub = Hub(bitrate=250_000)
    wrong, right = hub.add_port(), hub.add_port()
    hub.receive(wrong, b"S6\rO\r", 0)
    hub.receive(right, b"S5\rO\r", 0)
    wrong.output.clear(), right.output.clear()
    hub.receive(wrong, b"t0010\r", 0)
    hub.receive(right, b"t0010\r", 0)
    assert bytes(wrong.output) == b"\a"
    assert bytes(right.output) == b"z\r"
    assert hub.counters == {"wrong_bitrate": 1}


def test_bus_off_carries_nothing() -> None:
    hub = Hub()
    first, second = hub.add_port(), hub.add_port()
    for port in (first, second):
        hub.receive(port, b"O\r", 0)
    second.output.clear()
    hub.bus_off = True
    hub.receive(first, b"t0010\rF\r", 0)
    assert not second.output
    assert bytes(first.output).endswith(b"F80\r")
    assert hub.counters == {"bus_off_frame": 1}

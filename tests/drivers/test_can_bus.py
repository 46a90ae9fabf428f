"""The generic python-can port, on python-can's in-process ``virtual`` bus."""

from collections.abc import Iterator

import can
import pytest

from drivers.base import LinkLost
from drivers.can.bus import BusPort, SlcanPort, can_port
from drivers.can.frame import CanFrame
from drivers.can.line import CanLine


@pytest.fixture
def pair(request: pytest.FixtureRequest) -> Iterator[tuple[BusPort, can.BusABC]]:
    port = BusPort("virtual", request.node.name)
    port.open()
    with can.Bus(interface="virtual", channel=request.node.name) as peer:
        yield port, peer
    port.close()
    port.close()


def test_the_interface_names_choose_the_port() -> None:
    assert isinstance(can_port("slcan", "/dev/x", 250_000), SlcanPort)
    assert isinstance(can_port("socketcan", "can0", 250_000), BusPort)


@pytest.mark.parametrize(
    "frame", [CanFrame(0x123, b"\x01\x02"), CanFrame(0x1ABCDEF, bytes(8), True), CanFrame(0x7FF, b"", False, True, 8)]
)
def test_frames_go_out_and_come_back_unchanged(pair: tuple[BusPort, can.BusABC], frame: CanFrame) -> None:
    port, peer = pair
    assert port.send([frame, frame])
    for _ in range(2):
        message = peer.recv(1.0)
        assert message is not None
        assert message.arbitration_id == frame.can_id
        assert message.is_extended_id == frame.extended
        assert message.is_remote_frame == frame.remote
        assert message.dlc == frame.length
        peer.send(message)
    port.wait(0.01)
    assert port.receive() == [frame, frame]
    assert port.receive() == []


def test_pitfall_error_frames_reach_recv_and_are_counted_not_parsed(pair: tuple[BusPort, can.BusABC]) -> None:
    port, peer = pair
    peer.send(can.Message(arbitration_id=0x4, is_error_frame=True, is_extended_id=False, dlc=8))
    peer.send(can.Message(arbitration_id=0x5, is_extended_id=False))
    assert port.receive() == [CanFrame(0x5)]
    assert port.take_counters() == {"error_frame": 1}
    assert port.take_counters() == {}


def test_bus_off_is_a_lost_link(pair: tuple[BusPort, can.BusABC]) -> None:
    port, peer = pair
    peer.send(can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False, dlc=8))
    with pytest.raises(OSError, match="bus-off"):
        port.receive()


@pytest.mark.parametrize(("code", "text"), [(105, "No buffer space available"), (None, "Transmit buffer full")])
def test_pitfall_a_full_queue_drops_the_setpoint(pair: tuple[BusPort, can.BusABC], code: int | None, text: str) -> None:
    port, _ = pair

    def full(message: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError(text, code)

    assert port._bus is not None
    port._bus.send = full  # type: ignore[method-assign]
    assert port.send([CanFrame(1)]) is False


def test_other_send_errors_and_closed_ports_are_lost_links(pair: tuple[BusPort, can.BusABC]) -> None:
    port, _ = pair

    def down(message: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("Network is down", 100)

    assert port._bus is not None
    port._bus.send = down  # type: ignore[method-assign]
    with pytest.raises(OSError, match="Network is down"):
        port.send([CanFrame(1)])
    port.close()
    for act in (port.receive, lambda: port.send([])):
        with pytest.raises(OSError, match="closed"):
            act()
    with pytest.raises(OSError, match=r".+"):
        BusPort("socketcan", "nosuchcan9").open()


@pytest.mark.parametrize(
    ("code", "remedy"),
    [(100, "ip link set can0 up"), (19, "Plug the adapter in"), (104, "termination"), (5, "Check cable")],
)
def test_the_remedy_fits_the_error(code: int, remedy: str) -> None:
    port = BusPort("socketcan", "can0")

    def fail() -> list[CanFrame]:
        raise OSError(code, "the reason")

    port.receive = fail  # type: ignore[method-assign]
    with pytest.raises(LinkLost, match=r"Thing on can0: cannot receive: the reason\.") as caught:
        CanLine("Thing", port, lambda frame: "").drain()
    assert remedy in caught.value.remedy


@pytest.mark.parametrize(
    ("bits", "counter"), [(0x02, "error_overflow"), (0x08, "error_warning"), (0x10, "error_passive")]
)
def test_states_of_the_can_controller_are_counted_by_name(
    pair: tuple[BusPort, can.BusABC], bits: int, counter: str
) -> None:
    port, peer = pair
    data = bytes([0, bits, 0, 0, 0, 0, 0, 0])
    peer.send(can.Message(arbitration_id=0x4, is_error_frame=True, is_extended_id=False, data=data, dlc=8))
    assert port.receive() == []
    assert port.take_counters() == {"error_frame": 1, counter: 1}

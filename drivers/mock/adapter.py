"""A CAN device behind an slcan adapter, as one emulated controller."""

from collections import Counter
from typing import Protocol

from contract.messages import MotorSample
from drivers.can.frame import CanFrame
from drivers.mock.controller import SampleLog, Wheels
from drivers.mock.slcan import Hub


class CanDevice(Protocol):
    """An emulated device on a bus."""

    wheels: Wheels
    counters: Counter[str]
    log: SampleLog
    hung: bool

    def take_frame(self, frame: CanFrame, now_ns: int) -> list[CanFrame]: ...

    def advance(self, now_ns: int) -> list[CanFrame]: ...

    def next_due_ns(self) -> int | None: ...

    def set_sensor_sign(self, sign: float) -> None: ...

    def brown_out(self, on: bool) -> None: ...


class OnSlcan:
    """:class:`drivers.mock.controller.EmulatedController`: adapter, bus and device."""

    def __init__(self, device: CanDevice, bitrate: int | None) -> None:
        self.device = device
        self.hub = Hub(bitrate)
        self.wheels = device.wheels
        self._port = self.hub.add_port()
        self._now_ns = -1
        """The device is so far."""
        self.hub.nodes.append(device)

    @property
    def counters(self) -> Counter[str]:
        return self.device.counters + self.hub.counters

    @property
    def hung(self) -> bool:
        return self.device.hung

    @hung.setter
    def hung(self, value: bool) -> None:
        self.device.hung = value

    @property
    def bus_off(self) -> bool:
        return self.hub.bus_off

    @bus_off.setter
    def bus_off(self, value: bool) -> None:
        self.hub.bus_off = value

    def receive(self, data: bytes, now_ns: int) -> bytes:
        if data or now_ns != self._now_ns:
            self._pass(now_ns)
            self.hub.receive(self._port, data, now_ns)
        return self._take()

    def advance(self, now_ns: int) -> bytes:
        self._pass(now_ns)
        return self._take()

    def next_due_ns(self) -> int | None:
        return self.device.next_due_ns()

    def take_samples(self) -> list[MotorSample]:
        return self.device.log.take()

    def set_sensor_sign(self, sign: float) -> None:
        self.device.set_sensor_sign(sign)

    def brown_out(self, on: bool) -> None:
        self.device.brown_out(on)

    def _pass(self, now_ns: int) -> None:
        self._now_ns = now_ns
        if frames := self.device.advance(now_ns):
            self.hub.broadcast(frames, now_ns)

    def _take(self) -> bytes:
        if not self._port.output:
            return b""
        taken = bytes(self._port.output)
        self._port.output.clear()
        return taken

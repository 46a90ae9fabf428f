"""A device's line, whatever it is made of: port errors become typed ones, lost writes are counted."""

import errno
from collections import Counter
from typing import Generic, TypeVar

from drivers.base import ControllerFault, LinkLost, Refused
from drivers.ports import Port

REMEDY = "Check power, cable, bit rate and id, then configure again"
GONE = "Plug the adapter in, then: ip link set {port} up type can bitrate <bit/s>, and configure again"
HELD = "Another program holds it: end it (fuser -v {port} names it), then configure again"
FULL = "Check wiring and termination: nothing takes the frames. Kernel interface: ip link set {port} txqueuelen 100"
REMEDIES = {
    errno.EACCES: "Join the port's group (sudo usermod -aG dialout $USER), log in again, then configure again",
    errno.EPERM: "Join the port's group (sudo usermod -aG dialout $USER), log in again, then configure again",
    errno.ENOENT: "Plug the adapter in, compare its name with ls -l /dev/serial/by-id, then configure again",
    errno.EIO: "Check cable, power and adapter, then configure again",
    errno.EAGAIN: HELD,
    errno.EBUSY: HELD,
    errno.ENETDOWN: "Bring the interface up: ip link set {port} up type can bitrate <bit/s>, then configure again",
    errno.ENODEV: GONE,
    errno.ENXIO: GONE,
    errno.ECONNRESET: "Check bitrate, wiring and termination, then: ip link set {port} down, up, and configure again",
}
"""By the errno of the port."""
MAX_DROPPED = 10
"""Writes in a row without room: a setpoint every 10 ms would not have left for 100 ms."""

PortT = TypeVar("PortT", bound=Port)


class DeviceLine(Generic[PortT]):
    """One device's view of its port."""

    def __init__(self, device: str, port: PortT) -> None:
        self.device = device
        self.port = port
        self.counters: Counter[str] = Counter()
        self.dropped_in_a_row = 0

    def open_port(self) -> None:
        """:raises LinkLost: with the reason."""
        self.dropped_in_a_row = 0
        try:
            self.port.open()
        except OSError as error:
            raise self.dead("open", error) from error

    def total(self) -> Counter[str]:
        """All counters, the port's included."""
        self.counters.update(self.port.take_counters())
        return self.counters

    def lost(self, fault: str, remedy: str = REMEDY) -> LinkLost:
        return LinkLost(self.device, self.port.name, fault, remedy)

    def refused(self, fault: str, remedy: str) -> Refused:
        return Refused(self.device, self.port.name, fault, remedy)

    def faulty(self, fault: str, remedy: str) -> ControllerFault:
        return ControllerFault(self.device, self.port.name, fault, remedy)

    def dead(self, verb: str, error: OSError) -> LinkLost:
        """What an error of the port means."""
        remedy = REMEDIES.get(error.errno or 0, REMEDY)
        return self.lost(f"cannot {verb}: {error.strerror or error}", remedy.format(port=self.port.name))

    def note(self, sent: bool) -> None:
        """Count a write that found no room.

        :raises LinkLost: ``MAX_DROPPED`` in a row did.
        """
        if sent:
            self.dropped_in_a_row = 0
            return
        self.counters["send_dropped"] += 1
        self.dropped_in_a_row += 1
        if self.dropped_in_a_row >= MAX_DROPPED:
            self.dropped_in_a_row = 0
            raise self.lost(f"no room for {MAX_DROPPED} writes in a row (ENOBUFS)", FULL.format(port=self.port.name))

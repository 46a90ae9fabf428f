"""CAN buses through python-can: slcan adapters with whole-chunk reads and writes, and any other interface.

python-can's stock slcan reads byte by byte, drains the line after every frame and returns None
from ``recv(0)`` on an acknowledgement; :class:`SlcanBus` keeps its set-up and replaces the data path.
"""

import contextlib
import errno
import os
import select
import termios
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

import can
from can.interfaces.slcan import slcanBus

from drivers.can.frame import CanFrame
from drivers.can.slcan_text import ASK_STATUS, SlcanReader, encode
from drivers.ports import CHUNK_BYTES, FramePort

ERROR_BUS_OFF = 0x40
"""CAN_ERR_BUSOFF of linux/can/error.h, in the identifier of an error frame."""
ERROR_CONTROLLER = 0x04
"""CAN_ERR_CRTL: byte 1 has the bits below."""
CONTROLLER_STATES = {"error_overflow": 0x03, "error_warning": 0x0C, "error_passive": 0x30}


def can_port(interface: str, channel: str, bitrate: int) -> FramePort:
    """A closed port for a python-can interface name."""
    if interface == "slcan":
        return SlcanPort(channel, bitrate)
    return BusPort(interface, channel)


class SlcanBus(slcanBus):
    """python-can's slcan with non-blocking chunked reads and writes."""

    def raw_read(self) -> bytes:
        """Whatever the adapter sent.

        :raises OSError: it is gone.
        """
        try:
            data = os.read(self.serialPortOrig.fd, CHUNK_BYTES)
        except BlockingIOError:
            return b""
        if not data:
            raise OSError("the adapter hung up")
        return data

    def raw_write(self, data: bytes) -> int:
        try:
            return os.write(self.serialPortOrig.fd, data)
        except BlockingIOError:
            return 0

    def abandon(self) -> None:
        """Close channel and port. ``shutdown`` would wait for an adapter that no longer drains."""
        with contextlib.suppress(OSError):
            self.raw_write(b"C\r")
        can.BusABC.shutdown(self)
        with contextlib.suppress(OSError, termios.error):
            termios.tcflush(self.serialPortOrig.fd, termios.TCIFLUSH)
            self.serialPortOrig.close()


class _CanPortBase:
    """What both kinds share: name, clock, waiting, counters."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._counters: Counter[str] = Counter()

    def fileno(self) -> int | None:
        raise NotImplementedError

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def wait(self, timeout_s: float) -> None:
        fd = self.fileno()
        if fd is not None:
            select.select([fd], [], [], timeout_s)

    def take_counters(self) -> dict[str, int]:
        taken = dict(self._counters)
        self._counters.clear()
        return taken


class SlcanPort(_CanPortBase):
    """An slcan adapter on a tty."""

    def __init__(self, channel: str, bitrate: int) -> None:
        super().__init__(channel)
        self._bitrate = bitrate
        self._bus: SlcanBus | None = None
        self._reader = SlcanReader()

    def open(self) -> None:
        self.close()
        try:
            bus = SlcanBus(self.name, bitrate=self._bitrate, sleep_after_open=0, timeout=0)
        except (can.CanError, ValueError) as error:
            raise OSError(str(error)) from error
        try:
            bus.serialPortOrig.exclusive = True
            attributes = termios.tcgetattr(bus.serialPortOrig.fd)
            attributes[6][termios.VMIN] = 1
            termios.tcsetattr(bus.serialPortOrig.fd, termios.TCSANOW, attributes)
        except (OSError, termios.error) as error:
            bus.abandon()
            raise OSError(f"busy or not a tty: {error}") from error
        self._bus = bus
        self._reader = SlcanReader()

    def close(self) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.abandon()

    def fileno(self) -> int | None:
        return None if self._bus is None else self._bus.serialPortOrig.fd

    def send(self, frames: Sequence[CanFrame]) -> bool:
        if self._bus is None:
            raise OSError("the port is closed")
        data = b"".join([encode(frame) for frame in frames])
        return self._bus.raw_write(data) == len(data)

    def receive(self) -> list[CanFrame]:
        if self._bus is None:
            raise OSError("the port is closed")
        data = self._bus.raw_read()
        return self._reader.feed(data) if data else []

    def inquire(self) -> str:
        if self._bus is not None:
            with contextlib.suppress(OSError):
                self._bus.raw_write(ASK_STATUS)
        return self._reader.status

    def take_counters(self) -> dict[str, int]:
        self._counters.update(self._reader.counters)
        self._reader.counters.clear()
        return super().take_counters()


class BusPort(_CanPortBase):
    """Any python-can interface with a file descriptor, SocketCAN above all."""

    def __init__(self, interface: str, channel: str, **settings: Any) -> None:
        super().__init__(channel)
        self._interface = interface
        self._settings = settings
        self._bus: can.BusABC | None = None

    def open(self) -> None:
        self.close()
        try:
            self._bus = can.Bus(interface=self._interface, channel=self.name, **self._settings)
        except (can.CanError, ValueError) as error:
            raise OSError(str(error)) from error

    def close(self) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            with contextlib.suppress(can.CanError, OSError):
                bus.shutdown()

    def fileno(self) -> int | None:
        if self._bus is None:
            return None
        try:
            return self._bus.fileno()
        except NotImplementedError:
            return None

    def wait(self, timeout_s: float) -> None:
        if self.fileno() is None:
            time.sleep(min(timeout_s, 0.002))
        else:
            super().wait(timeout_s)

    def send(self, frames: Sequence[CanFrame]) -> bool:
        if self._bus is None:
            raise OSError("the port is closed")
        for frame in frames:
            message = can.Message(
                arbitration_id=frame.can_id,
                data=frame.data,
                dlc=frame.length,
                is_extended_id=frame.extended,
                is_remote_frame=frame.remote,
            )
            try:
                self._bus.send(message, timeout=0)
            except can.CanOperationError as error:
                if error.error_code in (11, 105) or "buffer" in str(error).lower():
                    return False
                raise _os_error(error) from error
        return True

    def receive(self) -> list[CanFrame]:
        if self._bus is None:
            raise OSError("the port is closed")
        frames = []
        try:
            while (message := self._bus.recv(0)) is not None:
                if message.is_error_frame:
                    self._count_error(message)
                    continue
                remote = message.is_remote_frame
                frames.append(
                    CanFrame(
                        message.arbitration_id,
                        b"" if remote else bytes(message.data),
                        message.is_extended_id,
                        remote,
                        message.dlc if remote else None,
                    )
                )
        except can.CanError as error:
            raise _os_error(error) from error
        return frames

    def inquire(self) -> str:
        """The kernel tells by error frames, which :meth:`receive` raises."""
        return ""

    def _count_error(self, message: can.Message) -> None:
        """:raises OSError: the controller has left the bus."""
        self._counters["error_frame"] += 1
        if message.arbitration_id & ERROR_BUS_OFF:
            raise OSError(
                errno.ECONNRESET, "bus-off: the computer's CAN controller has left the bus after too many errors"
            )
        if message.arbitration_id & ERROR_CONTROLLER and len(message.data) > 1:
            for name, bits in CONTROLLER_STATES.items():
                if message.data[1] & bits:
                    self._counters[name] += 1


def _os_error(error: can.CanError) -> OSError:
    """The same with its errno, where python-can tells it."""
    return OSError(str(error)) if error.error_code is None else OSError(error.error_code, str(error))

"""A serial line opened by pyserial, then read and written in whole chunks without waiting."""

import contextlib
import os
import select
import termios
import time

import serial

from drivers.ports import CHUNK_BYTES


class SerialPort:
    """:class:`drivers.ports.BytePort` on a tty (USB adapter, UART or pty)."""

    def __init__(self, path: str, baud: int) -> None:
        self.name = path
        self._baud = baud
        self._line: serial.Serial | None = None
        self._fd = -1

    def open(self) -> None:
        self.close()
        try:
            line = serial.Serial(self.name, self._baud, timeout=0, write_timeout=0, exclusive=True)
        except (serial.SerialException, ValueError) as error:
            number = getattr(error, "errno", None)
            raise (OSError(str(error)) if number is None else OSError(number, str(error.args[-1]))) from error
        try:
            attributes = termios.tcgetattr(line.fd)
            attributes[6][termios.VMIN] = 1
            termios.tcsetattr(line.fd, termios.TCSANOW, attributes)
            line.reset_input_buffer()
            with contextlib.suppress(ValueError, OSError, NotImplementedError):
                line.set_low_latency_mode(True)
        except (OSError, termios.error) as error:
            line.close()
            raise OSError(str(error)) from error
        self._line, self._fd = line, line.fd

    def close(self) -> None:
        line, self._line, self._fd = self._line, None, -1
        if line is not None:
            with contextlib.suppress(OSError, termios.error):
                line.close()

    def fileno(self) -> int | None:
        return None if self._fd < 0 else self._fd

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def wait(self, timeout_s: float) -> None:
        if self._fd >= 0:
            select.select([self._fd], [], [], timeout_s)

    def send(self, data: bytes) -> bool:
        try:
            return os.write(self._fd, data) == len(data)
        except BlockingIOError:
            return False
        except OSError:
            if self._fd < 0:
                raise OSError("the port is closed") from None
            raise

    def receive(self) -> bytes:
        if self._fd < 0:
            raise OSError("the port is closed")
        try:
            data = os.read(self._fd, CHUNK_BYTES)
        except BlockingIOError:
            return b""
        if not data:
            raise OSError("the device hung up")
        return data

    def take_counters(self) -> dict[str, int]:
        return {}

"""What a driver needs from its port; real ports, ptys and in-memory wires all look like this.

A port's clock is part of it: a driver that must wait (``configure``, ``activate``) waits on the
port, so the same driver runs in virtual time.
"""

from collections.abc import Sequence
from typing import Protocol

from drivers.can.frame import CanFrame

CHUNK_BYTES = 4096
"""Read at once; a tty hands out no more."""


class Port(Protocol):
    """Life of a port."""

    name: str

    def open(self) -> None:
        """:raises OSError: with the reason."""

    def close(self) -> None: ...

    def fileno(self) -> int | None: ...

    def now_ns(self) -> int: ...

    def wait(self, timeout_s: float) -> None:
        """Until something can be received, at most ``timeout_s``."""

    def take_counters(self) -> dict[str, int]:
        """Bytes and frames refused since the last call, by name."""


class BytePort(Port, Protocol):
    """A serial line."""

    def send(self, data: bytes) -> bool:
        """All bytes in one write without waiting; False if the line had no room.

        :raises OSError: the port is gone.
        """

    def receive(self) -> bytes:
        """Everything there is, possibly nothing.

        :raises OSError: the port is gone.
        """


class FramePort(Port, Protocol):
    """A CAN bus."""

    def send(self, frames: Sequence[CanFrame]) -> bool:
        """All frames in one write where the adapter can, without waiting; False if there was no room.

        :raises OSError: the bus is gone.
        """

    def inquire(self) -> str:
        """Ask the adapter how its bus is, without waiting; its last answer in words, '' for well or unknown."""

    def receive(self) -> list[CanFrame]:
        """Every frame received, possibly none.

        :raises OSError: the bus is gone.
        """

"""A classic CAN frame, as drivers, emulators and the slcan hub pass it around."""

from typing import NamedTuple


class CanFrame(NamedTuple):
    """Identifier, payload of at most 8 bytes, and the two flags of the arbitration field."""

    can_id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    dlc: int | None = None
    """Requested length of a remote frame; otherwise the payload's own."""

    @property
    def length(self) -> int:
        return len(self.data) if self.dlc is None else self.dlc

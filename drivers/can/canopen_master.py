"""NMT and SDO by the ``canopen`` library over a :class:`CanLine`, without threads and in the port's own time."""

import canopen
from canopen.nmt import NmtMaster
from canopen.objectdictionary import ObjectDictionary
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from drivers.base import LinkLost, Refused
from drivers.can.cia402_codec import SDO_REPLY, SDO_REQUEST, Write
from drivers.can.frame import CanFrame
from drivers.can.line import CanLine

REPLY_S = 0.25


class LineNetwork(canopen.Network):
    """The library's network on a driver's line; frames come in through ``notify``."""

    def __init__(self, line: CanLine) -> None:
        super().__init__()
        self.line = line

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self.line.send([CanFrame(can_id, bytes(data), remote=remote)])


class LineSdo(SdoClient):
    """The library's client, waiting on the line instead of a queue filled by a thread."""

    RESPONSE_TIMEOUT = 0.0

    def __init__(self, network: LineNetwork, node: int) -> None:
        super().__init__(SDO_REQUEST + node, SDO_REPLY + node, ObjectDictionary())  # type: ignore[no-untyped-call]
        self.network = network
        self._line = network.line
        network.subscribe(SDO_REPLY + node, self.on_response)

    def read_response(self) -> bytes:
        self._line.wait_until(lambda: not self.responses.empty(), REPLY_S)
        response: bytes = super().read_response()  # type: ignore[no-untyped-call]
        return response


class Slave:
    """One device as its master sees it during configuration."""

    def __init__(self, network: LineNetwork, node: int, name: str) -> None:
        self.node = node
        self.name = f"{name} (node {node})"
        self._line = network.line
        self._sdo = LineSdo(network, node)
        self._nmt = NmtMaster(node)
        self._nmt.network = network

    def order(self, state: str) -> None:
        """NMT command by the library's name of the state."""
        self._nmt.state = state

    def read(self, index: int, subindex: int = 0) -> int:
        """
        :raises LinkLost: no answer.
        :raises Refused: the device has no such object.
        """
        try:
            return int.from_bytes(self._sdo.upload(index, subindex), "little")
        except SdoAbortedError as error:
            raise self._aborted(f"reading {index:04X}h:{subindex}", error) from error
        except SdoCommunicationError as error:
            raise self._silent(error) from error

    def write(self, order: Write) -> None:
        """As :meth:`read`."""
        try:
            self._sdo.download(order.item, order.subindex, order.data)
        except SdoAbortedError as error:
            what = f"writing 0x{order.value:X} to {order.item:04X}h:{order.subindex}"
            raise self._aborted(what, error) from error
        except SdoCommunicationError as error:
            raise self._silent(error) from error

    def _aborted(self, what: str, error: SdoAbortedError) -> Refused:
        return self._line.refused(
            f"{self.name} aborts {what} with 0x{error.code:08X}",
            "Compare with the drive's object dictionary; it must be a CiA 402 drive with mappable PDOs",
        )

    def _silent(self, error: Exception) -> LinkLost:
        return self._line.lost(
            f"no SDO answer from {self.name}: {error}",
            "Check power, node ids, bitrate and CAN termination, then configure again",
        )

"""What a doctor has seen of the motion-capture system in a few seconds. Pure."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

from mocap_bridge.natnet.frame import Body
from mocap_bridge.natnet.handshake import ServerInfo

Neighbour = Literal["unknown", "present", "absent"]


class Evidence(NamedTuple):
    """What was seen while asking for poses."""

    route_address: str
    """This machine's address on the way to the server, as the kernel chooses it; empty: no way."""
    same_subnet: bool = True
    """Whether an interface of this machine is in the server's subnet."""
    neighbour: Neighbour = "unknown"
    """Whether the server's host answers at all, told by ARP."""
    early_frames: int = 0
    """Frames that came from the server though it answered nothing."""
    refused_ports: int = 0
    """Times the server's host said that nobody listens on the command port."""
    info: ServerInfo | None = None
    problem: str = ""
    """The client's own words, such as an unsupported version."""
    seconds: float = 0.0
    """Time since the server answered."""
    frames: int = 0
    malformed: int = 0
    last_fault: str = ""
    other_bitstream: int = 0
    foreign_senders: tuple[str, ...] = ()
    """Addresses that sent datagrams but are not the server."""
    elsewhere: tuple[str, ...] = ()
    """Local addresses of other interfaces on which the server's multicast frames do arrive."""
    names: frozenset[str] = frozenset()
    duplicate_names: frozenset[str] = frozenset()
    duplicate_ids: frozenset[str] = frozenset()
    bodies: Mapping[str, Sequence[Body]] = {}
    """Samples of each body, in the source's axes."""
    units_to_millimetres: float = 1000.0
    rate_hz: float = 0.0
    nominal_rate_hz: float = 0.0
    clock_error_ms: float | None = None
    """None: no echo was answered."""
    edited: bool = False

"""Client, frame order and names of one NatNet server: datagrams in, frames by name out. Pure."""

from collections import Counter
from collections.abc import Mapping

from mocap_bridge.natnet.client import Client
from mocap_bridge.natnet.frame import EDIT_MODE, Body, Frame
from mocap_bridge.natnet.listed import Listed, ids_of
from mocap_bridge.natnet.version import Version
from mocap_bridge.sequence import Sequence
from mocap_bridge.sources.base import STEADY, SourceFrame, SourceStatus

MANY_UNANSWERED = 10
"""So often in a row a server that is there answers."""


class NatNetReceiver:
    """Client, frame order and names of one server: datagrams in, frames by name out. Pure."""

    def __init__(self, name: str, wanted: Version, multicast: bool) -> None:
        self.client = Client(name, wanted, multicast)
        self.session = 0
        self.counters: Counter[str] = Counter()
        self._sequence = Sequence()
        self._models = self.client.models
        self._ids = b""
        self._names: tuple[str, ...] | None = ()
        """Of the bodies with these ids by that model list; None where they are not all known, each once."""
        self._dropped = 0
        self._restarts = 0

    def receive(self, datagram: bytes, now_ns: int) -> SourceFrame | None:
        """One datagram from the server; a frame comes back only if it is newer than all before."""
        stamped = self.client.receive(datagram, now_ns)
        if self.client.restarts != self._restarts:
            self._begin_session()
        if stamped is None:
            return None
        frame = stamped.frame
        order = self._sequence.judge(frame.number, frame.timestamp_s, now_ns)
        if order != "new":
            self.counters[order] += 1
            if order == "restart":
                self.client.restart()
                self._begin_session()
            return None
        ids = ids_of(frame.body_data)
        if ids != self._ids or self.client.models is not self._models:
            self._recognise(ids, frame)
        names, data = self._names, frame.body_data
        bodies: Mapping[str, Body] = self._known(frame.bodies, now_ns) if names is None else Listed(names, data)
        return SourceFrame(
            self.session,
            frame.number,
            stamped.exposure_ns,
            stamped.transmit_ns,
            now_ns,
            stamped.clock_error_ns,
            bodies,
            bool(frame.params & EDIT_MODE),
        )

    def _recognise(self, ids: bytes, frame: Frame) -> None:
        """Other ids, or another model list, than in the frame before."""
        self._ids, self._models = ids, self.client.models
        names = [self._models.names.get(body[0], "") for body in frame.bodies]
        self._names = tuple(names) if "" not in names and len(set(names)) == len(names) else None

    def _known(self, bodies: list[Body], now_ns: int) -> Mapping[str, Body]:
        """Bodies with a name; two with the same id are nobody's."""
        names, known_ids = self.client.models.names, self.client.models.known_ids
        times = Counter(body[0] for body in bodies)
        if not times.keys() <= known_ids:
            self.counters["unknown_id"] += 1
            self.client.request_models(now_ns)
        if len(times) < len(bodies):
            self.counters["repeated_id"] += 1
        return {names[body[0]]: body for body in bodies if body[0] in names and times[body[0]] == 1}

    def _begin_session(self) -> None:
        self._restarts = self.client.restarts
        self._dropped += self._sequence.dropped
        self._sequence = Sequence()
        self.session += 1

    def outbox(self, now_ns: int) -> list[bytes]:
        """Datagrams due now, for the server's command port."""
        return self.client.outbox(now_ns)

    def status(self) -> SourceStatus:
        """State of the connection, with the words for what is wrong."""
        client = self.client
        problem = client.problem
        if client.state == "streaming" and abs(client.units_to_millimetres - 1000.0) > 1.0:
            problem = (
                f"the server's unit is {client.units_to_millimetres:g} mm, not 1000 mm: "
                "set metres in the streaming settings"
            )
        elif client.unanswered > MANY_UNANSWERED and client.counters["early_frame"]:
            problem = (
                "frames come, but the server does not answer on its command port, which alone tells bodies' names: "
                "check mocap.server and mocap.command_port, and the server's firewall"
            )
        elif client.state == "streaming" and client.counters["unsynchronised"] and not client.stamper.clock.ready:
            problem = "the server answers no clock echo: stamps are taken from arrivals"
        return SourceStatus(
            name=client.info.name[:64] if client.info else "natnet",
            phase=client.state if client.state != "streaming" else STEADY,
            problem=problem,
            nominal_rate_hz=client.nominal_rate_hz,
            frames_dropped=self._dropped + self._sequence.dropped,
            malformed=client.counters["malformed"],
            counters={**client.counters, **self.counters},
            names=client.models.known_names,
            duplicate_names=client.models.duplicate_names,
            duplicate_ids=client.models.duplicate_ids,
        )

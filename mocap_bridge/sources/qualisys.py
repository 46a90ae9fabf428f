"""Qualisys Track Manager through its own package, ``qtm-rt`` (an extra)."""

import asyncio
import importlib
import math
import threading
import time
import xml.etree.ElementTree as ElementTree
from collections import Counter, deque
from collections.abc import Sequence as Items
from typing import Any, NamedTuple

from contract.arena import Arena
from mocap_bridge.natnet.clock import ArrivalClock
from mocap_bridge.natnet.frame import TRACKING_VALID, Body
from mocap_bridge.sequence import Sequence
from mocap_bridge.sources.base import STEADY, SourceFrame, SourceStatus


class Packet(NamedTuple):
    """What one 6D packet holds."""

    number: int
    timestamp_us: int
    bodies: Items[tuple[Items[float], Items[float]]]
    """Position in mm and rotation matrix, nine numbers column by column; NaN while not tracked."""
    received_ns: int


def quaternion(matrix: Items[float]) -> tuple[float, float, float, float]:
    """(x, y, z, w) of a rotation matrix given column by column, as QTM sends it."""
    a, d, g, b, e, h, c, f, i = matrix
    w = 0.5 * math.sqrt(max(0.0, 1.0 + a + e + i))
    x = math.copysign(0.5 * math.sqrt(max(0.0, 1.0 + a - e - i)), h - f)
    y = math.copysign(0.5 * math.sqrt(max(0.0, 1.0 - a + e - i)), c - g)
    z = math.copysign(0.5 * math.sqrt(max(0.0, 1.0 - a - e + i)), d - b)
    return x, y, z, w


def body_names(parameters: str | bytes) -> list[str]:
    """Names of the 6DOF bodies in QTM's parameter XML, in the order of the packets."""
    root = ElementTree.fromstring(parameters)
    return [(name.text or "").strip() for name in root.iterfind(".//The_6D//Body/Name")]


class QualisysReceiver:
    """Packets in, frames by name out. Pure."""

    def __init__(self, names: list[str]) -> None:
        self.names = names
        self.session = 0
        self.counters: Counter[str] = Counter()
        self._clock = ArrivalClock()
        self._sequence = Sequence()

    @property
    def dropped(self) -> int:
        """Frames that never came."""
        return self._sequence.dropped

    def receive(self, packet: Packet) -> SourceFrame | None:
        """One packet; bodies that are not tracked are passed on as such."""
        order = self._sequence.judge(packet.number, packet.timestamp_us * 1e-6, packet.received_ns)
        if order != "new":
            self.counters[order] += 1
            if order == "restart":
                self.session += 1
                self._sequence, self._clock = Sequence(), ArrivalClock()
            return None
        bodies: dict[str, Body] = {}
        for name, (position, matrix) in zip(self.names, packet.bodies, strict=False):
            tracked = all(map(math.isfinite, (*position, *matrix)))
            x, y, z = (0.001 * value for value in position) if tracked else (0.0, 0.0, 0.0)
            rotation = quaternion(matrix) if tracked else (0.0, 0.0, 0.0, 1.0)
            bodies[name] = (0, x, y, z, *rotation, 0.0, TRACKING_VALID if tracked else 0)
        stamp_ns = self._clock.local_ns(packet.timestamp_us * 1000, packet.received_ns)
        return SourceFrame(
            self.session, packet.number, stamp_ns, stamp_ns, packet.received_ns, ArrivalClock.ASSUMED_NS, bodies
        )


class QualisysSource:
    """The connection, kept by a thread of its own since the package is built on asyncio."""

    def __init__(self, package: Any, server: str) -> None:
        self._package, self._server = package, server
        self._receiver = QualisysReceiver([])
        self._waiting: deque[Packet] = deque(maxlen=256)
        self._arrived = threading.Event()
        self._stop = threading.Event()
        self._phase = "searching"
        self._thread = threading.Thread(target=lambda: asyncio.run(self._stay_connected()), daemon=True)
        self._thread.start()

    async def _stay_connected(self) -> None:
        while not self._stop.is_set():
            connection = None
            try:
                connection = await self._package.connect(self._server)
                if connection is not None:
                    self._receiver.names = body_names(await connection.get_parameters(parameters=["6d"]))
                    await connection.stream_frames(components=["6d"], on_packet=self._store)
                    self._phase = STEADY
                    while connection.has_transport() and not self._stop.is_set():
                        await asyncio.sleep(0.1)
            except Exception as error:
                self._receiver.counters[f"qtm_{type(error).__name__}"] += 1
            self._phase = "searching"
            if connection is not None:
                connection.disconnect()
            await asyncio.sleep(0 if self._stop.is_set() else 1.0)

    def _store(self, packet: Any) -> None:
        _, bodies = packet.get_6d()
        plain = [(tuple(position), tuple(rotation.matrix)) for position, rotation in bodies]
        self._waiting.append(Packet(packet.framenumber, packet.timestamp, plain, time.monotonic_ns()))
        self._arrived.set()

    def wait(self, timeout_s: float) -> None:
        """Until a packet is there, at most ``timeout_s``."""
        self._arrived.wait(timeout_s)
        self._arrived.clear()

    def receive(self, now_ns: int) -> list[SourceFrame]:
        """Everything that has arrived."""
        frames = []
        while self._waiting:
            frame = self._receiver.receive(self._waiting.popleft())
            if frame is not None:
                frames.append(frame)
        return frames

    def status(self) -> SourceStatus:
        return SourceStatus(
            name="qualisys",
            phase=self._phase,
            frames_dropped=self._receiver.dropped,
            counters=self._receiver.counters,
            names=frozenset(self._receiver.names),
        )

    def close(self) -> None:
        self._stop.set()
        self._thread.join(2.0)


def open_qualisys(arena: Arena) -> QualisysSource:
    """Connect to QTM at ``mocap.server``.

    :raises ImportError: the extra is not installed.
    """
    return QualisysSource(importlib.import_module("qtm_rt"), arena.mocap.server)

"""Qualisys Track Manager through its own package, ``qtm-rt`` (an extra)."""

import asyncio
import importlib
import threading
import time
from collections import deque
from typing import Any

from contract.arena import Arena
from mocap_bridge.sources.base import STEADY, SourceFrame, SourceStatus
from mocap_bridge.sources.qualisys_receiver import Packet, QualisysReceiver, Setup, setup_of

PORT = 22223
"""QTM's real-time port for little-endian clients, unless changed in its settings."""
ANSWER_S = 5.0
RETRY_S = 1.0
LOOK_S = 0.1


class QualisysSource:
    """The connection, kept by a thread of its own since the package is built on asyncio."""

    def __init__(self, package: Any, server: str, port: int = PORT) -> None:
        self._package, self._server, self._port = package, server, port
        self._receiver = QualisysReceiver(Setup())
        self._waiting: deque[Packet] = deque(maxlen=256)
        self._arrived = threading.Event()
        self._stop = threading.Event()
        self._phase = "searching"
        self._problem = ""
        self._other_bodies = False
        self._thread = threading.Thread(target=lambda: asyncio.run(self._stay_connected()), daemon=True)
        self._thread.start()

    async def _stay_connected(self) -> None:
        while not self._stop.is_set():
            try:
                await self._stay_while_it_lasts()
            except Exception as error:
                self._receiver.counters[f"qtm_{type(error).__name__}"] += 1
                self._problem = f"QTM at {self._server}:{self._port}: {error or type(error).__name__}"
            self._phase = "searching"
            await self._sleep(RETRY_S)

    async def _stay_while_it_lasts(self) -> None:
        connection = await asyncio.wait_for(self._package.connect(self._server, self._port), ANSWER_S)
        if connection is None:
            self._problem = (
                f"QTM at {self._server}:{self._port} does not answer: check mocap.server, that QTM runs, "
                "and its real-time output's little-endian port"
            )
            return
        try:
            self._receiver.setup = setup_of(await connection.get_parameters(parameters=["general", "6d"]))
            self._other_bodies = False
            await connection.stream_frames(components=["6dres"], on_packet=self._store)
            self._phase, self._problem = STEADY, ""
            while connection.has_transport() and not self._stop.is_set() and not self._other_bodies:
                await asyncio.sleep(LOOK_S)
        finally:
            if connection.has_transport():
                connection.disconnect()

    async def _sleep(self, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s and not self._stop.is_set():
            await asyncio.sleep(LOOK_S)

    def _store(self, packet: Any) -> None:
        found = packet.get_6d_residual()
        if found is None:
            self._receiver.counters["packet_without_6d"] += 1
            return
        plain = [(tuple(at), tuple(turned.matrix), residual.residual) for at, turned, residual in found[1]]
        self._other_bodies = self._other_bodies or len(plain) != len(self._receiver.setup.names)
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
        setup = self._receiver.setup
        return SourceStatus(
            name="qualisys",
            phase=self._phase,
            problem=self._problem,
            nominal_rate_hz=setup.rate_hz,
            frames_dropped=self._receiver.dropped,
            counters=dict(self._receiver.counters),
            names=frozenset(setup.names),
        )

    def close(self) -> None:
        self._stop.set()
        self._thread.join(2.0)


def open_qualisys(arena: Arena) -> QualisysSource:
    """Connect to QTM at ``mocap.server``.

    :raises ImportError: the extra is not installed.
    """
    return QualisysSource(importlib.import_module("qtm_rt"), arena.mocap.server)

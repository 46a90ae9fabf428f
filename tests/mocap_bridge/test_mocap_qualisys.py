"""Qualisys' own client package against a stand-in for QTM that speaks the protocol's bytes."""

import importlib
import math
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from mocap_bridge.pipeline import Pipeline
from mocap_bridge.sources.base import SourceFrame
from mocap_bridge.sources.qualisys import QualisysSource
from tests.mocap_bridge.lockstep import arena

COMMAND, XML, DATA = 1, 2, 3
SIX_D_RESIDUAL = 11
LIMIT_S = 15.0


def packet(kind: int, payload: bytes) -> bytes:
    return struct.pack("<II", 8 + len(payload), kind) + payload


def frame(number: int, bodies: int) -> bytes:
    """Bodies in a row, turning; the last is not tracked."""
    angle = 0.01 * number
    c, s = math.cos(angle), math.sin(angle)
    data = struct.pack("<ihh", bodies, 0, 0)
    for k in range(bodies - 1):
        data += struct.pack("<13f", 1000.0 * (k + 1), 2000.0, 50.0, c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0, 0.3)
    data += struct.pack("<13f", *([math.nan] * 13))
    component = struct.pack("<II", 8 + len(data), SIX_D_RESIDUAL) + data
    return packet(DATA, struct.pack("<qII", number * 10_000, number, 1) + component)


class FakeQtm:
    """One client at a time: greeting, version, parameters, then a frame every 10 ms."""

    def __init__(self) -> None:
        self.names = ["r06", "r08"]
        self.asked: list[str] = []
        self.hang_up = threading.Event()
        self.number = 0
        self._stop = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(0.05)
        self.port = int(self._listener.getsockname()[1])
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        while not self._stop.is_set():
            try:
                client, _ = self._listener.accept()
            except TimeoutError:
                continue
            self.hang_up.clear()
            with client:
                client.settimeout(0.01)
                client.sendall(packet(COMMAND, b"QTM RT Interface connected\0"))
                try:
                    self._talk(client)
                except OSError:
                    continue

    def _talk(self, client: socket.socket) -> None:
        streaming, heard = False, b""
        while not self._stop.is_set() and not self.hang_up.is_set():
            try:
                chunk = client.recv(4096)
                if not chunk:
                    return
                heard += chunk
            except TimeoutError:
                pass
            while len(heard) >= 8 and len(heard) >= struct.unpack_from("<I", heard)[0]:
                size = struct.unpack_from("<I", heard)[0]
                words, heard = heard[8 : size - 1].decode(), heard[size:]
                self.asked.append(words)
                if words.startswith("version"):
                    client.sendall(packet(COMMAND, f"Version set to {words.split()[1]}\0".encode()))
                elif words.startswith("getparameters"):
                    client.sendall(packet(XML, self._parameters()))
                elif words.startswith("streamframes"):
                    streaming = True
            if streaming:
                self.number += 1
                client.sendall(frame(self.number, len(self.names)))

    def _parameters(self) -> bytes:
        bodies = "".join(f"<Body><Name>{name}</Name><Enabled>true</Enabled></Body>" for name in self.names)
        return (
            "<QTM_Parameters_Ver_1.25><General><Frequency>100</Frequency></General>"
            f"<The_6D>{bodies}</The_6D></QTM_Parameters_Ver_1.25>\0"
        ).encode()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._listener.close()


@pytest.fixture
def qtm() -> Iterator[FakeQtm]:
    fake = FakeQtm()
    yield fake
    fake.close()


@pytest.fixture
def source(qtm: FakeQtm) -> Iterator[QualisysSource]:
    opened = QualisysSource(importlib.import_module("qtm_rt"), "127.0.0.1", qtm.port)
    yield opened
    opened.close()


def until(source: QualisysSource, done: Callable[[list[SourceFrame]], bool]) -> list[SourceFrame]:
    limit, frames = time.monotonic() + LIMIT_S, list[SourceFrame]()
    while not done(frames):
        assert time.monotonic() < limit, (source.status(), len(frames))
        source.wait(0.02)
        frames += source.receive(time.monotonic_ns())
    return frames


def test_frames_come_by_name_with_residuals_and_losses(qtm: FakeQtm, source: QualisysSource) -> None:
    frames = until(source, lambda frames: len(frames) >= 5)
    assert qtm.asked[:3] == ["version 1.25", "getparameters general 6d", "streamframes allframes 6dres"]
    status = source.status()
    assert (status.phase, status.problem, status.nominal_rate_hz) == ("streaming", "", 100.0)
    assert status.names == {"r06", "r08"}
    site = arena(source="qualisys", up_axis="z")
    first, second, third = Pipeline(site, 1).frame(frames[0], frames[0].received_ns).bodies
    assert (first.x_m, first.y_m, first.valid) == (1.0, 2.0, True)
    assert first.heading_rad == pytest.approx(0.01 * frames[0].number, abs=1e-5)
    assert (second.reason, third.reason) == ("occluded", "missing")
    assert frames[0].bodies["r06"][8] == pytest.approx(0.0003)


def test_other_bodies_and_a_lost_connection_are_followed(qtm: FakeQtm, source: QualisysSource) -> None:
    until(source, lambda frames: len(frames) >= 2)
    qtm.names = ["r06", "r09", "r08"]
    until(source, lambda _: source.status().names == {"r06", "r08", "r09"})
    until(source, lambda frames: len(frames) >= 1 and set(frames[-1].bodies) == {"r06", "r08", "r09"})
    qtm.hang_up.set()
    until(source, lambda _: source.status().phase != "streaming")
    until(source, lambda frames: len(frames) >= 2)
    assert qtm.asked.count("streamframes allframes 6dres") == 3


def test_qtm_that_does_not_answer_is_named() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        source = QualisysSource(importlib.import_module("qtm_rt"), "127.0.0.1", taken.getsockname()[1])
        try:
            until(source, lambda _: "does not answer: check mocap.server" in source.status().problem)
        finally:
            source.close()

"""A bad radio between network namespaces: Ethernet frames pass one by one, late, out of order, or not at all.

The robots' ends of their links are read raw in the namespace that this process runs in, and handed on to one uplink
and back: what TCP and QUIC make of lost packets is then their own doing. Frames never go from robot to robot, as in a
radio cell with client isolation. A file says what to do to them and is read again when it changes::

    {"loss": 0.1, "delay_ms": 5, "jitter_ms": 50, "cut": ["r06"]}

Each frame is lost with the same probability in either direction, on its own; its delay is ``delay_ms`` and between 0
and ``jitter_ms`` more. A frame waits for those before it, as in a radio cell, unless ``"overtaking": true``.
"""

import argparse
import contextlib
import random
import select
import signal
import socket
import sys
import time
from pathlib import Path

import msgspec

from groundstation.weather import Sky, Weather

ALL_PROTOCOLS = 0x0003
OUTGOING = 4
LOOK_S = 0.05
FRAME_BYTES = 65_536


def open_port(name: str) -> socket.socket:
    """A raw socket on a network interface.

    :raises OSError: no such interface, or not root.
    """
    port = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ALL_PROTOCOLS))
    port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    port.bind((name, ALL_PROTOCOLS))
    port.setblocking(False)
    return port


class Relay:
    """The shell around :class:`Sky`: one uplink, any number of ports."""

    def __init__(self, uplink: str, ports: list[str], weather: Path, seed: int) -> None:
        self.sky = Sky(random.Random(seed))
        self._uplink = uplink
        self._sockets = {name: open_port(name) for name in [uplink, *ports]}
        self._names = {entry.fileno(): name for name, entry in self._sockets.items()}
        self._homes: dict[bytes, str] = {}
        self._file = weather
        self._read_ns = 0

    def run(self, stop: list[int]) -> None:
        """Until ``stop`` has something in it."""
        poll = select.poll()
        for number in self._names:
            poll.register(number, select.POLLIN)
        look_s = 0.0
        while not stop:
            now_s = time.monotonic()
            if now_s >= look_s:
                look_s = now_s + LOOK_S
                self._look()
            due_ns = self.sky.next_ns
            wait_s = look_s - now_s if due_ns is None else min(look_s - now_s, due_ns * 1e-9 - now_s)
            for number, _ in poll.poll(max(0.0, wait_s) * 1000):
                self._drain(number)
            for to, frame in self.sky.due(time.monotonic_ns()):
                with contextlib.suppress(OSError):
                    self._sockets[to].send(frame)

    def _drain(self, number: int) -> None:
        name = self._names[number]
        port = self._sockets[name]
        now_ns = time.monotonic_ns()
        with contextlib.suppress(OSError):
            while True:
                frame, origin = port.recvfrom(FRAME_BYTES)
                if origin[2] == OUTGOING:
                    continue
                if name != self._uplink:
                    self._homes[frame[6:12]] = name
                    self.sky.take(frame, name, self._uplink, now_ns)
                elif frame[0] & 1:
                    for other in self._sockets:
                        if other != self._uplink:
                            self.sky.take(frame, other, other, now_ns)
                elif (home := self._homes.get(frame[:6])) is not None:
                    self.sky.take(frame, home, home, now_ns)

    def _look(self) -> None:
        with contextlib.suppress(OSError):
            changed_ns = self._file.stat().st_mtime_ns
            if changed_ns == self._read_ns:
                return
            self._read_ns = changed_ns
            try:
                self.sky.weather = msgspec.json.decode(self._file.read_bytes(), type=Weather)
            except msgspec.DecodeError as error:
                print(f"{self._file}: {error}; the weather stays", file=sys.stderr, flush=True)

    def close(self) -> None:
        for port in self._sockets.values():
            port.close()


def main() -> int:
    parser = argparse.ArgumentParser(prog="relay", allow_abbrev=False, description=__doc__)
    parser.add_argument("--uplink", required=True, metavar="IF")
    parser.add_argument("--ports", nargs="+", required=True, metavar="IF")
    parser.add_argument("--weather", type=Path, required=True, metavar="FILE")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    stop: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda received, _: stop.append(received))
    try:
        relay = Relay(args.uplink, args.ports, args.weather, args.seed)
    except OSError as error:
        print(f"relay: {error}", file=sys.stderr)
        return 1
    print("READY relay", flush=True)
    relay.run(stop)
    relay.close()
    print(f"passed {relay.sky.passed}, lost {relay.sky.lost}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())

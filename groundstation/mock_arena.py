"""The emulated hardware of an arena in one process: motor controllers on ptys, bodies, motion capture.

One epoll loop. Motors are integrated up to the moment somebody looks; frames leave at multiples of
the period from the first, so the stream does not drift, and telemetry of the same moment follows them.
What every emulated controller decoded goes to ``motor/<id>`` from a client session of this process's own. Where other
robots of the file are tracked, virtual bodies go to the bridge on ``mocap/virtual`` instead of a server of their own.

Faults. A file ``faults.txt`` beside the arena file is read again whenever it changes: one fault a line,
``ROBOT KIND`` (:data:`drivers.mock.faults.FAULTS`), ``udp corrupted`` (one bit of every datagram) or
``udp dropped`` (every frame). A fault lasts until its line is gone. ``ROBOT carried``: a hand puts a robot that is
outside the fence back inside, by the shortest way, when the line appears.
"""

import argparse
import contextlib
import select
import signal
import sys
import time
from pathlib import Path
from typing import cast

from contract.arena import Arena, ArenaError, load
from contract.messages import FeedbackBatch
from drivers.mock.faults import FAULTS, FaultKind
from drivers.mock.host import EmulatedWheels
from drivers.mock.stand import Stand
from drivers.registry import wheel_faults
from groundstation.link import Link, LinkError
from mocap_bridge.mock.bodies import BodyState, settings_of
from mocap_bridge.mock.server import EmulatedServer
from mocap_bridge.mock.udp import ServerShell
from mocap_bridge.mock.virtual import VirtualShell, VirtualStream

BATCH_NS = 50_000_000
FAULTS_FILE = "faults.txt"
CARRIED = "carried"
INSIDE_M = 0.02
"""A hand puts robots this far inside the fence."""


class MockArena:
    """Emulated wheels, virtual bodies and the motion-capture server that streams them."""

    def __init__(self, arena: Arena, link: Link, faults: Path) -> None:
        self._names = [name for name, robot in arena.robots.items() if "body" in robot.emulate]
        self._bodies = {name: arena.robots[name].body for name in self._names}
        self._wheels = EmulatedWheels(arena)
        self._stands = {
            name: Stand(arena.platform, arena.robots[name].start, arena.robots[name].heading_rad)
            for name in self._names
            if "wheels" not in arena.robots[name].emulate
        }
        """Real wheels with a virtual body."""
        self._stream: EmulatedServer | VirtualStream = (
            EmulatedServer(settings_of(arena), self._bodies.values())
            if len(self._names) == len(arena.robots)
            else VirtualStream(arena.mocap.frame_rate_hz)
        )
        self._address = arena.mocap.server
        self._shell: ServerShell | VirtualShell | None = None
        self._floor = arena.arena
        self._link = link
        self._running = True
        self._batch_due_ns = 0
        self._faults_file = faults
        self._faults_read: tuple[int, int] | None = None
        self._faults: set[tuple[str, str]] = set()

    def open(self) -> None:
        """Create ptys and sockets.

        :raises OSError: a port or path is taken.
        """
        self._wheels.plug()
        self._link.subscribe([self._link.keys.feedback(name) for name in self._stands])
        self._shell = (
            VirtualShell(self._stream, lambda frame: self._link.publish(self._link.keys.virtual, frame, "virtual"))
            if isinstance(self._stream, VirtualStream)
            else ServerShell(self._stream, self._address)
        )

    def close(self) -> None:
        self._wheels.close()
        if self._shell is not None:
            self._shell.close()

    def end(self) -> None:
        self._running = False

    def run(self) -> None:
        """Until :meth:`end`."""
        shell = self._shell
        assert shell is not None
        poll = select.epoll()
        wheel_fds = set(self._wheels.fds())
        for number in (*wheel_fds, *shell.fds()):
            poll.register(number, select.EPOLLIN)
        while self._running:
            device_ns = self._wheels.next_due_ns()
            for number, _ in poll.poll(self._wait_s(device_ns)):
                now_ns = time.monotonic_ns()
                if number in wheel_fds:
                    self._wheels.on_readable(number, now_ns)
                else:
                    shell.on_readable(number, now_ns)
            now_ns = time.monotonic_ns()
            frame_due = now_ns >= self._stream.next_due_ns
            if frame_due or (device_ns is not None and now_ns >= device_ns):
                self._wheels.roll(now_ns)
            if frame_due:
                self._listen()
                if ("udp", "dropped") in self._faults:
                    self._stream.stream(now_ns, self._poses(), time.monotonic_ns)
                else:
                    shell.stream(now_ns, self._poses(), time.monotonic_ns)
            self._wheels.deliver()
            if now_ns >= self._batch_due_ns:
                self._batch_due_ns = now_ns + BATCH_NS
                self._publish(now_ns)
                self._read_faults()
                fds = set(self._wheels.fds())
                follow(poll, wheel_fds, fds)
                wheel_fds = fds
        poll.close()

    def _wait_s(self, device_ns: int | None) -> float:
        due = [self._stream.next_due_ns, self._batch_due_ns]
        if device_ns is not None:
            due.append(device_ns)
        return max(0.0, (min(due) - time.monotonic_ns()) / 1e9)

    def _poses(self) -> list[BodyState]:
        now_ns = time.monotonic_ns() if self._stands else 0
        return [
            BodyState(
                self._bodies[name],
                *(self._stands[name].pose(now_ns) if name in self._stands else self._wheels.pose(name)),
            )
            for name in self._names
        ]

    def _listen(self) -> None:
        """What the real wheels measured."""
        if self._stands:
            for _, message in self._link.drain():
                if isinstance(message, FeedbackBatch) and message.robot in self._stands:
                    for sample in message.samples:
                        self._stands[message.robot].measured(sample)

    def _read_faults(self) -> None:
        try:
            found = self._faults_file.stat()
        except FileNotFoundError:
            return
        seen = (found.st_mtime_ns, found.st_size)
        if seen == self._faults_read:
            return
        self._faults_read = seen
        wanted = set()
        for line in self._faults_file.read_text(encoding="utf-8").splitlines():
            words = line.split()
            kinds = FAULTS if words[:1] == ["udp"] else (*FAULTS, CARRIED)
            known = len(words) == 2 and words[1] in kinds and (words[0] == "udp" or words[0] in self._wheels.robots)
            if known:
                wanted.add((words[0], words[1]))
            elif words:
                print(f"{self._faults_file}: {line!r} is not ROBOT KIND; ignored", file=sys.stderr, flush=True)
        for name, kind in self._faults - wanted:
            self._set(name, kind, False)
        for name, kind in wanted - self._faults:
            self._set(name, kind, True)
        self._faults = wanted

    def _set(self, name: str, kind: str, on: bool) -> None:
        if name == "udp":
            if self._shell is not None and kind == "corrupted":
                self._shell.damage = flip_bit if on else None
        elif kind == CARRIED:
            if on:
                self._carry(name)
        elif on:
            self._wheels.fault(name, cast(FaultKind, kind))
        else:
            self._wheels.repair(name, cast(FaultKind, kind))

    def _carry(self, name: str) -> None:
        body, inset_m, size_m = self._wheels.robots[name].body, self._floor.fence_m + INSIDE_M, self._floor.size_m
        x_m, y_m = (min(max(at, inset_m), m - inset_m) for at, m in zip((body.x_m, body.y_m), size_m, strict=True))
        body.place(x_m, y_m, body.heading_rad)

    def _publish(self, now_ns: int) -> None:
        """Of robots with a virtual body: where a tracked one is, the emulated wheels do not know."""
        for name in self._wheels.robots:
            batch = self._wheels.batch(name, now_ns)
            if name in self._bodies:
                self._link.publish(self._link.keys.motor(name), batch, "motor")


def follow(poll: select.epoll, before: set[int], now: set[int]) -> None:
    """Watch other descriptors than before; of those left, some are closed and some only jammed."""
    for number in before - now:
        with contextlib.suppress(OSError):
            poll.unregister(number)
    for number in now - before:
        poll.register(number, select.EPOLLIN)


def flip_bit(data: bytes) -> bytes:
    """The datagram with the lowest bit of its length field flipped: NatNet has no checksum to flip against."""
    return data[:2] + bytes([data[2] ^ 1]) + data[3:]


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arena", type=Path, required=True, metavar="FILE", help="arena file with emulated robots")


def run(args: argparse.Namespace) -> int:
    try:
        arena = load(args.arena, wheel_faults)
    except ArenaError as error:
        print(error, file=sys.stderr)
        return 2
    try:
        with Link(arena, "mock-arena", roles=("mock",)) as link:
            mock = MockArena(arena, link, args.arena.parent / FAULTS_FILE)
            for number in (signal.SIGTERM, signal.SIGINT):
                signal.signal(number, lambda *_: mock.end())
            try:
                mock.open()
                print("READY mock_arena", flush=True)
                mock.run()
            finally:
                mock.close()
    except (LinkError, OSError, ValueError) as error:
        print(f"mock arena: {error}", file=sys.stderr)
        return 1
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(prog="mock-arena", allow_abbrev=False, description=__doc__)
    configure(parser)
    return run(parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())

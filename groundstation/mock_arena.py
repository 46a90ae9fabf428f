"""The emulated hardware of an arena in one process: motor controllers on ptys, bodies, motion capture.

One epoll loop. Motors are integrated up to the moment somebody looks; frames leave at multiples of
the period from the first, so the stream does not drift. What every emulated controller decoded goes
to ``motor/<id>`` from a client session of this process's own.
"""

import argparse
import select
import signal
import sys
import time
from pathlib import Path

from contract.arena import Arena, ArenaError, load
from drivers.mock.host import EmulatedWheels
from drivers.registry import wheel_faults
from groundstation.link import Link, LinkError
from mocap_bridge.mock.bodies import BodyState, settings_of
from mocap_bridge.mock.server import EmulatedServer
from mocap_bridge.mock.udp import ServerShell

BATCH_NS = 50_000_000


class MockArena:
    """Emulated wheels, virtual bodies and the motion-capture server that streams them."""

    def __init__(self, arena: Arena, link: Link) -> None:
        self._names = [name for name, robot in arena.robots.items() if "body" in robot.emulate]
        self._bodies = {name: arena.robots[name].body for name in self._names}
        self._wheels = EmulatedWheels(arena)
        self._server = EmulatedServer(settings_of(arena), self._bodies.values())
        self._address = arena.mocap.server
        self._shell: ServerShell | None = None
        self._link = link
        self._running = True
        self._batch_due_ns = 0

    def open(self) -> None:
        """Create ptys and sockets.

        :raises OSError: a port or path is taken.
        """
        self._wheels.plug()
        self._shell = ServerShell(self._server, self._address)

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
            for number, _ in poll.poll(self._wait_s()):
                now_ns = time.monotonic_ns()
                if number in wheel_fds:
                    self._wheels.on_readable(number, now_ns)
                else:
                    shell.on_readable(number, now_ns)
            now_ns = time.monotonic_ns()
            self._wheels.advance(now_ns)
            if now_ns >= self._server.next_due_ns:
                shell.stream(now_ns, self._poses())
            if now_ns >= self._batch_due_ns:
                self._batch_due_ns = now_ns + BATCH_NS
                self._publish(now_ns)
        poll.close()

    def _wait_s(self) -> float:
        due = [self._server.next_due_ns, self._batch_due_ns]
        device_ns = self._wheels.next_due_ns()
        if device_ns is not None:
            due.append(device_ns)
        return max(0.0, (min(due) - time.monotonic_ns()) / 1e9)

    def _poses(self) -> list[BodyState]:
        return [BodyState(self._bodies[name], *self._wheels.pose(name)) for name in self._names]

    def _publish(self, now_ns: int) -> None:
        for name in self._wheels.robots:
            self._link.publish(self._link.keys.motor(name), self._wheels.batch(name, now_ns), "motor")


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arena", type=Path, required=True, metavar="FILE", help="arena file with emulated robots")


def run(args: argparse.Namespace) -> int:
    try:
        arena = load(args.arena, wheel_faults)
    except ArenaError as error:
        print(error, file=sys.stderr)
        return 2
    try:
        with Link(arena, "mock-arena") as link:
            mock = MockArena(arena, link)
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

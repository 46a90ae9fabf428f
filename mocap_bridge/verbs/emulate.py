"""Be a NatNet server: bodies drive in circles, and a script says what goes wrong.

With --recording it ends when the recording does. A tape of "record" is said again byte for byte, in the
version and axes it has, with one second to connect before; of a mission's run.mcap (needs --arena) the
bodies move again, in any version and axes, and a script may spoil it.

Without --arena: three bodies on 4 m x 5 m, NatNet 4.1, unicast, on 127.0.0.1 ports 1510 and 1511.
"""

import argparse
import math
import select
import signal
import sys
import time
from pathlib import Path

from contract.arena import Arena, load, parse
from mocap_bridge.mock import script
from mocap_bridge.mock.bodies import BodyState, ServerSettings, settings_of
from mocap_bridge.mock.recorded import RecordedBodies
from mocap_bridge.mock.server import EmulatedServer
from mocap_bridge.mock.tape_server import TapeServer
from mocap_bridge.mock.udp import ServerShell
from mocap_bridge.sources.replay import mission_frames
from mocap_bridge.sources.tape_file import is_tape, read_tape

CIRCLE_M = 0.25
SPEED_MPS = 0.3


def configure(parser: argparse.ArgumentParser) -> None:
    kinds = "\n".join(f"  {kind:14} {text}" for kind, text in script.KINDS.items())
    parser.description = __doc__
    parser.epilog = (
        "script: one fault a line, START DURATION KIND [BODY [OTHER]] [VALUE], times in s\n"
        f"  2.0 0.5 occlusion r06\n  5 1 swap r06 r08\n\nkinds:\n{kinds}"
    )
    parser.add_argument("--arena", type=Path, metavar="FILE", help="arena file: bodies, addresses, version, axes")
    parser.add_argument("--bodies", type=int, default=3, metavar="N", help="bodies b1 ... bN where no arena is given")
    parser.add_argument("--version", metavar="M.N", help="NatNet version of the server (default 4.1)")
    parser.add_argument("--rate", type=float, metavar="HZ", help="frames a second (default 120)")
    parser.add_argument("--up-axis", choices=("y", "z"), help="vertical axis of the stream (default y)")
    parser.add_argument("--multicast", metavar="GROUP", help="stream to this group instead of unicast")
    parser.add_argument("--address", metavar="IP", help="local address (default mocap.server)")
    parser.add_argument("--multicast-interface", default="", metavar="IP", help="where multicast leaves, if elsewhere")
    parser.add_argument("--ports", type=int, nargs=2, metavar=("COMMAND", "DATA"), help="default 1510 1511")
    parser.add_argument("--recording", type=Path, metavar="MCAP", help='a tape of "record", or a mission\'s run.mcap')
    parser.add_argument("--script", type=Path, metavar="FILE", help="scripted faults")
    parser.add_argument("--seed", type=int, default=1, help="of the noise and of random faults")
    parser.add_argument("--seconds", type=float, default=math.inf, help="stop after this time")


def _arena(options: argparse.Namespace) -> Arena:
    if options.arena:
        arena = load(options.arena)
    else:
        names = [f"b{k + 1}" for k in range(options.bodies)]
        starts = [[0.5 + 0.5 * (k % 7), 0.5 + 0.5 * (k // 7 % 9)] for k in range(len(names))]
        robots = {n: {"body": n, "start": s, "wheels": {"kind": "none"}} for n, s in zip(names, starts, strict=True)}
        arena = parse({"arena": {"name": "emulated", "size_m": [4.0, 5.0]}, "robots": robots}, "emulate")
    given = {
        "version": options.version,
        "frame_rate_hz": options.rate,
        "up_axis": options.up_axis,
        "multicast_group": options.multicast,
        "server": options.address,
        "command_port": options.ports and options.ports[0],
        "data_port": options.ports and options.ports[1],
    }
    import msgspec

    changes = {key: value for key, value in given.items() if value is not None}
    return msgspec.structs.replace(arena, mocap=msgspec.structs.replace(arena.mocap, **changes))


def circling(arena: Arena, elapsed_s: float) -> list[BodyState]:
    """Every robot's body on a circle through its start."""
    phase = SPEED_MPS / CIRCLE_M * elapsed_s
    out = []
    for robot in arena.robots.values():
        angle = phase + robot.heading_rad - 0.5 * math.pi
        x = robot.start[0] + CIRCLE_M * (math.cos(angle) - math.sin(robot.heading_rad))
        y = robot.start[1] + CIRCLE_M * (math.sin(angle) + math.cos(robot.heading_rad))
        out.append(BodyState(robot.body, x, y, math.remainder(phase + robot.heading_rad, math.tau)))
    return out


def _settings(arena: Arena, options: argparse.Namespace) -> ServerSettings:
    text = options.script.read_text(encoding="utf-8") if options.script else ""
    return settings_of(arena, script.parse(text), options.seed)


class Show:
    """A server, and where its bodies are."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.arena = arena = _arena(options)
        settings = _settings(arena, options)
        self._recorded: RecordedBodies | None = None
        self.server: EmulatedServer | TapeServer
        if options.recording and is_tape(options.recording):
            if options.script:
                raise ValueError("a script cannot spoil a tape, which is said again byte for byte")
            self.server = TapeServer(settings, lambda: read_tape(options.recording))
            return
        if options.recording:
            frames = (entry.frame for entry in mission_frames(options.recording, arena))
            self._recorded = RecordedBodies(arena, frames)
        self.server = EmulatedServer(settings, [robot.body for robot in arena.robots.values()])

    def poses(self, elapsed_s: float) -> list[BodyState]:
        if isinstance(self.server, TapeServer):
            return []
        return self._recorded.poses(elapsed_s) if self._recorded else circling(self.arena, elapsed_s)

    @property
    def ended(self) -> bool:
        return (
            self.server.ended if isinstance(self.server, TapeServer) else bool(self._recorded and self._recorded.ended)
        )


def run(options: argparse.Namespace) -> int:
    stop: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda received, _: stop.append(received))
    try:
        show = Show(options)
        shell = ServerShell(show.server, show.arena.mocap.server, options.multicast_interface)
    except (ValueError, OSError) as error:
        print(f"emulate: {error}", file=sys.stderr)
        return 2
    poll = select.poll()
    for fd in shell.fds():
        poll.register(fd, select.POLLIN)
    start_ns = now_ns = time.monotonic_ns()
    print("READY emulate", flush=True)
    while not stop and not show.ended and (now_ns - start_ns) * 1e-9 < options.seconds:
        for fd, _ in poll.poll(min(max((shell.next_due_ns - now_ns) * 1e-6, 0.0), 100.0)):
            shell.on_readable(fd, time.monotonic_ns())
        now_ns = time.monotonic_ns()
        if now_ns >= shell.next_due_ns:
            shell.stream(now_ns, show.poses((now_ns - start_ns) * 1e-9), time.monotonic_ns)
    shell.close()
    print(", ".join(f"{name} {count}" for name, count in sorted(show.server.counters.items()) if count) or "no faults")
    return 0

"""The loop around the agent: one thread, one ``poll``; Zenoh, the clock and the wheel driver.

Order of work: decode, control step, bus write; feedback, telemetry requests and publishing follow
some milliseconds later, so that one robot's housekeeping never delays another robot's command on a
shared computer. With nothing arriving the same poll ticks the agent at 50 Hz or more. Only poses and
orders wake the loop: neighbours' states and wheel feedback are of use to the next control step alone.
"""

import select
import signal
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import FrameType
from typing import Any

from contract import network
from contract.arena import Arena, digest, load, robot_or_fault
from contract.codec import WireError, encode
from contract.exposure import exposure
from contract.keys import Keys
from contract.messages import LogEntry
from contract.voice import say
from drivers.base import WheelSpeeds
from drivers.gated import GatedDrive
from drivers.lifecycle import Wheels
from drivers.registry import open_robot, wheel_faults
from onboard.agent import Agent, Drive
from onboard.checkup import checkup, findings
from onboard.computer import snapshot
from onboard.inbox import Inbox, read
from onboard.journal import JournalledAgent
from onboard.network import open_session, publisher
from onboard.service import Service, lock_memory, quiet
from onboard.site_time import SiteTime

TICK_NS = 18_000_000
HOUSEKEEPING_NS = 4_000_000
HOUSEKEEPING_SHARE = 0.4
"""Of the control period, at most: what is read and told must be there before the next frame."""
LOG_EVERY_NS = 1_000_000_000
COUNT_EVERY_NS = 100_000_000


def subscriptions(arena: Arena) -> dict[str, int]:
    """Keys that wake the loop, each with its rank: stop and heartbeat before all else."""
    keys = Keys(arena.arena.name)
    return {key: rank for rank, key in enumerate((keys.stop, keys.heartbeat, keys.mocap_frame, keys.targets))}


class Runtime:
    """One robot's process."""

    def __init__(self, arena: Arena, robot: str, agent: Agent, driver: GatedDrive) -> None:
        self._keys = Keys(arena.arena.name)
        self._tolerance_ns = round(arena.safety.clock_tolerance_s * 1e9)
        self._robot = robot
        self._agent = agent
        self._urgency = subscriptions(arena)
        self._inbox = Inbox(self._urgency)
        self._speakers: dict[str, Any] = {}
        """A robot's newest state, waiting at the door. Hearing our own means that another process uses this id."""
        self._wheels = Wheels(driver, agent)
        self._arena = arena
        self._publishers: dict[str, Any] = {}
        self._stopping = False
        self._logged_ns: dict[str, int] = {}
        self._state = "disarmed"
        self._counted_ns = 0
        self._poll = select.poll()
        self._service = Service()
        self._time: SiteTime

    def run(self) -> int:
        """Until SIGTERM or SIGINT; wheels at zero and disabled on every way out."""
        import zenoh

        identity = network.identity(self._arena.link.keys, self._robot)
        settings = network.client_config(self._arena.link.router, identity=identity)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)
        if self._service.managed:
            say("\n".join(findings(checkup(snapshot()))))
        self._service.waiting(f"waits for the router at {self._arena.link.router}")
        with open_session(settings) as session:
            self._time = SiteTime(session, self._keys, self._robot, self._tolerance_ns)
            self._service.waiting("waits for the site's time, which the motion-capture bridge tells")
            self._time.wait(lambda: self._stopping)
            if self._stopping:
                return 0
            try:
                self._join(session, zenoh)
                self._wheels.open(self._time.now_ns())
                quiet()
                if self._service.managed and not lock_memory():
                    say(f"{self._robot}: memory is not locked (LimitMEMLOCK); go on")
                self._service.ready(self._state)
                say(f"READY {self._robot}", sys.stdout)
                self._loop()
            finally:
                self._service.stopping()
                self._wheels.shut(self._time.now_ns())
        if self._time.clock.lost:
            say(f"{self._robot}: the site keeps another time than before; to be started anew")
            return 1
        return 0

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._stopping = True
        self._inbox.wake()

    def _join(self, session: Any, zenoh: Any) -> None:
        def store(key: str) -> Any:
            """Called by Zenoh's network thread itself: all it does is to lay the bytes down."""
            return zenoh.handlers.Callback(lambda sample: put(key, sample.payload.to_bytes()), indirect=False)

        put, remote = self._inbox.put, zenoh.Locality.REMOTE
        for key in self._urgency:
            session.declare_subscriber(key, store(key), allowed_origin=remote)
        for name in self._arena.robots:
            newest = zenoh.handlers.RingChannel(1)
            self._speakers[name] = session.declare_subscriber(self._keys.state(name), newest, allowed_origin=remote)
        for channel in ("state", "report", "steps", "feedback", "inputs", "log"):
            key = getattr(self._keys, channel)(self._robot)
            self._publishers[key] = publisher(session, key, channel)
        self._presence = session.liveliness().declare_token(self._keys.presence(self._robot))

    def _loop(self) -> None:
        self._poll.register(self._inbox.fileno(), select.POLLIN)
        ran_ns = 0
        housekeeping_ns = 0
        pause_ns = min(HOUSEKEEPING_NS, int(HOUSEKEEPING_SHARE * self._arena.control.control_period_s * 1e9))
        while not (self._stopping or self._time.clock.lost):
            now_ns = self._time.now_ns()
            wake_ns = ran_ns + TICK_NS
            if housekeeping_ns:
                wake_ns = min(wake_ns, housekeeping_ns)
            woken = self._poll.poll(max(0, wake_ns - now_ns) / 1e6)
            now_ns = self._time.now_ns()
            due = urgent = False
            if woken:
                due, urgent = self._receive(now_ns)
            if due or urgent or now_ns - ran_ns >= TICK_NS:
                drive = self._agent.step(now_ns) if due else self._agent.tick(now_ns)
                ran_ns = now_ns
                self._apply(drive, due, now_ns)
                housekeeping_ns = housekeeping_ns or now_ns + pause_ns
            if housekeeping_ns and now_ns >= housekeeping_ns:
                housekeeping_ns = 0
                self._keep_house(now_ns)

    def _receive(self, now_ns: int) -> tuple[bool, bool]:
        """(a control step is due, a stop or an order arrived)"""
        due = urgent = False
        for key, payload in self._inbox.take():
            if key == self._keys.mocap_frame and not self._time.sure:
                self._agent.refuse("frame while unsure of the site's time")
                continue
            due = self._take(key, payload, now_ns) or due
            urgent = urgent or self._urgency[key] < 2
        return due, urgent

    def _listen(self, now_ns: int) -> None:
        """Neighbours within reach of the virtual radio."""
        for name, speaker in self._speakers.items():
            sample = speaker.try_recv()
            if sample is not None and self._agent.hears(name):
                self._take(self._keys.state(name), sample.payload.to_bytes(), now_ns)

    def _take(self, key: str, payload: bytes, now_ns: int) -> bool:
        """Whether a control step is due."""
        try:
            message = read(self._keys, key, payload)
        except WireError as error:
            self._agent.refuse(f"refused_{error.kind}")
            self._log("warning", f"refused_{error.kind}", f"{key}: {error}", now_ns)
            return False
        return self._agent.receive(message, now_ns, payload)

    def _apply(self, drive: Drive, stepped: bool, stamp_ns: int) -> None:
        """``stamp_ns``: when this turn began; a process may have hung since."""
        speeds = WheelSpeeds(drive.left_radps, drive.right_radps)
        wrote = self._wheels.drive(drive.enable, speeds, self._time.now_ns(), stamp_ns)
        if stepped and wrote:
            self._agent.wrote(self._time.now_ns())

    def _keep_house(self, now_ns: int) -> None:
        if self._service.managed and (why := self._service.beat(self._agent.vitals, now_ns)):
            self._log("error", "watchdog", f"{why}: this process is to be started anew, disarmed", now_ns)
        self._time.turn()
        self._listen(now_ns)
        self._wheels.listen(self._time.now_ns())
        self._wheels.ask(self._time.now_ns())
        state = self._agent.run_state
        if state == "disarmed":
            self._wheels.open(now_ns, again=self._state != "disarmed")
        self._state = state
        if now_ns - self._counted_ns > COUNT_EVERY_NS:
            self._counted_ns = now_ns
            self._agent.counters.update(
                {f"driver_{name}": count for name, count in self._wheels.driver.counters.items()}
            )
        for key, message in self._agent.outbox(now_ns):
            self._publishers[key].put(encode(message))

    def _log(self, level: str, event: str, text: str, now_ns: int) -> None:
        if now_ns - self._logged_ns.get(event, -LOG_EVERY_NS) < LOG_EVERY_NS:
            return
        self._logged_ns[event] = now_ns
        entry = LogEntry(stamp_ns=now_ns, level=level, source=self._robot, event=event[:64], text=text[:400])  # type: ignore[arg-type]
        self._publishers[self._keys.log(self._robot)].put(encode(entry))
        say(f"{self._robot} {level}: {event}: {text}")


def software() -> str:
    """Version of the installed distribution; empty where it runs from a checkout that is not installed."""
    try:
        return version("ahdc-fieldkit")
    except PackageNotFoundError:
        return ""


def check(path: Path, robot: str) -> str:
    """What a run would work with, a line each; everything is loaded, nothing opened.

    :raises contract.arena.ArenaError: the file has faults, no such robot, or its certificates cannot be read.
    """
    import zenoh

    arena = load(path, wheel_faults)
    robot_or_fault(arena, robot)
    network.identity(arena.link.keys, robot)
    open_robot(arena, robot)
    zenoh.Config()
    said = {
        "robot": robot,
        "software": software(),
        "python": ".".join(map(str, sys.version_info[:3])),
        "zenoh": version("eclipse-zenoh"),
        "arena": digest(arena),
    }
    return "\n".join(f"{name}={value}" for name, value in said.items())


def run(path: Path, robot: str) -> int:
    """Run one robot of an arena file until it is told to end; the exit code.

    :raises contract.arena.ArenaError: the file has faults, or no such robot.
    """
    arena = load(path, wheel_faults)
    robot_or_fault(arena, robot)
    if words := exposure((arena.link.router,), arena.link.keys):
        say(words)
    agent = JournalledAgent(arena, robot, boot=time.time_ns() // 1_000_000, software=software())
    return Runtime(arena, robot, agent, open_robot(arena, robot)).run()

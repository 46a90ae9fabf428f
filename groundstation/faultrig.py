"""The real-time mock arena with a station in this process, to spoil it and watch: faults, stops, soak.

What is judged is what the emulated motors decoded and where the bodies really were, by ``motor/<id>``.
"""

import itertools
import math
import resource
import signal
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from contract.messages import Message, MotorBatch, MotorSample, RobotReport, StopRequest
from groundstation.conduct import Conductor, new_session
from groundstation.connectivity import components, mutual, summary
from groundstation.course import ENDED, Plan
from groundstation.link import Link
from groundstation.mock_arena import CARRIED, FAULTS_FILE
from groundstation.recording import Recording, RecordingError
from groundstation.rig import Rig
from groundstation.targets import cloud_of

PATIENCE_S = 30.0
MOVING_MPS = 0.05
TRIES = 8
LATE_S = 0.3
"""What was decoded before a moment has been told of this much later."""


NOWHERE: Mapping[str, tuple[float, float]] = {}


class StageError(RuntimeError):
    """The arena did not come to where it should; says what it was at."""


class Place(NamedTuple):
    """A body's true place at one moment."""

    stamp_ns: int
    x_m: float
    y_m: float
    speed_mps: float


class Stage:
    """A running arena and its station."""

    def __init__(self, processes: Rig, link: Link) -> None:
        self.rig, self.link, self.arena = processes, link, processes.arena
        cloud = cloud_of(self.arena, "faults")
        self.session = new_session(self.arena, cloud, Plan(), link)
        self.conductor = Conductor(self.arena, self.session, cloud, link)
        self.conductor.listener = lambda message, _: self._hear(message)
        link.subscribe(link.keys.motor(name) for name in self.arena.robots)
        self.samples: dict[str, list[MotorSample]] = {}
        self.places: dict[str, list[Place]] = {}
        self.reports: dict[str, RobotReport] = {}
        self.acknowledged_ns: dict[tuple[str, int], int] = {}
        self.mute = False
        """The station has gone: nothing is sent, only listened."""
        self.stop_id = 0
        """Of the last stop request."""

    def _hear(self, message: Message) -> None:
        if isinstance(message, MotorBatch):
            self.samples.setdefault(message.robot, []).extend(message.samples)
            place = Place(message.true_ns, message.true_x_m, message.true_y_m, abs(message.true_speed_mps))
            self.places.setdefault(message.robot, []).append(place)
        elif isinstance(message, RobotReport):
            self.reports[message.robot] = message
            if message.stop_id:
                self.acknowledged_ns.setdefault((message.robot, message.stop_id), time.monotonic_ns())

    # --- passing of time -----------------------------------------------------------------------------

    def turn(self) -> None:
        """A heartbeat's worth of time at most."""
        if not self.mute:
            self.conductor.turn()
            return
        self.link.wait(0.05)
        for _, message in self.link.drain():
            self._hear(message)

    def watch(self, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self.turn()

    def until(self, done: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
        """:raises StageError: it was not done in time."""
        deadline = time.monotonic() + patience_s
        while not done():
            if time.monotonic() > deadline:
                raise StageError(f"not within {patience_s:g} s: {what}; {self.session.phase}: {self.session.detail}")
            self.turn()

    def to_running(self, least: int = 1) -> None:
        """Release, arm and start a new mission; returns once that many robots move. A mission may end by itself.

        :raises StageError: it does not come to that.
        """
        for _ in range(TRIES):
            if self._started(least):
                return
        raise StageError(f"{TRIES} missions ended at once; the last: {self.session.detail}")

    def _started(self, least: int) -> bool:
        session = self.session
        session.order("disarm", time.monotonic_ns())
        if outside := [name for name in self.arena.robots if self.is_outside(name)]:
            self._carry_back(outside)
        self.until(lambda: not session.lacking(time.monotonic_ns(), connected=False), "robots fit to drive")
        if self.pieces(self.arena.robots) > 1:
            self._gather()
        self.until(lambda: session.phase == "ready", "ready")
        session.order("repeat", time.monotonic_ns())
        self.until(lambda: session.phase == "ready", "ready again")
        session.order("arm", time.monotonic_ns())
        self.until(lambda: session.phase in ("armed", *ENDED), "armed")
        session.order("run", time.monotonic_ns())
        self.until(lambda: len(self.moving()) >= least or session.phase != "running", f"{least} robot(s) move")
        return session.phase == "running"

    def is_outside(self, name: str) -> bool:
        """Whether it is outside the fence by what was seen of it last, as one that was cut off near it may be."""
        fence_m, size_m = self.arena.arena.fence_m, self.arena.arena.size_m
        seen = self.places.get(name, [])[-1:]
        return any(not fence_m <= at <= most - fence_m for p in seen for at, most in zip(p[1:3], size_m, strict=True))

    def _carry_back(self, robots: Iterable[str]) -> None:
        """By hand, as an operator would."""
        names = list(robots)
        self.until(lambda: not set(names) & set(self.moving()), "robots outside the fence come to rest")
        self.spoil(*(f"{name} {CARRIED}" for name in names))
        self.until(lambda: not any(map(self.is_outside, names)), "robots are carried back inside the fence")
        self.spoil()

    def _gather(self) -> None:
        """A robot has coasted out of its links: all drive to their starts."""
        session = self.session
        session.order("home", time.monotonic_ns())
        self.until(lambda: session.phase != "homing", "all robots at home")

    def moving(self) -> list[str]:
        return [name for name, places in self.places.items() if places and places[-1].speed_mps > MOVING_MPS]

    def forget(self) -> None:
        """What has been seen so far, but for the last of each."""
        for samples in self.samples.values():
            samples.clear()
        for places in self.places.values():
            del places[:-1]

    # --- what was seen -------------------------------------------------------------------------------

    def pieces(self, robots: Iterable[str], left_at: Mapping[str, tuple[float, float]] = NOWHERE) -> int:
        """Of the network, by the newest true places.

        :param left_at: places of robots that count instead of where they are.
        """
        points = [left_at.get(name) or self.places[name][-1][1:3] for name in robots if self.places.get(name)]
        return summary(points, self.arena.control.sensing_radius_m)[1]

    def nearest_m(self) -> float:
        points = [places[-1][1:3] for places in self.places.values() if places]
        return min((math.dist(a, b) for i, a in enumerate(points) for b in points[i + 1 :]), default=math.inf)

    def is_whole(self, victim: str) -> bool:
        """The others are one piece without the victim, by links among themselves that both ends report and vouch for.

        Robots that are near each other, but linked by the victim alone, may part where it rolls on.
        """
        others = [name for name in self.arena.robots if name != victim]
        told = [self.reports[name].links_on if name in self.reports else () for name in others]
        links = mutual([[others.index(name) for name in names if name in others] for names in told])
        return len(components(len(others), links)) == 1 == self.pieces(others)

    def is_split(self, victim: str, left_at: Mapping[str, tuple[float, float]]) -> bool:
        """The others have come apart, even with the victim between them where it is, or at ``left_at``."""
        robots = self.arena.robots
        others = [name for name in robots if name != victim]
        return all(self.pieces(*who) > 1 for who in ((others,), (robots,), (robots, left_at)))

    # --- faults --------------------------------------------------------------------------------------

    def spoil(self, *lines: str) -> None:
        """Faults of the emulated hardware from now on (:mod:`groundstation.mock_arena`); none: all repaired."""
        file = self.rig.out / FAULTS_FILE
        fresh = file.with_suffix(".new")
        fresh.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        fresh.replace(file)

    def signal(self, process: str, number: int) -> None:
        self.rig.family.child(process).signal(number)

    def signal_router(self, number: int) -> None:
        """It is a child of the bridge."""
        self.rig.family.child("bridge").signal_kin(number)

    def full_disk(self, process: str, on: bool = True) -> None:
        """No file of that process may grow any more, or all may again."""
        number = self.rig.family.child(process).pid
        _, most = resource.prlimit(number, resource.RLIMIT_FSIZE)
        resource.prlimit(number, resource.RLIMIT_FSIZE, (1 if on else most, most))

    def stop(self) -> int:
        """A STOP request to all; when it was sent, ns."""
        self.stop_id += 1
        now_ns = time.monotonic_ns()
        request = StopRequest(stamp_ns=now_ns, source="stage", stop_id=self.stop_id)
        self.link.publish(self.link.keys.stop, request, "stop")
        return now_ns

    def fall_silent(self) -> int:
        """As if the station had been killed; when its last heartbeat may have been sent, ns."""
        self.mute = True
        return time.monotonic_ns()

    def repair(self) -> None:
        """Everything works again: hardware, frozen processes, those that have ended.

        :raises groundstation.processes.ChildError: a process does not start.
        """
        self.mute = False
        self.spoil()
        for child in list(self.rig.family.children):
            if child.code is None:
                child.signal(signal.SIGCONT)
                child.signal_kin(signal.SIGCONT)
                self.full_disk(child.name, False)
            else:
                self.rig.start_again(child.name)


def rolled_m(places: Sequence[Place]) -> float:
    """The way along these places."""
    return sum(math.dist(a[1:3], b[1:3]) for a, b in itertools.pairwise(places))


def rest_s(places: Sequence[Place], since_ns: int, rest_mps: float) -> float | None:
    """When the body came to rest for good; None: it still moves, or nobody has seen it."""
    moving = [place.stamp_ns for place in places if place.speed_mps >= rest_mps]
    if not places or (moving and moving[-1] == places[-1].stamp_ns):
        return None
    return round(((moving[-1] if moving else since_ns) - since_ns) * 1e-9, 3)


def unreadable(out: Path) -> list[str]:
    """Every recording of the run folders ``OUT*`` that cannot be read, in words."""
    found = []
    for path in sorted(out.parent.glob(f"{out.name}*/*.mcap")):
        try:
            count = sum(1 for _ in Recording(path).messages())
        except RecordingError as error:
            found.append(str(error))
        else:
            if not count:
                found.append(f"{path}: nothing in it")
    return found

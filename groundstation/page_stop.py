"""STOP ALL as a latched state: what to send, who has answered, and how it is released, here or elsewhere. Pure.

It is a software stop: a hardware cut-off stays required. A press is idempotent; the request is repeated
until every robot has answered, and goes on for those that have not. Release never resumes motion.
"""

from collections.abc import Sequence
from typing import NamedTuple

from contract.messages import OrderRequest, RobotReport, StopRequest
from groundstation.scenes import label

MOST_NAMED = 8
CONFIRM_NS = 500_000_000
REPEAT_NS = 50_000_000
RELEASE_NS = 5_000_000_000
"""A release is asked for this long, then given up: the robots are still stopped."""


class Pressed(NamedTuple):
    """One STOP: times are site time, ns."""

    stop_id: int
    source: str
    since_ns: int


class StopLatch:
    """The STOP of one page server, whoever pressed it."""

    def __init__(self, robots: Sequence[str]) -> None:
        self.pressed: Pressed | None = None
        self.acknowledged_ns: dict[str, int] = {}
        """Robot -> from the press to its report that obeys."""
        self._robots = tuple(robots)
        self._numbers: set[int] = set()
        self._due_ns = 0
        self._release: OrderRequest | None = None
        self._release_from_ns = 0
        self._let_go: set[str] = set()

    def press(self, stop_id: int, source: str, now_ns: int) -> StopRequest:
        """STOP now. The same number again is the same press, sent again; a new number counts answers anew."""
        self._release = None
        if self.pressed is None or self.pressed.stop_id != stop_id:
            self.pressed = Pressed(stop_id, source, now_ns)
            self.acknowledged_ns, self._let_go = {}, set()
            self._numbers = {stop_id}
        self._due_ns = now_ns + REPEAT_NS
        return self._request(now_ns)

    def overheard(self, request: StopRequest, now_ns: int) -> None:
        """A STOP from another page or terminal latches this page, too."""
        if self.pressed is None:
            self.pressed = Pressed(request.stop_id, request.source, now_ns)
            self.acknowledged_ns, self._let_go = {}, set()
            self._numbers = set()
        self._numbers.add(request.stop_id)

    def heard(self, report: RobotReport, arrival_ns: int) -> None:
        """A robot's report: an answer to the STOP, or to the release."""
        if self._release is not None:
            if report.run not in ("stopped", "fault"):
                self._let_go.add(report.robot)
            if self._let_go.issuperset(self._release.robots or self._robots):
                self.pressed, self._release = None, None
                self.acknowledged_ns = {}
        elif self.pressed is not None and report.run == "stopped" and report.stop_id in self._numbers:
            self.acknowledged_ns.setdefault(report.robot, max(0, arrival_ns - self.pressed.since_ns))
            self._let_go.discard(report.robot)
        elif self.pressed is not None and report.robot in self.acknowledged_ns and report.run == "disarmed":
            self._let_go.add(report.robot)
            if self._let_go.issuperset(self._robots):
                self.pressed, self.acknowledged_ns = None, {}

    def due(self, now_ns: int) -> list[StopRequest | OrderRequest]:
        """What has to be sent again now, at most every :data:`REPEAT_NS`."""
        if self.pressed is None or now_ns < self._due_ns:
            return []
        self._due_ns = now_ns + REPEAT_NS
        if self._release is not None:
            if now_ns - self._release_from_ns < RELEASE_NS:
                return [self._release]
            self._release = None
        return [] if not self.silent else [self._request(now_ns)]

    @property
    def silent(self) -> list[str]:
        """Robots that have not answered this STOP."""
        return [robot for robot in self._robots if robot not in self.acknowledged_ns]

    @property
    def releasing(self) -> bool:
        return self._release is not None

    def confirmed(self, now_ns: int) -> bool | None:
        """True: every robot has answered. False: one has not within 500 ms. None: not yet known."""
        if self.pressed is None or not self.silent:
            return True
        return False if now_ns - self.pressed.since_ns >= CONFIRM_NS else None

    def word(self, silent: Sequence[str]) -> str:
        """What has to be typed to release; very many silent robots are counted, not named."""
        if not silent:
            return "RELEASE"
        names = "-".join(map(label, silent)) if len(silent) <= MOST_NAMED else f"{len(silent)}-ROBOTS"
        return f"RELEASE-NOT-{names}"

    def release(self, typed: str, silent: Sequence[str], number: int, source: str, now_ns: int) -> str:
        """Release the robots that answered; '' if under way, else why not. Silent robots stay latched."""
        if typed != self.word(silent):
            return f"type {self.word(silent)}"
        free = tuple(robot for robot in self._robots if robot not in silent)
        if not free:
            return "no robot has answered; nothing to release"
        addressees = free if silent else ()
        self._release = OrderRequest(
            stamp_ns=now_ns, source=source[:60], number=number, order="disarm", robots=addressees
        )
        self._release_from_ns, self._due_ns, self._let_go = now_ns, now_ns, set()
        if self.pressed is None:
            self.pressed = Pressed(0, "a robot", now_ns)
        return ""

    def _request(self, now_ns: int) -> StopRequest:
        assert self.pressed is not None
        return StopRequest(stamp_ns=now_ns, source=self.pressed.source, stop_id=self.pressed.stop_id)

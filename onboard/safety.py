"""The onboard supervisor: run state, failsafes, and leave to move. Pure; docs/safety.md is its table.

Three words, everywhere the same. HOLD: velocity zero in closed loop while a cause lasts. STOP:
HOLD until the wheels rest or ``safety.stop_settle_s`` has passed, then the motors are disabled;
latched. CUT: the motor controller's own watchdog lets go of the wheels (drivers/).

Nothing here opens, logs or reads a clock. The limits on the law's velocity are in
:mod:`onboard.limits`.
"""

from typing import Literal, NamedTuple

from contract.arena import Arena, digest
from contract.messages import SCHEMA_VERSION, TOOK_OVER, RunState, StationHeartbeat, StopRequest
from contract.units import Point
from onboard.failsafes import FAILSAFES, Action, Conditions, Sight, age_s, text
from onboard.limits import REST_MPS

Event = Literal["arm", "run", "hold", "disarm", "adopt", "stop", "halt", "fault"]
"""Orders, then: ``adopt`` (first heartbeat of another station), ``stop`` (order or request),
``halt`` (a failsafe that stops), ``fault`` (a failsafe that needs a repair)."""

STATES: tuple[RunState, ...] = ("disarmed", "armed", "running", "holding", "stopped", "fault")
EVENTS: tuple[Event, ...] = ("arm", "run", "hold", "disarm", "adopt", "stop", "halt", "fault")

_ROWS: dict[RunState, tuple[RunState, ...]] = {
    # state      arm         run         hold        disarm      adopt       stop       halt       fault
    "disarmed": ("armed", "disarmed", "disarmed", "disarmed", "disarmed", "stopped", "disarmed", "disarmed"),
    "armed": ("armed", "running", "armed", "disarmed", "disarmed", "stopped", "stopped", "fault"),
    "running": ("running", "running", "holding", "disarmed", "disarmed", "stopped", "stopped", "fault"),
    "holding": ("holding", "running", "holding", "disarmed", "disarmed", "stopped", "stopped", "fault"),
    "stopped": ("stopped", "stopped", "stopped", "disarmed", "stopped", "stopped", "stopped", "stopped"),
    "fault": ("fault", "fault", "fault", "disarmed", "fault", "stopped", "fault", "fault"),
}
TRANSITIONS: dict[tuple[RunState, Event], RunState] = {
    (state, event): row[column] for state, row in _ROWS.items() for column, event in enumerate(EVENTS)
}
POWERED: frozenset[RunState] = frozenset({"armed", "running", "holding"})
"""States in which the motors are enabled."""


class Verdict(NamedTuple):
    run: RunState
    may_move: bool
    """Leave to follow the law; otherwise the velocity is zero."""
    enable: bool
    """The motors should be enabled (moving, holding, or still coming to rest)."""
    reason: str
    remedy: str
    failsafe: str
    """Name of the row of :data:`FAILSAFES` that speaks, '' for none."""
    latched: bool
    """Only an operator's order ends it."""
    at_rest: bool
    """Wheel feedback says so."""


_EVENT_OF: dict[Action, Event] = {"stop": "halt", "fault": "fault"}


class Supervisor:
    """Run state of one robot. The only source of leave to move.

    Orders act once per ``order_id`` and only on a station already heard, so neither a reboot nor
    a restarted station arms anything. ``stop`` acts by level and latches.
    """

    def __init__(self, arena: Arena, robot: str) -> None:
        self.state: RunState = "disarmed"
        self.order_id = 0
        """Last order obeyed."""
        self.stop_id = 0
        """Last stop request obeyed."""
        self.homing = False
        """The last ``run`` obeyed was to drive home."""
        self.excluded: frozenset[str] = frozenset()
        """Robots taken out of the network, by the newest heartbeat."""
        self.aside: Point | None = None
        """Where this robot waits before it goes home; None: nobody has to pass first."""
        self.mission = ""
        """The station's, by the newest heartbeat."""
        self.ignored_heartbeats = 0
        """Repeated, reordered, too old or from the future."""
        self._robot = robot
        self._safety = arena.safety
        self._hash = digest(arena)
        self._station_boot = -1
        self._past_boots: set[int] = set()
        """Of stations that another has taken over from since."""
        self._seq = -1
        self._seen_order = -1
        self._station_ns = 0
        self._mismatch = ""
        self._blocked = "not assessed yet"
        self._reason = ""
        self._remedy = ""
        self._failsafe = ""
        self._settle_from_ns = 0
        self._settling = False
        self._active_since_ns = 0

    def heartbeat(self, message: StationHeartbeat, now_ns: int) -> None:
        """Take the station's will. A heartbeat that is old, repeated or from the future is ignored,
        but ``stop`` is obeyed whatever its age."""
        if message.order == "stop":
            self._apply("stop", now_ns, "the station ordered stop", "release (`disarm`) when it is safe")
        newcomer = message.boot != self._station_boot
        age_ns = now_ns - message.stamp_ns
        late = age_ns > self._safety.heartbeat_timeout_s * 1e9 or age_ns < -round(self._safety.clock_tolerance_s * 1e9)
        replayed = message.boot in self._past_boots if newcomer else message.seq <= self._seq
        if late or replayed:
            self.ignored_heartbeats += 1
            return
        if newcomer and self._station_boot >= 0:
            self._past_boots.add(self._station_boot)
        self._station_boot, self._seq = message.boot, message.seq
        self.excluded = frozenset(message.excluded)
        self.aside = message.aside.get(self._robot)
        self.mission = message.mission
        self._station_ns = min(message.stamp_ns, now_ns)
        self._mismatch = self._difference(message)
        if newcomer:
            self._seen_order = message.order_id
            self._apply("adopt", now_ns, TOOK_OVER, "arm again")
        elif message.order_id > self._seen_order:
            self._seen_order = message.order_id
            if not message.robots or self._robot in message.robots:
                self._obey(message, now_ns)
        if message.order == "stop":
            self.order_id = message.order_id

    def stop_request(self, message: StopRequest, now_ns: int) -> None:
        """STOP, whatever the state, age or source of the request."""
        self.stop_id = message.stop_id
        self._apply("stop", now_ns, f"stop requested by {message.source}", "release (`disarm`) when it is safe")

    def assess(self, conditions: Conditions, now_ns: int) -> Verdict:
        """Leave to move at this moment. Call it at every step and tick (50 Hz or more)."""
        if not conditions.driver_active:
            self._active_since_ns = 0
        elif not self._active_since_ns:
            self._active_since_ns = now_ns
        sight = self._sight(conditions, now_ns)
        tripped = [row for row in FAILSAFES if row.tripped(sight)]
        latching, held = None, False
        for row in tripped:
            if row.action == "hold":
                held = True
            elif latching is None and row.action in _EVENT_OF:
                latching = row
        self._blocked = text(latching, sight) if latching else ""
        if latching is not None and self.state in POWERED:
            remedy = conditions.driver_remedy if latching.name == "driver_fault" else latching.remedy
            self._apply(_EVENT_OF[latching.action], now_ns, self._blocked, remedy)
            self._failsafe = latching.name
        at_rest = _at_rest(conditions)
        if self._settling:
            fresh = conditions.feedback_stamp_ns > self._settle_from_ns
            waited_s = (now_ns - self._settle_from_ns) / 1e9
            self._settling = not ((at_rest and fresh) or waited_s >= self._safety.stop_settle_s)
        powered = self.state in POWERED
        run: RunState = "holding" if self.state == "running" and held else self.state
        idle_reason = None if self._reason else latching
        first = tripped[0] if tripped else None
        speaks = first if powered else idle_reason
        return Verdict(
            run=run,
            may_move=self.state == "running" and not held,
            enable=powered or self._settling,
            reason=text(speaks, sight) if speaks else self._reason,
            remedy=speaks.remedy if speaks else self._remedy,
            failsafe=speaks.name if speaks else self._failsafe,
            latched=self.state in ("stopped", "fault"),
            at_rest=at_rest,
        )

    def _sight(self, conditions: Conditions, now_ns: int) -> Sight:
        quiet_ns = now_ns - max(conditions.feedback_stamp_ns, self._active_since_ns)
        return Sight(
            now_ns=now_ns,
            conditions=conditions,
            safety=self._safety,
            station_age_s=age_s(self._station_ns, now_ns),
            station_mismatch=self._mismatch,
            driver_quiet_s=quiet_ns / 1e9 if self._active_since_ns else 0.0,
            seconds_since_loop=age_s(conditions.loop_last_step_ns, now_ns) if conditions.loop_last_step_ns else 0.0,
        )

    def _difference(self, message: StationHeartbeat) -> str:
        if message.schema_version != SCHEMA_VERSION:
            return f"message schema {message.schema_version} at the station, {SCHEMA_VERSION} here"
        if message.arena_hash != self._hash:
            return f"arena file {message.arena_hash or '(none)'} at the station, {self._hash} here"
        return ""

    def _obey(self, message: StationHeartbeat, now_ns: int) -> None:
        order: Event = message.order
        if order == "arm" and self.state == "disarmed":
            blocked = self._mismatch or self._blocked
            if blocked:
                self._reason, self._remedy = f"arm refused: {blocked}", "remove the cause, then arm again"
                return
        if TRANSITIONS[self.state, order] == self.state == "disarmed" and order in ("run", "hold"):
            self._reason, self._remedy = f"{order} refused: not armed", "arm first"
            return
        self.order_id = message.order_id
        if order == "run":
            self.homing = message.home
        if order == "disarm":
            self._reason = self._remedy = self._failsafe = ""
        self._apply(order, now_ns, "", "")

    def _apply(self, event: Event, now_ns: int, reason: str, remedy: str) -> None:
        after = TRANSITIONS[self.state, event]
        if after == self.state:
            return
        if self.state in POWERED and after not in POWERED:
            self._settling, self._settle_from_ns = True, now_ns
        self.state, self._reason, self._remedy, self._failsafe = after, reason, remedy, ""


def _at_rest(conditions: Conditions) -> bool:
    return -REST_MPS < conditions.left_mps < REST_MPS and -REST_MPS < conditions.right_mps < REST_MPS

"""The phases of one mission: what the facts make of it, and which order follows. Pure.

``waiting`` until every robot has reported, agrees on schema and arena file, is seen by the motion capture, and the
swarm is one piece; ``ready``; ``armed``; ``running``; then ``completed``, ``stopped`` (latched, somebody asked for it)
or ``failed`` (a fault, or no time left). ``homing`` is the way home. After an end nothing happens by itself.
"""

import math
from typing import Literal, NamedTuple

from contract.messages import Order
from groundstation.failsafes import stops, warnings
from groundstation.homeward import Homeward
from groundstation.knowledge import Knowledge
from groundstation.sighting import misplaced

QUORUM_PATIENCE_S = 5.0
"""A quorum waits this long for the rest."""
ARM_TIMEOUT_S = 5.0

Phase = Literal["waiting", "ready", "armed", "running", "homing", "completed", "stopped", "failed"]
ENDED: frozenset[Phase] = frozenset({"completed", "stopped", "failed"})


class Plan(NamedTuple):
    """What one session is to do by itself."""

    automatic: bool = False
    """Arm and start as soon as everything is ready."""
    timeout_s: float = math.inf
    """Of the mission, from start."""
    ready_timeout_s: float = math.inf
    """For the robots to become ready."""
    quorum: int = 0
    """Robots that suffice to start once the others have had their time; 0: all are needed."""
    overrides: tuple[str, ...] = ()
    """Checks (:data:`groundstation.failsafes.OVERRIDABLE`) that do not refuse the start."""


class Course:
    """Where one session stands; :meth:`advance` moves it on."""

    def __init__(self, known: Knowledge, plan: Plan, now_ns: int) -> None:
        self.phase: Phase = "waiting"
        self.detail = ""
        self.ending = ""
        """Why the last mission ended."""
        self.homeward = Homeward(known.arena)
        self._known = known
        self._plan = plan
        self._began_ns = now_ns

    def advance(self, now_ns: int) -> None:
        """Move on where the facts allow it. Call at 20 Hz or so."""
        if self.phase in ENDED or self._interrupted(now_ns):
            return
        if self.phase in ("waiting", "ready"):
            self._prepare(now_ns)
        elif self.phase == "armed":
            if self._plan.automatic:
                self.start(now_ns)
        elif self.phase == "running":
            self._judge(now_ns)
        elif self.phase == "homing":
            self._bring_home(now_ns)

    def _interrupted(self, now_ns: int) -> bool:
        """Whether something has ended the mission by itself."""
        known = self._known
        if powered := known.crew.powered_outsiders(known.reports):
            self.end("stopped", f"{', '.join(powered)} not released, but with power on", "stop", now_ns)
        elif self.phase != "waiting" and (faulty := known.found("fault")):
            self.end("failed", "; ".join(f"{r.robot}: {r.reason}" for r in faulty), "stop", now_ns)
        elif self.phase in ("armed", "running", "homing") and (stopped := known.found("stopped")):
            words = f"{', '.join(r.robot for r in stopped)} stopped: {stopped[0].reason}"
            self.end("stopped", words, "stop", now_ns)
        elif self.phase not in ("waiting", "ready") and (words := stops(known.facts(now_ns))):
            self.end("failed", words, "stop", now_ns)
        return self.phase in ENDED

    def wait(self, detail: str) -> None:
        """From the beginning, targets and mission aside; nothing more by itself."""
        self.phase, self.detail = "waiting", detail
        self._known.tally.begin_anew()
        self._plan = self._plan._replace(automatic=False)

    def set_out(self, now_ns: int) -> None:
        """Begin the way home, or say what is against it."""
        known = self._known
        lacking = known.lacking(now_ns, connected=False)
        if not lacking and (words := self.homeward.begin(known.crew.names, known.sighting.places)):
            lacking = [words]
        if lacking:
            self.detail = f"home refused: {'; '.join(lacking)}"[:400]
            return
        self.wait("arming")
        self.phase = "homing"
        known.give("arm", now_ns)

    def _bring_home(self, now_ns: int) -> None:
        known = self._known
        if known.will.order == "arm":
            if self._all_armed(now_ns):
                known.give("run", now_ns)
            return
        places = known.sighting.places
        away = self.homeward.advance(known.crew.names, known.reports, places, now_ns / 1e9)
        self.detail = f"on the way: {', '.join(away)}"[:400] if away else "all robots at home"
        if not away:
            known.give("disarm", now_ns)
            self.wait("all robots at home")
        elif known.will.age_s(now_ns) > self.homeward.timeout_s:
            words = "; ".join(misplaced(known.arena, places)) or ", ".join(away)
            self.end("failed", f"not home: {words}", "disarm", now_ns)

    def _all_armed(self, now_ns: int) -> bool:
        """Whether the crew is armed; too late is the end."""
        waiting = self._known.unarmed()
        if waiting and self._known.will.age_s(now_ns) > ARM_TIMEOUT_S:
            reports = (self._known.reports[name] for name in waiting)
            words = "; ".join(f"{report.robot}: {report.reason or report.run}" for report in reports)
            self.end("failed", f"not armed: {words}", "disarm", now_ns)
        return not waiting

    def _prepare(self, now_ns: int) -> None:
        known, crew = self._known, self._known.crew
        waited_s = (now_ns - self._began_ns) / 1e9
        if known.will.order == "disarm":
            readiness = known.readiness(now_ns)
            quorum = self._plan.quorum if waited_s > QUORUM_PATIENCE_S else 0
            crew.muster(quorum, lambda name: not readiness.of(name))
        if lacking := known.lacking(now_ns):
            self.phase, self.detail = "waiting", "; ".join(lacking)[:400]
            if waited_s > self._plan.ready_timeout_s:
                text = f"not ready in {self._plan.ready_timeout_s:g} s: {self.detail}"
                self.end("failed", text, "disarm", now_ns)
            return
        without = f" without {', '.join(crew.missing)}" if crew.missing else ""
        if self.phase == "waiting":
            words = f"ready{without}" if without else "all robots ready"
            taken_on = f"; overridden: {', '.join(known.overrides)}" if known.overrides else ""
            self.phase, self.detail = "ready", f"{words}; arm to go on{taken_on}"
            if self._plan.automatic:
                known.give("arm", now_ns)
        if known.will.order == "arm" and self._all_armed(now_ns):
            self.phase = "armed"
            self.detail = f"{f'armed{without}' if without else 'all robots armed'}; run to start"

    def _admit(self, now_ns: int) -> None:
        """Arm one late robot while the others run on, then order all to run."""
        known, crew = self._known, self._known.crew
        if crew.joining:
            armed = known.reports[crew.joining].run == "armed"
            if armed or known.will.age_s(now_ns) > ARM_TIMEOUT_S:
                if armed:
                    known.join()
                crew.joining = ""
                known.give("run", now_ns)
        elif known.will.order == "run" and not crew.addressees:
            readiness = known.readiness(now_ns)
            crew.joining = crew.late(known.reports, lambda name: not readiness.of(name))
            if crew.joining:
                known.give("arm", now_ns)

    def _judge(self, now_ns: int) -> None:
        known, tally = self._known, self._known.tally
        total, left, missing = len(tally.cloud.targets), tally.left, known.crew.missing
        without = f"without {', '.join(missing)}" if missing else ""
        self.detail = "; ".join(filter(None, (without, warnings(known.facts(now_ns)))))[:400]
        self._admit(now_ns)
        if not left:
            self.end("completed", f"all {total} targets occupied", "disarm", now_ns)
        elif now_ns - tally.started_ns > self._plan.timeout_s * 1e9:
            text = f"{left} of {total} targets left after {self._plan.timeout_s:g} s"
            self.end("failed", text, "stop", now_ns)

    def start(self, now_ns: int) -> None:
        """The mission, from armed or on hold."""
        self._known.give("run", now_ns)
        self.phase, self.detail = "running", ""
        self._known.tally.started_ns = self._known.tally.started_ns or now_ns

    def end(self, phase: Phase, detail: str, order: Order, now_ns: int) -> None:
        """Whatever comes first ends a mission; a stop is obeyed after it, too."""
        if self.phase in ENDED and order != "stop":
            return
        if self.phase not in ENDED:
            self._known.tally.ended_ns = now_ns
        if self.phase not in ("stopped", "failed"):
            self.phase, self.detail, self.ending = phase, detail[:400], detail[:400]
        if self._known.will.order != order:
            self._known.give(order, now_ns)

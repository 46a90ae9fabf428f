"""Trials on an arena whose processes run already: robots drive home, targets change, a recorder a trial.

This is the station of the arena meanwhile: no other ``session`` may run. STOP and release from the page or a
terminal as ever; after a stop it waits until an operator has released.
"""

import sys
from collections.abc import Callable
from math import inf
from pathlib import Path

import msgspec

from contract.arena import load
from drivers.registry import wheel_faults
from groundstation import current
from groundstation.conduct import Conductor, new_session
from groundstation.course import ENDED, Plan
from groundstation.experiment import judged, outcome
from groundstation.homeward import timeout_s
from groundstation.link import Link
from groundstation.outcomes import Outcome
from groundstation.processes import Family
from groundstation.recording import RecordingError
from groundstation.stage_mock import beside
from groundstation.targets import CloudError, cloud_of
from groundstation.trials import Experiment, Trial

READY_S = 10.0
HOME_MORE_S = 20.0
REST_S = 3.0


class NotReady(RuntimeError):
    """A trial could not begin; the text says why."""


class RobotStage:
    """:class:`groundstation.experiment.Stage` on running robots.

    :raises ArenaError: the arena file has faults.
    :raises LinkError: no router answers.
    """

    def __init__(self, experiment: Experiment, source: Path) -> None:
        self._experiment = experiment
        self._file = beside(experiment.arena, source)
        self._arena = load(self._file, wheel_faults)
        cloud = cloud_of(self._arena, experiment.name)
        self._link = Link(self._arena, "station")
        self._link.__enter__()
        current.remember(self._file)
        self._session = new_session(self._arena, cloud, Plan(), self._link)
        self._conductor = Conductor(self._arena, self._session, cloud, self._link)
        self._said = ""

    def close(self) -> None:
        """Leave the robots disarmed."""
        self._session.order("disarm", self._link.now_ns())
        self._conductor.until(lambda: self._session.at_rest, REST_S)
        self._link.__exit__()

    def play(self, trial: Trial, folder: Path) -> Outcome:
        try:
            return self._play(trial, folder)
        except (CloudError, NotReady, RecordingError) as error:
            return outcome(trial, "error", str(error), len(self._arena.robots), self._arena.control.profile)

    def _play(self, trial: Trial, folder: Path) -> Outcome:
        session = self._session
        wish = msgspec.structs.replace(self._arena.targets, count=trial.targets, seed=trial.seed, points=())
        cloud = cloud_of(
            msgspec.structs.replace(self._arena, targets=wish), f"{self._experiment.name}-{trial.name}"[:56]
        )
        self._be_released()
        self._be_charged()
        if session.misplaced():
            self._go_home()
        session.seed(msgspec.structs.replace(cloud, mission=f"{cloud.mission}-{self._link.now_ns() // 10**6 % 10**6}"))
        # the recorder's start takes longer than robots with power bear without a heartbeat
        self._until(lambda: session.phase == "ready", READY_S, "not ready")
        why = ""
        (folder / "logs").mkdir()
        with Family() as family:
            words = ["record", "--arena", str(self._file), "--out", str(folder)]
            family.start("recorder", "groundstation", words, folder / "logs" / "recorder.log")
            family.wait_ready(READY_S)
            self._until(lambda: session.phase == "ready", READY_S, "not ready")
            self._order("arm", "armed")
            self._order("run", "running")
            if not self._conductor.until(lambda: session.phase in ENDED, self._experiment.timeout_s):
                left = trial.targets - len(session.occupied)
                why = f"{left} of {trial.targets} targets left after {self._experiment.timeout_s:g} s"
                session.order("disarm", self._link.now_ns())
            elif session.phase != "completed":
                why = f"{session.phase}: {session.detail}"
            self._conductor.until(lambda: session.at_rest, REST_S)
        return judged(trial, folder, why)

    def _order(self, order: str, phase: str) -> None:
        self._session.order(order, self._link.now_ns())  # type: ignore[arg-type]
        self._until(lambda: self._session.phase in (phase, *ENDED), READY_S, f"{order} not obeyed")
        if order == "arm" and self._session.phase in ENDED:
            raise NotReady(f"not armed: {self._session.phase}, {self._session.detail}")

    def _go_home(self) -> None:
        self._until(
            lambda: not self._session.lacking(self._link.now_ns(), connected=False), READY_S, "not ready to go home"
        )
        self._session.order("home", self._link.now_ns())
        self._until(lambda: self._session.phase != "homing", timeout_s(self._arena) + HOME_MORE_S, "not home")
        if away := self._session.misplaced():
            raise NotReady(f"{self._session.detail}; {'; '.join(away)}")

    def _be_released(self) -> None:
        """After a mission's end by itself, ready anew; after a stop, only an operator may release."""
        session = self._session
        if session.phase in ("completed", "failed") and session.heartbeat(self._link.now_ns()).order == "disarm":
            session.order("disarm", self._link.now_ns())
        self._wait(
            lambda: session.phase not in ENDED, lambda: f"{session.phase}: {session.detail}; release it to go on"
        )

    def _be_charged(self) -> None:
        limit_v = self._experiment.pause_below_v

        def flat() -> list[str]:
            volts = {name: report.battery_v for name, report in self._session.reports.items()}
            return [f"{name} {v:.1f} V" for name, v in volts.items() if v is not None and v < limit_v]

        self._wait(lambda: not flat(), lambda: f"battery: {', '.join(flat())}; charge above {limit_v:g} V to go on")

    def _wait(self, done: Callable[[], bool], words: Callable[[], str]) -> None:
        """For the operator, however long it takes."""

        def over() -> bool:
            good = done()
            if not good and (now := words()) != self._said:
                self._said = now
                print(f"    waiting. {now}", file=sys.stderr, flush=True)
            return good

        self._conductor.until(over, inf)
        self._said = ""

    def _until(self, done: Callable[[], bool], timeout_s: float, what: str) -> None:
        if not self._conductor.until(done, timeout_s):
            raise NotReady(f"{what}: {self._session.phase}, {self._session.detail}")

"""Random scripted faults, one every few seconds, and a judge of what the bridge makes of them."""

import math
import random
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from contract.messages import MocapFrame, MocapHealth
from mocap_bridge.mock.bodies import BodyState
from mocap_bridge.mock.script import Fault

GAP_S = 3.4
AHEAD_S = 0.5
"""The next fault's script is followed so long before it: names and ids that change back with it are known by then."""
UPSET_S = 0.1
"""A fault begins at most so much later than its turn."""
RECOVERED_S = 2.6
"""After the start of a fault; the rest of the gap must be sound."""
FROZEN_S = 0.25
TOLERANCE_M = 0.002


class Kind(NamedTuple):
    """A kind of fault: how long, with what value, and the name under which health must tell of it."""

    seconds: float
    name: str
    value: float | None = None
    bodies: int = 0


KINDS: dict[str, Kind] = {
    "occlusion": Kind(0.6, "occluded", None, 1),
    "absent": Kind(0.6, "missing", None, 1),
    "swap": Kind(0.8, "swap_suspect", None, 2),
    "jump": Kind(0.03, "jump", 0.6, 1),
    "turn": Kind(0.03, "rotation_jump", 1.2, 1),
    "frozen": Kind(0.6, "frozen", None, 1),
    "not_finite": Kind(0.3, "not_finite", None, 1),
    "denormal": Kind(0.3, "quaternion_norm", 1.1, 1),
    "tilt": Kind(0.3, "tilted", 1.2, 1),
    "marker_error": Kind(0.3, "marker_error", 0.05, 1),
    "id_change": Kind(1.2, "unknown_id", None, 1),
    "wrong_models": Kind(1.2, "not_in_model_list", None, 1),
    "duplicate_name": Kind(1.2, "duplicate_name", None, 1),
    "drop": Kind(0.5, "frames_dropped", 0.5),
    "late": Kind(1.6, "ms from exposure to publication", 0.05),
    "reorder": Kind(0.5, "old"),
    "duplicate": Kind(0.5, "duplicate"),
    "burst": Kind(0.3, "stale"),
    "truncated": Kind(0.3, "malformed"),
    "restart": Kind(0.6, "session"),
    "silence": Kind(1.5, "lost"),
    "rate_change": Kind(1.4, "frames/s, 120 nominal", 60.0),
    "millimetres": Kind(0.3, "units"),
    "edit_mode": Kind(0.3, "edit_mode"),
    "clock_drift": Kind(2.0, "", 200.0),
    "no_echo": Kind(1.0, ""),
}
"""The last two are compensated: nothing is wrong, so nothing is named. A jump that lasted would be a new place."""


def faults(seed: int, bodies: Iterable[str], first_s: float = 2.0) -> Iterator[Fault]:
    """Without end: every kind once in random order, then again; one every ``GAP_S``."""
    draw, names, start_s = random.Random(seed), sorted(bodies), first_s
    while True:
        for kind in draw.sample(list(KINDS), len(KINDS)):
            what = KINDS[kind]
            body, other = draw.sample(names, 2)
            yield Fault(
                kind,
                start_s + draw.uniform(0.0, UPSET_S),
                what.seconds,
                body if what.bodies else "",
                other if what.bodies == 2 else "",
                what.value,
            )
            start_s += GAP_S


def over_s(fault: Fault) -> float:
    """Until when this fault's script is followed."""
    return fault.start_s + GAP_S - UPSET_S - AHEAD_S


class Judge:
    """Watches what is published; :attr:`verdicts` lists what must not be."""

    def __init__(self, truth: Callable[[float], Iterable[BodyState]]) -> None:
        self._truth = truth
        self.verdicts: list[str] = []
        self.frames = self.poses_valid = self.wrong = 0
        self.named: Counter[str] = Counter()
        self._last = (-1, -1)
        self._fault: Fault | None = None
        self._before: Counter[str] = Counter()
        self._now: Counter[str] = Counter()
        self._words: set[str] = set()
        self._sound: list[bool] = []

    def frame(self, frame: MocapFrame, exposure_s: float) -> None:
        """A published frame and the script's time of its exposure."""
        self.frames += 1
        if (frame.session, frame.frame) <= self._last:
            self.verdicts.append(f"frame {frame.frame} of session {frame.session} after {self._last}")
        if frame.session != self._last[0]:
            self._words.add("session")
        self._last = (frame.session, frame.frame)
        truth = {pose.name: pose for pose in self._truth(exposure_s)}
        for body in frame.bodies:
            if not body.valid:
                continue
            self.poses_valid += 1
            here, fault = truth[body.robot], self._fault
            frozen = fault is not None and (fault.kind, fault.body) == ("frozen", body.robot)
            allowed_m = TOLERANCE_M + (0.3 * FROZEN_S if frozen else 0.0)
            off_m = math.hypot(body.x_m - here.x_m, body.y_m - here.y_m)
            if off_m > allowed_m:
                self.wrong += 1
                if self.wrong <= 20:
                    self.verdicts.append(f"{body.robot} valid {off_m:.3f} m off at {exposure_s:.3f} s during {fault}")
        if self._fault and exposure_s > self._fault.start_s + RECOVERED_S:
            self._sound.append(all(body.valid for body in frame.bodies))

    def health(self, health: MocapHealth) -> None:
        """A published health record."""
        self._now = Counter(health.counters)
        for body in health.bodies:
            self._now.update(body.faults)
            self._words.add(body.reason)
        self._now["frames_dropped"], self._now["malformed"] = health.frames_dropped, health.malformed
        self._words |= {health.state, health.detail}

    def begin(self, fault: Fault) -> None:
        """From here on this fault is what goes wrong."""
        self._fault, self._before = fault, Counter(self._now)
        self._words, self._sound = set(), []

    def end(self) -> None:
        """The gap is over: it must be named, and be over."""
        assert self._fault is not None
        name = KINDS[self._fault.kind].name
        grown = self._now - self._before
        if name and not grown[name] and not any(name in word for word in self._words):
            self.verdicts.append(f"{self._fault} is not named {name}: {dict(grown)}, {sorted(self._words)}")
        elif name:
            self.named[name] += 1
        if len(self._sound) < 5 or not all(self._sound[-5:]):
            self.verdicts.append(f"no recovery from {self._fault}: {self._sound[-5:]}")

"""Faults of real processes, buses, disks and the router: rows for the real-time arena, and how one is played."""

import contextlib
import random
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import msgspec

from groundstation import rig
from groundstation.faultkept import Kept
from groundstation.faultrig import LATE_S, TRIES, Place, Stage, StageError, rest_s, rolled_m, unreadable
from groundstation.faultrows import AGE_S, SHOWN_BY_TURNING, TURN_S, Action, Outcome, Row, allowed_m
from groundstation.faultwords import gentle_radps, judge, zero_after_s
from groundstation.link import Link

ROBOTS = 3
WATCH_S = 2.8
TOLD_S = 0.06
"""Emulated hardware looks at its faults this often."""
REST_MPS = 0.01
PAUSE_S = 0.6
HELD_S = 1.0
"""Where the whole computer stood still for a moment robots hold as long, and then go on by themselves."""
AGREED_M = 0.02
"""Of a way measured at 20 Hz."""

LEAVES: dict[Action, str] = {"FAULT": "fault stopped"}
"""A robot's fault is the station's STOP for all."""

Inject = Callable[[Stage, str], None]


def _line(kind: str) -> Inject:
    return lambda stage, victim: stage.spoil(f"{victim} {kind}")


def _udp(kind: str) -> Inject:
    return lambda stage, victim: stage.spoil(f"udp {kind}")


def _signal(number: int, process: str = "") -> Inject:
    return lambda stage, victim: stage.signal(process or victim, number)


def _freeze_network(stage: Stage, victim: str) -> None:
    stage.signal("bridge", signal.SIGSTOP)
    stage.signal_router(signal.SIGSTOP)


def _kill_router(stage: Stage, victim: str) -> None:
    stage.signal_router(signal.SIGKILL)


def _pause(stage: Stage, victim: str) -> None:
    stage.signal(victim, signal.SIGSTOP)
    stage.watch(PAUSE_S)
    stage.signal(victim, signal.SIGCONT)


def _restart(name: str) -> Inject:
    def inject(stage: Stage, victim: str) -> None:
        stage.signal(name or victim, signal.SIGKILL)
        stage.rig.start_again(name or victim)

    return inject


def _mute(stage: Stage, victim: str) -> None:
    stage.fall_silent()


def _stop(stage: Stage, victim: str) -> None:
    stage.stop()


def _full(process: str) -> Inject:
    return lambda stage, victim: stage.full_disk(process or victim)


def _rows() -> tuple[Row, ...]:
    cut_s, silence_s = 0.2 + 0.12, 0.15 + AGE_S + TURN_S
    rows = [
        Row(
            "wheels",
            what,
            action,
            _line(kind),
            zero_s + TOLD_S,
            (),
            family,
            leaves=LEAVES.get(action, ""),
            turning=kind in SHOWN_BY_TURNING,
        )
        for what, kind, action, zero_s in _BUS
        for family in ("odrive", "roboclaw")
    ]
    rows.append(Row("wheels", "bus-off", "CUT", _line("bus-off"), cut_s + 0.1 + TOLD_S, (), "odrive"))
    rows += [
        Row("motion capture", "silence", "HOLD", _udp("dropped"), silence_s + TOLD_S),
        Row("motion capture", "one bit of every datagram", "HOLD", _udp("corrupted"), silence_s + TOLD_S),
        Row("motion capture", "bridge frozen", "HOLD", _signal(signal.SIGSTOP, "bridge"), silence_s),
        Row("radio", "router and bridge frozen", "HOLD", _freeze_network, silence_s, blind=True),
        Row("radio", "router killed", "HOLD", _kill_router, silence_s, resumes=True, blind=True),
        Row(
            "radio",
            "router and bridge killed, restarted",
            "HOLD",
            _restart("bridge"),
            silence_s,
            resumes=True,
            blind=True,
        ),
        Row("station", "killed", "STOP", _mute, 0.5 + TURN_S + 0.07),
        Row("station", "STOP", "STOP", _stop, 0.05),
        Row("process", "hung", "CUT", _signal(signal.SIGSTOP), cut_s),
        Row("process", "hung for 0.6 s", "CUT", _pause, cut_s, resumes=True),
        Row("process", "killed", "CUT", _signal(signal.SIGKILL), cut_s),
        Row("process", "killed and restarted", "CUT", _restart(""), cut_s, leaves="disarmed stopped"),
        Row("nothing", "no fault at all", "goes on", lambda stage, victim: None),
        Row("recorder", "hung", "goes on", _signal(signal.SIGSTOP, "recorder")),
        Row("recorder", "killed", "goes on", _signal(signal.SIGKILL, "recorder")),
        Row("disk", "full for the recorder", "goes on", _full("recorder")),
        Row("disk", "full for a robot's log", "goes on", _full("")),
    ]
    return tuple(rows)


_BUS: tuple[tuple[str, str, Action, float], ...] = (
    ("supply of the motors cut", "off", "FAULT", 2.3),
    ("wheels jammed", "stuck", "FAULT", 2.0),
    ("encoders count backwards", "wrong", "FAULT", 1.3),
    ("no bytes either way", "dropped", "CUT", 0.38),
    ("one bit in 8 bytes", "corrupted", "CUT", 0.6),
    ("port takes no bytes", "jammed", "CUT", 0.52),
    ("port unplugged", "unplugged", "CUT", 0.52),
    ("supply sags", "brown-out", "FAULT", 0.6),
)
REAL_ROWS: tuple[Row, ...] = _rows()


def play(stage: Stage, row: Row, seed: int) -> Outcome:
    """One fault of one row in a mission of its own; everything is repaired afterwards.

    :raises groundstation.faultrig.StageError: the swarm cannot be started, before or afterwards.
    """
    draw = random.Random(f"{row.name} {seed}")
    robots = stage.arena.robots
    fit = [name for name in robots if row.family in ("", robots[name].wheels["kind"])]
    victim, at_s = victim_of(stage, fit, draw)
    speed_mps = stage.places[victim][-1].speed_mps
    whole = stage.pieces(robots) == 1 and stage.is_whole(victim)
    stage.forget()
    before = stage.places[victim][-1]
    left_at = {victim: (before.x_m, before.y_m)} if row.action == "CUT" else {}
    since_ns = time.monotonic_ns()
    row.inject(stage, victim)
    injected_ns = time.monotonic_ns()
    split = False
    nearest_m = stage.nearest_m()
    deadline = time.monotonic() + WATCH_S
    while time.monotonic() < deadline:
        stage.turn()
        nearest_m = min(nearest_m, stage.nearest_m())
        split = split or (whole and stage.is_split(victim, left_at))
    if _goes_on(row):
        with contextlib.suppress(StageError):
            stage.until(lambda: stage.reports[victim].run == "running", "it goes on", HELD_S)
    state = stage.reports[victim].run
    ended = tuple(child.name for child in stage.rig.family.children if child.code is not None)
    until_ns = time.monotonic_ns()
    stage.repair()
    stage.watch(LATE_S)
    samples = [sample for sample in stage.samples.get(victim, ()) if sample.stamp_ns < until_ns]
    places = judged_by(row, stage.places[victim], before, (since_ns, injected_ns, until_ns))
    gentle = gentle_radps(row, stage.arena)
    zero_s = None if row.blind else zero_after_s(samples, since_ns, row.resumes, gentle)
    outcome = Outcome(
        row=row.name,
        seed=seed,
        victim=victim,
        at_s=round(at_s, 3),
        speed_mps=round(speed_mps, 3),
        zero_s=zero_s,
        rest_s=rest_s(places, since_ns, REST_MPS),
        rolled_m=round(rolled_m(places), 4),
        failsafe=(),
        collisions=int(nearest_m < stage.arena.platform.diameter_m),
        split=split,
        state=state,
    )
    return judged(row, outcome, stage, ended)


def victim_of(stage: Stage, fit: Sequence[str], draw: random.Random) -> tuple[str, float]:
    """One of these that moves, in a mission of its own, and for how long the mission has run, s.

    They may rest for a while: robots that begin on targets occupy them first.

    :raises groundstation.faultrig.StageError: none does.
    """
    for _ in range(TRIES):
        stage.to_running()
        began = time.monotonic()
        stage.watch(draw.uniform(0.2, 1.0))
        stage.until(
            lambda: stage.session.phase != "running" or not set(fit).isdisjoint(stage.moving()),
            f"one of {', '.join(fit)} moves",
        )
        moving = [name for name in fit if name in stage.moving()]
        if moving and stage.session.phase == "running":
            return draw.choice(moving), time.monotonic() - began
    raise StageError(f"{TRIES} missions ended before one of {', '.join(fit)} moved; {stage.session.detail}")


def judged_by(row: Row, places: Sequence[Place], before: Place, times_ns: tuple[int, int, int]) -> list[Place]:
    """The places that say what a victim did.

    :param before: the last place before the fault.
    :param times_ns: when the fault began, when all of it was there, when it was repaired. While a network is being
        frozen, one more place may still come through, and some from the time after that once it is repaired.
    """
    since_ns, injected_ns, until_ns = times_ns
    if row.blind:
        first_ns = since_ns if row.resumes else injected_ns
        seen = [place for place in places if first_ns <= place.stamp_ns]
        if row.resumes:
            seen = seen[:1]
        return [before._replace(stamp_ns=since_ns, speed_mps=0.0), *seen] if seen else []
    end_ns = injected_ns if row.resumes else until_ns
    return [place for place in places if since_ns <= place.stamp_ns < end_ns]


def judged(row: Row, outcome: Outcome, stage: Stage, ended: Sequence[str] = ()) -> Outcome:
    """The outcome with what is wrong with it.

    :param ended: processes that had ended by then.

    A robot that hung for a while goes on by itself once every cause of HOLD has gone, unless its driver has lost its
    telemetry meanwhile, which one reply still waiting in the port decides. So its way is looked at until the process is
    let go on, and bounded as that of one that hangs for good.
    """
    bound = row if row.blind else row._replace(resumes=False)
    faults = [*judge(row, outcome, allowed_m(bound, stage.arena) + AGREED_M), *_real(row, outcome, stage, ended)]
    return msgspec.structs.replace(outcome, faults=tuple(faults))


def _goes_on(row: Row) -> bool:
    """The robot is to take no notice."""
    return row.action == "goes on" and not row.leaves


def _real(row: Row, outcome: Outcome, stage: Stage, ended: Sequence[str]) -> Iterator[str]:
    """What only real processes can get wrong."""
    if "killed" not in row.name:
        yield from (f"{name} has ended" for name in ended)
    if _goes_on(row) and outcome.state != "running":
        report = stage.reports.get(outcome.victim)
        yield f"left {outcome.state}, expected running: {report.reason if report is not None else 'silent'}"


def play_all(wanted: Sequence[tuple[Row, int]], kept: Kept, robots: int = ROBOTS) -> None:
    """Play what is not kept yet, all in one arena; recordings that cannot be read are an outcome of their own.

    :raises groundstation.processes.ChildError: the arena does not start.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        arena = rig.mock_arena(rig.find_arena("experiment2"), out, rig.Changes(robots, 60, 1))
        with rig.Rig(arena, out) as processes:
            processes.start()
            with Link(arena, "station") as link:
                stage = Stage(processes, link)
                for row, seed in wanted:
                    if (row.name, seed) not in kept.outcomes:
                        kept.add(play(stage, row, seed))
        bad = unreadable(out)
    if bad:
        raise StageError("; ".join(bad))

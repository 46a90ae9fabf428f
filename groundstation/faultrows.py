"""The fault matrix's rows: what is spoilt, where, and what must follow by when. Pure.

``zero_s`` bounds the time from the fault to the last stretch of zero setpoints (or released motors) that the emulated
controller decoded; the distance rolled must stay below :func:`allowed_m`. Rows with ``zero_s`` None are faults that
must *not* stop a robot (``goes on``), or that no program can undo (``named``): a failsafe must name these.
"""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import msgspec

from contract.arena import Arena
from contract.margins import cut_m, stopping_m
from contract.messages import NeighbourState, StationHeartbeat
from drivers.mock.faults import Direction, FaultKind, FaultSettings
from groundstation.lockstep import World
from groundstation.wire import Wire
from mocap_bridge.mock.script import Fault

Action = Literal["HOLD", "STOP", "FAULT", "CUT", "goes on", "named"]
ENDS: dict[Action, str] = {"STOP": "stopped", "FAULT": "fault"}
"""Run state that a robot is left in."""
LASTS_S = 2.5
"""A fault lasts to the end of what is looked at."""
AGE_S = 0.08
"""The oldest pose or message of the field conditions."""
PAUSE_S = 0.5
LATE_S = 0.3
LOOK_S = 0.05
"""A line that damages bytes is looked at this often, for as long as silence is borne (drivers/lifecycle.py)."""
JUMP_M = 0.5
TURN_S = 0.03
"""A tick (18 ms), a frame (10 ms) and the bus."""
SHOWN_BY_TURNING = ("off", "stuck", "wrong")
"""Kinds of faults that resting wheels do not have."""
SEEN_AGAIN_S = 0.3
"""A robot may have poses again, and go on, so long before the station has: either tries four times a second."""


class Row(NamedTuple):
    where: str
    fault: str
    action: Action
    inject: Callable[[Any, str], None]
    """Into a :class:`World`, or a :class:`groundstation.faultrig.Stage`; the victim's name."""
    zero_s: float | None = None
    failsafes: tuple[str, ...] = ()
    """One of these must speak; none: any, or none."""
    family: str = ""
    """Wheels of the victim; empty: either."""
    resumes: bool = False
    """The robot may go on within the time looked at: the first zero counts, not the last, and in lockstep no way."""
    blind: bool = False
    """What the motors decode cannot be heard meanwhile; the body's place before and after is judged alone.

    If it resumes as well, it may be on its way again when it is first seen: then only how far it came counts."""
    leaves: str = ""
    """Run states at the end, one of them; empty: as the action says."""
    turning: bool = False
    """Only wheels that are told to turn can show it: the time for which they rest, or hardly turn, does not count."""

    @property
    def ends(self) -> tuple[str, ...]:
        """Run states one of which the robot must be left in; empty: any."""
        return tuple((self.leaves or ENDS.get(self.action, "")).split())

    @property
    def name(self) -> str:
        return f"{self.where}: {self.fault}" + (f" ({self.family})" if self.family else "")


class Outcome(msgspec.Struct, frozen=True):
    """What one fault did."""

    row: str
    seed: int
    victim: str
    at_s: float
    speed_mps: float
    """Of the victim when the fault came."""
    zero_s: float | None
    """To the last stretch of zero setpoints or released motors; None: it never began."""
    rest_s: float | None
    rolled_m: float
    failsafe: tuple[str, ...]
    collisions: int
    split: bool
    """The unaffected robots, whole before, came apart, even with the victim between them."""
    state: str = ""
    """Run state of the victim at the end."""
    faults: tuple[str, ...] = ()
    """What is wrong with it; empty: as the row demands."""


def allowed_m(row: Row, arena: Arena) -> float:
    """How far the victim may roll after the fault: the deadline at full speed, then a brake; a cut coasts instead."""
    speed, field = arena.control.max_speed_mps, arena.control.field
    if row.zero_s is None or (row.resumes and not row.blind):
        return float("inf")
    if row.resumes:
        return speed * (row.zero_s + SEEN_AGAIN_S) + stopping_m(
            speed, field.brake_deceleration_mps2[0], field.motor_lag_s[1]
        )
    if row.action in ("CUT", "FAULT"):
        return speed * row.zero_s + cut_m(speed, 0.0, arena.platform.coast_deceleration_mps2)
    return speed * row.zero_s + stopping_m(speed, field.brake_deceleration_mps2[0], field.motor_lag_s[1])


def wire_of(world: World) -> Wire:
    """The world's bytes.

    :raises TypeError: a world without bytes has no hops to spoil.
    """
    if not isinstance(world.hops, Wire):
        raise TypeError("faults are injected into missions over real bytes (wired)")
    return world.hops


def _line(kind: FaultKind, *directions: Direction, **settings: float) -> Callable[[World, str], None]:
    def inject(world: World, victim: str) -> None:
        chosen = FaultSettings(**settings)  # type: ignore[arg-type]
        wire_of(world).emulated.fault(victim, kind, chosen._replace(directions=directions) if directions else chosen)

    return inject


def _mocap(kind: str, value: float | None = None, single: bool = False) -> Callable[[World, str], None]:
    def inject(world: World, victim: str) -> None:
        server = wire_of(world).server
        start_s = server.elapsed_s(world.now_ns)
        other = next(name for name in world.agents if name != victim)
        bodies = (world.arena.robots[victim].body, world.arena.robots[other].body if kind == "swap" else "")
        server.inject(Fault(kind, start_s, LASTS_S, *(bodies if single else ("", "")), value))

    return inject


def _jump(world: World, victim: str) -> None:
    """Towards the middle, so that it stays on the floor."""
    inwards = world.hops.pose(victim).x_m < world.arena.arena.size_m[0] / 2
    _mocap("jump", JUMP_M if inwards else -JUMP_M, single=True)(world, victim)


def _message(damage: Callable[[bytes], bytes]) -> Callable[[World, str], None]:
    def inject(world: World, victim: str) -> None:
        wire_of(world).damage_message = damage

    return inject


def _datagram(damage: Callable[[bytes], bytes]) -> Callable[[World, str], None]:
    def inject(world: World, victim: str) -> None:
        wire_of(world).damage_datagram = damage

    return inject


def _flip(data: bytes) -> bytes:
    return data[:2] + bytes([data[2] ^ 0x80]) + data[3:]


def _hang(world: World, victim: str) -> None:
    world.hang(victim)


def _pause(world: World, victim: str) -> None:
    world.hang(victim)
    world.later(PAUSE_S, lambda: world.hang(victim, False))


def _restart(world: World, victim: str) -> None:
    world.restart(victim)


def _clock(step_s: float) -> Callable[[World, str], None]:
    def inject(world: World, victim: str) -> None:
        world.skew_ns[victim] = int(step_s * 1e9)

    return inject


def _late(world: World, victim: str) -> None:
    world.late_ns[victim] = int(LATE_S * 1e9)


def _offline(world: World, victim: str) -> None:
    world.offline.add(victim)


def _router_gone(world: World, victim: str) -> None:
    world.offline.update(world.agents)


def _station_gone(world: World, victim: str) -> None:
    world.station_beats = False


def _stop(world: World, victim: str) -> None:
    world.stop()


def _twin(world: World, victim: str) -> None:
    x, y, heading = world.hops.pose(victim)
    state = NeighbourState(
        robot=victim, boot=99, seq=1, stamp_ns=world.now_ns, x_m=round(x, 5), y_m=round(y, 5),
        heading_rad=round(heading, 5), vx_mps=0.0, vy_mps=0.0, stop_long=(x, y), stop_short=(x, y),
    )  # fmt: skip
    world.whisper(victim, world.keys.state(victim), state)


def _heartbeat(**changes: object) -> Callable[[World, str], None]:
    def inject(world: World, victim: str) -> None:
        fields: dict[str, object] = {"boot": 1, "seq": 1 << 40, "stamp_ns": world.now_ns, "order": "run"}
        beat = StationHeartbeat(**{**fields, "order_id": 3, **changes})  # type: ignore[arg-type]
        world.station_beats = False
        world.whisper(victim, world.keys.heartbeat, beat)

    return inject


def _rows() -> tuple[Row, ...]:
    cut_s = 0.2 + 0.12
    silence_s = 0.15 + AGE_S + TURN_S
    driver_s = 0.25 + TURN_S
    bus: tuple[tuple[str, FaultKind, Action, float, tuple[Direction, ...], tuple[str, ...]], ...] = (
        ("supply of the motors cut", "off", "FAULT", 2.3, (), ()),
        ("wheels jammed", "stuck", "FAULT", 2.0, (), ()),
        ("encoders count backwards", "wrong", "FAULT", 1.3, (), ()),
        ("no bytes either way", "dropped", "CUT", driver_s + 0.1, (), ()),
        ("commands lost", "dropped", "CUT", cut_s + 0.2, ("commands",), ()),
        ("one bit in 8 bytes", "corrupted", "CUT", 0.6, (), ()),
        ("port unplugged", "unplugged", "CUT", cut_s + 0.2, (), ("driver_fault", "driver_lost", "driver_silent")),
        ("supply sags", "brown-out", "FAULT", 0.6, (), ()),
    )
    rows = [
        Row("wheels", what, action, _line(kind, *directions), zero_s, speaks, family, turning=kind in SHOWN_BY_TURNING)
        for what, kind, action, zero_s, directions, speaks in bus
        for family in ("odrive", "roboclaw")
    ]
    rows.append(Row("wheels", "bus-off", "CUT", _line("bus-off"), cut_s + 0.1, (), "odrive"))
    for kind, value, single, zero_s, speaks in (
        ("occlusion", None, True, AGE_S + TURN_S, ("pose_invalid",)),
        ("absent", None, True, 0.2 + AGE_S, ("pose_invalid",)),
        ("swap", None, True, 0.2 + AGE_S, ("pose_invalid",)),
        ("frozen", None, True, 0.4, ("pose_invalid", "pose_stale")),
        ("not_finite", None, True, AGE_S + TURN_S, ("pose_invalid",)),
        ("denormal", 0.5, True, AGE_S + TURN_S, ("pose_invalid",)),
        ("tilt", 1.0, True, AGE_S + TURN_S, ("pose_invalid",)),
        ("marker_error", 0.05, True, AGE_S + TURN_S, ("pose_invalid",)),
        ("wrong_models", None, True, 0.3 + AGE_S, ("pose_invalid",)),
        ("silence", None, False, silence_s, ("pose_silent", "pose_stale")),
        ("drop", None, False, silence_s, ("pose_silent", "pose_stale")),
        ("truncated", 0.5, False, silence_s, ("pose_silent", "pose_stale")),
        ("burst", None, False, silence_s, ("pose_silent", "pose_stale")),
        ("restart", None, False, silence_s, ("pose_silent", "pose_stale")),
        ("late", 0.3, False, silence_s, ("pose_stale", "pose_silent", "pose_invalid")),
        ("millimetres", None, False, silence_s, ()),
        ("edit_mode", None, False, AGE_S + TURN_S, ("pose_invalid",)),
    ):
        resumes = kind == "restart"
        rows.append(Row("motion capture", kind, "HOLD", _mocap(kind, value, single), zero_s, speaks, resumes=resumes))
    rows.append(Row("motion capture", "jump", "FAULT", _jump, 0.2 + AGE_S, ("pose_jumped",)))
    for kind, value in (
        ("duplicate", None),
        ("reorder", None),
        ("deaf", None),
        ("clock_drift", 50.0),
    ):
        rows.append(Row("motion capture", kind, "goes on", _mocap(kind, value)))
    rows += [
        Row("datagrams", "one bit", "HOLD", _datagram(_flip), silence_s, ("pose_silent", "pose_stale")),
        Row("messages", "one bit", "HOLD", _message(_flip), silence_s, ("pose_silent", "pose_stale")),
        Row(
            "radio", "robot off the network", "HOLD", _offline, silence_s, ("pose_silent", "pose_stale", "station_lost")
        ),
        Row("station", "killed", "STOP", _station_gone, 0.5 + TURN_S + 0.07, ("station_silent", "station_lost")),
        Row("station", "STOP", "STOP", _stop, 0.05),
        Row("station", "another arena file", "FAULT", _heartbeat(schema_version=1, arena_hash="0" * 12), 0.1),
        Row("station", "another schema", "FAULT", _heartbeat(schema_version=99), 0.1, ("station_mismatch",)),
        Row("process", "hung", "CUT", _hang, cut_s),
        Row("process", "a second one with the same id", "FAULT", _twin, AGE_S + TURN_S, ("duplicate_id",)),
    ]
    runaway = ("driver_fault", "motion_mismatch")
    lost, corrupted = _line("dropped", "telemetry"), _line("corrupted", "telemetry")
    for family in ("odrive", "roboclaw"):
        rows += [
            Row("wheels", "encoders stand still", "named", _line("frozen"), None, runaway, family, leaves="fault"),
            Row("wheels", "port takes no bytes", "CUT", _line("jammed"), cut_s + 0.2, (), family),
            Row("wheels", "bytes late by 0.3 s", "FAULT", _line("delayed", delay_s=LATE_S), 0.6, (), family),
            Row("wheels", "telemetry lost", "HOLD", lost, driver_s + 0.1, (), family, leaves="fault"),
            Row("wheels", "telemetry corrupted", "FAULT", corrupted, driver_s + LOOK_S, (), family),
            Row("wheels", "firmware hung", "named", _line("hung"), None, ("driver_silent", "driver_lost"), family),
        ]
    silent = ("pose_silent", "pose_stale", "station_silent", "station_lost")
    rows += [
        Row("nothing", "no fault at all", "goes on", lambda world, victim: None),
        Row("radio", "everything late by 0.3 s", "HOLD", _late, silence_s, silent),
        Row("radio", "router lost", "HOLD", _router_gone, silence_s, silent),
        Row("process", "hung for half a second", "CUT", _pause, cut_s, ("driver_fault", "loop_overrun")),
        Row("process", "killed and restarted", "CUT", _restart, cut_s, leaves="disarmed"),
        Row("clock", "robot's steps 0.3 s ahead", "HOLD", _clock(0.3), TURN_S, ("pose_stale",)),
        Row("clock", "robot's steps 0.15 s back", "HOLD", _clock(-0.15), AGE_S + TURN_S, ("pose_ahead",)),
        Row(
            "clock",
            "robot's steps 10 s ahead",
            "FAULT",
            _clock(10.0),
            TURN_S,
            ("driver_fault", "driver_lost", "station_lost"),
            leaves="fault stopped",
        ),
        Row("clock", "robot's steps 1 s back", "HOLD", _clock(-1.0), AGE_S + TURN_S, ("pose_ahead",)),
    ]
    return tuple(rows)


ROWS: tuple[Row, ...] = _rows()

"""What crosses a boundary: one Struct a message, bounds and units in the types.

Units, frames and the time base are those of :mod:`contract.units`. Fields at their default are
left off the wire; an unknown field is an error. The sender's identity is the key it writes to
(access-checked); an ``robot`` field that differs from the key is refused by the receiver.
"""

from typing import Annotated, Literal

from msgspec import Meta, Struct

from contract.units import (
    Count,
    Distance,
    Index,
    Metres,
    Name,
    Nanoseconds,
    Point,
    Radians,
    RobotName,
    Speed,
    Text,
    TurnRate,
    Volts,
)

SCHEMA_VERSION = 2
"""Raised by one with every change that an older peer would misread; compared at session start."""
TOOK_OVER = "another station took over"
"""Why a robot with power is disarmed when a station starts again; nothing that has to be mended."""


class Message(Struct, frozen=True, kw_only=True, omit_defaults=True, forbid_unknown_fields=True):
    """Base of every message."""


# --- mocap bridge -> everyone -------------------------------------------------------------------


class BodyPose(Message, frozen=True, kw_only=True, gc=False):
    """One rigid body of a frame; ``valid`` false keeps the last coordinates and names the reason."""

    robot: RobotName
    x_m: Metres
    y_m: Metres
    heading_rad: Radians
    valid: bool = True
    reason: Name = ""
    resets: Count = 0
    """Times this body was re-acquired after a rejection; a change means the pose may have jumped."""


class MocapFrame(Message, frozen=True, kw_only=True):
    """The whole frame, all mapped bodies: both ends of a link act on the same frame number."""

    session: Count
    """Changes whenever the source restarts; frame numbers compare only within one session."""
    frame: Count
    exposure_ns: Nanoseconds
    """Middle of the camera exposure."""
    transmit_ns: Nanoseconds
    """When the source sent the datagram."""
    publish_ns: Nanoseconds
    """When the bridge put this message."""
    rate_hz: Annotated[float, Meta(ge=0.0, le=2000.0)]
    """Measured frame rate of the source."""
    bodies: tuple[BodyPose, ...]


class ExternalBody(Message, frozen=True, kw_only=True):
    """One body as another positioning system sees it, in the arena frame."""

    body: Annotated[str, Meta(min_length=1, max_length=64)]
    """Name as in ``robots.ID.body``."""
    x_m: Metres
    y_m: Metres
    z_m: Metres = 0.0
    heading_rad: Radians
    tracked: bool = True
    error_m: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    """How far off the system thinks it is; the checks refuse more than 10 mm."""


class ExternalFrame(Message, frozen=True, kw_only=True):
    """All bodies of one instant from a camera, UWB or any other system (``mocap.source = "external"``)."""

    seq: Count
    """Raised by one with every frame; a smaller number with a later stamp means the sender has restarted."""
    stamp_ns: Nanoseconds = 0
    """Site time of the measurement; 0 where the sender has no clock: time of arrival."""
    bodies: tuple[ExternalBody, ...]


class BodyHealth(Message, frozen=True, kw_only=True):
    """Why a body is not trusted, and how often each check fired."""

    robot: RobotName
    valid: bool
    reason: Name = ""
    faults: dict[str, Count] = {}


class MocapHealth(Message, frozen=True, kw_only=True):
    """State of the pose stream, once a second and on every change of ``state``."""

    stamp_ns: Nanoseconds
    state: Literal["connecting", "ok", "degraded", "stale", "lost", "refused"]
    detail: Text = ""
    """What is wrong and what to do about it, empty when ok."""
    source: Name = ""
    session: Count = 0
    frame: Count = 0
    rate_hz: float = 0.0
    nominal_rate_hz: float = 0.0
    frames_dropped: Count = 0
    malformed: Count = 0
    latency_ms: float = 0.0
    """Mid-exposure to publish, median of the last second."""
    clock_error_ms: float = 0.0
    counters: dict[str, Count] = {}
    bodies: tuple[BodyHealth, ...] = ()


# --- ground station -> robots -------------------------------------------------------------------


class Target(Message, frozen=True, kw_only=True):
    index: Index
    x_m: Metres
    y_m: Metres


class TargetCloud(Message, frozen=True, kw_only=True):
    """Every target of a mission. A robot sees only those within its sensing range of this cloud."""

    mission: Name
    seed: int = 0
    start_direction_rad: Radians = 0.0
    """Where the operator points the swarm before any target has been seen (section IV-B)."""
    targets: tuple[Target, ...]


Order = Literal["disarm", "arm", "run", "hold", "stop"]
"""What the station wants. ``stop`` acts by level; the others act once per ``order_id``."""

Request = Literal["disarm", "arm", "run", "hold", "repeat", "home", "exclude", "readmit"]
"""What an operator may ask of the station. ``repeat``: the same targets as a new mission; ``home``: every robot
to its start, then disarm; ``exclude`` and ``readmit``: robots named are no part of the network, or are again."""


class StationHeartbeat(Message, frozen=True, kw_only=True):
    """The station's will, repeated at 20 Hz; silence is a fault."""

    schema_version: int = 0
    boot: Count
    """Drawn afresh by each start of the station."""
    seq: Count
    stamp_ns: Nanoseconds
    order: Order
    order_id: Count
    """Raised with every new order; a robot obeys an order id once, so a reboot never re-arms."""
    robots: tuple[RobotName, ...] = ()
    """Addressees of the order; empty means all. ``stop`` always means all."""
    home: bool = False
    """With ``run``: drive to the start poses, links released, in place of the mission."""
    aside: dict[RobotName, Point] = {}
    """On the way home: where robots wait, m, that must let others pass first."""
    excluded: tuple[RobotName, ...] = ()
    """Robots taken out of the network: they stand still, the others keep no link to them."""
    mission: Name = ""
    arena_hash: Name = ""


class OrderRequest(Message, frozen=True, kw_only=True):
    """An operator's order from another terminal, to the station that runs the session.

    Never obeyed by a robot: only the station's heartbeat orders, only :class:`StopRequest` stops.
    """

    stamp_ns: Nanoseconds
    source: Name
    number: Count
    """Drawn afresh for every request; a repeated number is the same request."""
    order: Request
    robots: tuple[RobotName, ...] = ()
    """Addressees; empty means all."""
    station: Count = 0
    """Boot of the session it is meant for, as its heartbeats say: no other obeys it."""


class StopRequest(Message, frozen=True, kw_only=True):
    """STOP from anybody, repeated until every robot has acknowledged it; it latches."""

    stamp_ns: Nanoseconds
    source: Name
    stop_id: Count


# --- time -----------------------------------------------------------------------------------------


class ClockAsk(Message, frozen=True, kw_only=True):
    """What time is it on this site? Asked by everybody whose own clock does not keep it."""

    asked_ns: Nanoseconds
    """The asker's own monotonic clock."""


class ClockTell(Message, frozen=True, kw_only=True):
    """The motion-capture bridge's answer."""

    asked_ns: Nanoseconds
    """Of the question, as it came."""
    told_ns: Nanoseconds
    """Site time."""


# --- robot -> robots ------------------------------------------------------------------------------


class TransactionId(Message, frozen=True, kw_only=True):
    """A removal transaction: coordinator, its boot, and a number that never repeats in that boot."""

    coordinator: RobotName
    boot: Count
    number: Count


class LinkMessage(Message, frozen=True, kw_only=True):
    """One step of the link protocol (onboard/ahdc/links.py), addressed to one neighbour."""

    to: RobotName
    kind: Literal["lock", "nack", "yes", "commit", "abort", "ack", "inquire", "unknown", "add", "accept", "confirm"]
    tx: TransactionId | None = None
    path: tuple[RobotName, ...] = ()
    """Verified detour, coordinator first, the far end of the removed link last."""
    hop: Count = 0


class Help(Message, frozen=True, kw_only=True):
    """A tracker that makes no progress asks for a hand; the one with the shortest way left wins."""

    robot: RobotName
    hops: Annotated[int, Meta(ge=0, le=1000)]
    number: Count = 0
    left_m: Metres = 0.0
    """From the robot to its target when it first asked."""


class ToldClaim(Message, frozen=True, kw_only=True):
    """What a robot has heard of another's claim on a target, passed on."""

    robot: RobotName
    number: Count
    """Of the state message with which the robot last told its claim."""
    target: Annotated[int, Meta(ge=-1, le=9999)]
    """-1: it claims none."""
    left_m: Metres
    """From the robot to the target, a hold before it included at full speed."""
    hops: Annotated[int, Meta(ge=1, le=1000)]


class NeighbourState(Message, frozen=True, kw_only=True):
    """What a robot tells the robots within its radio range, every ``control.state_period_s``."""

    robot: RobotName
    boot: Count
    seq: Count
    stamp_ns: Nanoseconds
    """Time for which pose and stop points hold."""
    x_m: Metres
    y_m: Metres
    heading_rad: Radians
    vx_mps: Speed
    vy_mps: Speed
    stop_long: Point
    """Where it rests after this command for one period and then zero: the weakest brake."""
    stop_short: Point
    """The same with the strongest brake."""
    rims_mps: tuple[Speed, Speed] | None = None
    """Measured rim speeds, left and right."""
    asked_mps: tuple[Speed, Speed] | None = None
    """Rim speeds commanded: a robot that is cut off keeps them for a while."""
    moving: bool = True
    """False: wheels are held at zero and will not turn without a new state message."""
    mission: Name = ""
    """Of the cloud it knows. What it says of targets means that cloud and is nothing to robots of another mission."""
    task: Literal["free", "tracking", "occupied", "helping"] = "free"
    claim: Annotated[int, Meta(ge=-1, le=9999)] = -1
    """Target it goes for or sits on, -1 for none."""
    claim_at: Point | None = None
    claim_wait_s: Annotated[float, Meta(ge=0.0, le=3600.0)] = 0.0
    """Hold that remains before it sets out."""
    claims: tuple[ToldClaim, ...] = ()
    """Claims of other robots, as heard."""
    indicator: bool = False
    """It sees a target that it does not track itself (algorithm 2, line 11)."""
    hops: Annotated[int, Meta(ge=0, le=1000)] = 1000
    """Hops to the nearest indicator; 1000 for none known."""
    cloud_seen: bool = False
    """Somebody has seen a target: stop following the start direction."""
    occupied: str = ""
    """Flooded set of occupied targets: hexadecimal bitmap, bit k for target k."""
    sightings: tuple[Target, ...] = ()
    """Targets it remembers, when ``target_knowledge`` is shared."""
    help: Help | None = None
    links_on: tuple[RobotName, ...] = ()
    """Links it vouches for."""
    links_kept: tuple[RobotName, ...] = ()
    """Links it enforces but does not vouch for."""
    wishes: tuple[RobotName, ...] = ()
    """Links it would remove: its half of eq. 14's consent (``paper`` profile)."""
    mail: tuple[LinkMessage, ...] = ()


# --- robot -> station -----------------------------------------------------------------------------

RunState = Literal["disarmed", "armed", "running", "holding", "stopped", "fault"]


class LoopTiming(Message, frozen=True, kw_only=True):
    """The control loop over the last report period."""

    nominal_hz: float
    rate_hz: float
    jitter_ms: float
    """99th percentile of |interval - nominal|."""
    steps: Count
    misses: Count
    """Steps more than half a period late, and frames never stepped on, since the start."""


class RobotReport(Message, frozen=True, kw_only=True):
    """How a robot is, 10 Hz and at once when run state, order or stop change: what the station watches and records."""

    robot: RobotName
    boot: Count
    stamp_ns: Nanoseconds
    schema_version: int = 0
    software: Name = ""
    arena_hash: Name = ""
    run: RunState
    reason: Text = ""
    """Why it is not running, in words a person can act on."""
    remedy: Text = ""
    order_id: Count = 0
    """Last order obeyed."""
    stop_id: Count = 0
    """Last stop request obeyed."""
    stopped: bool = False
    """Wheel feedback is at rest and the driver is disabled or holds zero."""
    pose_age_ms: float = 0.0
    pose_valid: bool = False
    timing: LoopTiming | None = None
    battery_v: Volts | None = None
    motor_faults: tuple[Name, ...] = ()
    task: Name = ""
    claim: int = -1
    occupied_count: Count = 0
    neighbours: tuple[RobotName, ...] = ()
    links_on: tuple[RobotName, ...] = ()
    links_kept: tuple[RobotName, ...] = ()
    counters: dict[str, Count] = {}
    """Everything refused or lost so far, by name."""


class LinkState(Message, frozen=True, kw_only=True):
    """Edges a robot enforces and vouches for, as of one pose frame (recorded, drawn)."""

    other: RobotName
    state: Literal["on", "doubt", "leaving"]


class RobotStep(Message, frozen=True, kw_only=True):
    """One control step: what went in and what came out. Recorded, and enough to judge the step."""

    robot: RobotName
    frame: Count
    exposure_ns: Nanoseconds
    step_ns: Nanoseconds
    """Entry into the control law."""
    write_ns: Nanoseconds
    """Return of the bus write."""
    left_radps: TurnRate
    right_radps: TurnRate
    links: tuple[LinkState, ...] = ()
    task: Name = ""
    claim: int = -1
    waits: Name = ""
    """What bounds the motion: '', 'link', 'separation', 'fence', 'hold', 'help', 'free'."""


class StepBatch(Message, frozen=True, kw_only=True):
    """Control steps since the last batch: one message in place of a hundred a second."""

    robot: RobotName
    steps: tuple[RobotStep, ...]


InputKind = Literal[
    "frame", "state", "heartbeat", "stop", "targets", "feedback", "fault", "active", "step", "tick", "wrote", "outbox"
]
"""What an agent is given: messages, what its driver says, and the calls that make it act."""


class Input(Struct, frozen=True, array_like=True):
    """One thing an agent was given, named rather than repeated; with what is recorded elsewhere it can be replayed."""

    kind: InputKind
    after_ns: int
    """Site time given with it, less that of the one before."""
    word: str = ""
    """Sender of a state or stop, mission of a target cloud, text of a driver fault."""
    origin: int = 0
    """Session of a frame, boot of a state or heartbeat, stop_id of a stop."""
    number: int = 0
    """Frame number, seq, stamp_ns (stop, feedback), or 1 for active."""
    check: int = 0
    """CRC-32 of the payload, of frames and target clouds."""


class InputBatch(Message, frozen=True, kw_only=True):
    """Everything a robot's agent was given since the batch before, in order; the first since its start is number 0."""

    robot: RobotName
    boot: Count
    number: Count
    since_ns: Nanoseconds
    """Time before the first input."""
    inputs: tuple[Input, ...]


# --- wheels ---------------------------------------------------------------------------------------


class WheelFeedback(Message, frozen=True, kw_only=True):
    """What the motor controller measured."""

    robot: RobotName
    stamp_ns: Nanoseconds
    left_radps: TurnRate
    right_radps: TurnRate
    left_rad: float
    """Wheel angle since activation, unwrapped."""
    right_rad: float
    bus_v: Volts | None = None
    enabled: bool = False
    faults: tuple[Name, ...] = ()


class FeedbackBatch(Message, frozen=True, kw_only=True):
    robot: RobotName
    samples: tuple[WheelFeedback, ...]


class MotorSample(Message, frozen=True, kw_only=True):
    """A command as an emulated motor controller decoded it from its bytes."""

    stamp_ns: Nanoseconds
    left_radps: TurnRate
    right_radps: TurnRate
    enabled: bool
    released: bool = False
    """The device watchdog has let go of the motor: it coasts."""


class MotorBatch(Message, frozen=True, kw_only=True):
    """Commands decoded since the last batch, and where the emulated body really is."""

    robot: RobotName
    samples: tuple[MotorSample, ...]
    true_ns: Nanoseconds
    true_x_m: Metres
    true_y_m: Metres
    true_heading_rad: Radians
    true_speed_mps: Speed
    counters: dict[str, Count] = {}
    """Bytes and frames the emulated controller refused, by name."""


# --- session --------------------------------------------------------------------------------------


class RunStatus(Message, frozen=True, kw_only=True):
    """The mission as the station sees it, 10 Hz."""

    stamp_ns: Nanoseconds
    mission: Name = ""
    phase: Literal["waiting", "ready", "armed", "running", "homing", "completed", "stopped", "failed"]
    detail: Text = ""
    elapsed_s: float = 0.0
    targets: Count = 0
    occupied: tuple[Index, ...] = ()
    """Targets done, in the order they were occupied."""
    lambda2: float = 0.0
    components: Count = 0
    min_distance_m: Distance = 0.0
    excluded: tuple[RobotName, ...] = ()
    """Taken out of the network by the operator; the mission goes on without them."""


class LogEntry(Message, frozen=True, kw_only=True):
    stamp_ns: Nanoseconds
    level: Literal["debug", "info", "warning", "error"]
    source: Name
    event: Name
    text: Text = ""
    fields: dict[str, str | int | float | bool | None] = {}

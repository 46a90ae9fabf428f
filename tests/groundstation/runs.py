"""A made-up run whose every number can be worked out by hand: robots on straight lines, messages and recording."""

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from time import monotonic, sleep

from contract.arena import Arena, Control, Floor, Robot, Targets
from contract.keys import Keys
from contract.messages import (
    BodyPose,
    LinkState,
    LogEntry,
    Message,
    MocapFrame,
    MocapHealth,
    MotorBatch,
    MotorSample,
    NeighbourState,
    RobotReport,
    RobotStep,
    RunStatus,
    StepBatch,
    Target,
    TargetCloud,
)
from groundstation.recorder import Tape
from groundstation.rig import write_config

MS = 1_000_000
START_NS = 5_000_000_000
PERIOD_NS = 10 * MS
TRANSMIT_NS = 2 * MS
"""Exposure to datagram."""
STEP_NS = 4 * MS
"""Exposure to control step."""
DECODED_NS = 5 * MS
"""Exposure to the emulated motor's decoded command: 3 ms after the datagram."""

Sent = tuple[str, Message, int]
"""Key, message, time of arrival."""
Place = Callable[[int, int], tuple[float, float]]
"""Position (m) of robot i at frame k."""


def arena_of(robots: int = 3, targets: int = 2, profile: str = "field") -> Arena:
    """Robots r01, r02, ... 0.5 m apart; 100 Hz."""
    return Arena(
        arena=Floor(name="made", size_m=(4.0, 5.0)),
        robots={
            f"r{i + 1:02d}": Robot(body=f"b{i}", start=(0.5 + 0.5 * i, 0.5), wheels={"kind": "odrive"})
            for i in range(robots)
        },
        control=Control(profile=profile),  # type: ignore[arg-type]
        targets=Targets(count=targets, seed=42),
    )


def northward(i: int, k: int) -> tuple[float, float]:
    """Side by side 0.5 m apart, 8 mm a frame."""
    return 0.5 + 0.5 * i, 0.5 + 0.008 * k


def chain(robots: int) -> dict[int, set[int]]:
    """Links of robots in a row."""
    return {i: {j for j in (i - 1, i + 1) if 0 <= j < robots} for i in range(robots)}


def mission(
    arena: Arena,
    frames: int = 100,
    place: Place = northward,
    links: Callable[[int], dict[int, set[int]]] | None = None,
    skip: frozenset[int] = frozenset(),
    ending: str = "completed",
    motors: bool = True,
    every: int = 20,
) -> list[Sent]:
    """Everything said in a mission of ``frames`` frames; ``skip`` are frame numbers that got lost.

    Target m is at robot m's place in frame every(m+1), where that robot reports it occupied.
    """
    keys, names = Keys(arena.arena.name), list(arena.robots)
    n = len(names)
    cloud = TargetCloud(
        mission="made",
        seed=42,
        targets=tuple(
            Target(index=m, x_m=place(m % n, every * (m + 1))[0], y_m=place(m % n, every * (m + 1))[1])
            for m in range(arena.targets.count)
        ),
    )
    sent: list[Sent] = [(keys.targets, cloud, START_NS - 50 * MS)]

    def status(phase: str, at_ns: int) -> None:
        elapsed_s = (at_ns - START_NS) / 1e9 if phase != "ready" else 0.0
        message = RunStatus(stamp_ns=at_ns, phase=phase, elapsed_s=elapsed_s, targets=len(cloud.targets))  # type: ignore[arg-type]
        sent.append((keys.status, message, at_ns))

    def health(at_ns: int, dropped: int) -> None:
        sent.append((keys.mocap_health, MocapHealth(stamp_ns=at_ns, state="ok", frames_dropped=dropped), at_ns))

    health(START_NS - 40 * MS, 3)
    status("ready", START_NS - 30 * MS)
    status("running", START_NS)
    occupied = 0
    for k in range(frames):
        exposure_ns = START_NS + k * PERIOD_NS
        if k in skip:
            continue
        places = [place(i, k) for i in range(n)]
        sent.append((keys.mocap_frame, _frame(k, exposure_ns, names, places), exposure_ns + 3 * MS))
        edges = links(k) if links else chain(n)
        for i, name in enumerate(names):
            step = RobotStep(
                robot=name,
                frame=k,
                exposure_ns=exposure_ns,
                step_ns=exposure_ns + STEP_NS,
                write_ns=exposure_ns + STEP_NS + MS // 2,
                left_radps=1.0,
                right_radps=1.0,
                links=tuple(LinkState(other=names[j], state="on") for j in sorted(edges[i])),
                task="tracking",
                waits="link" if k < frames // 2 else "",
            )
            sent.append((keys.steps(name), StepBatch(robot=name, steps=(step,)), exposure_ns + 6 * MS))
            if motors:
                sent.append((keys.motor(name), _motor(name, exposure_ns, places[i]), exposure_ns + 6 * MS))
        for m in range(len(cloud.targets)):
            if k == every * (m + 1):
                occupied |= 1 << m
                state = _state(names[m % n], exposure_ns + 7 * MS, occupied)
                sent.append((keys.state(names[m % n]), state, exposure_ns + 8 * MS))
        if k % 10 == 0:
            sent += [(keys.report(name), _report(name, exposure_ns), exposure_ns + 9 * MS) for name in names]
    end_ns = START_NS + frames * PERIOD_NS
    health(end_ns - MS, 3 + len(skip))
    warning = LogEntry(stamp_ns=end_ns - 2 * MS, level="warning", source="r01", event="test", text="a <warning>")
    sent.append((keys.log("r01"), warning, end_ns - 2 * MS))
    if ending:
        status(ending, end_ns)
    return sent


def _frame(k: int, exposure_ns: int, names: list[str], places: list[tuple[float, float]]) -> MocapFrame:
    return MocapFrame(
        session=1,
        frame=k,
        exposure_ns=exposure_ns,
        transmit_ns=exposure_ns + TRANSMIT_NS,
        publish_ns=exposure_ns + 3 * MS,
        rate_hz=100.0,
        bodies=tuple(
            BodyPose(robot=name, x_m=x, y_m=y, heading_rad=1.5) for name, (x, y) in zip(names, places, strict=True)
        ),
    )


def _motor(name: str, exposure_ns: int, place: tuple[float, float]) -> MotorBatch:
    sample = MotorSample(stamp_ns=exposure_ns + DECODED_NS, left_radps=1.0, right_radps=1.0, enabled=True)
    return MotorBatch(
        robot=name,
        samples=(sample,),
        true_ns=exposure_ns,
        true_x_m=place[0],
        true_y_m=place[1],
        true_heading_rad=1.5,
        true_speed_mps=0.8,
    )


def _state(name: str, stamp_ns: int, occupied: int) -> NeighbourState:
    return NeighbourState(
        robot=name,
        boot=1,
        seq=1,
        stamp_ns=stamp_ns,
        x_m=0.0,
        y_m=0.0,
        heading_rad=0.0,
        vx_mps=0.0,
        vy_mps=0.0,
        stop_long=(0.0, 0.0),
        stop_short=(0.0, 0.0),
        task="occupied",
        occupied=f"{occupied:x}",
    )


def _report(name: str, stamp_ns: int) -> RobotReport:
    return RobotReport(robot=name, boot=1, stamp_ns=stamp_ns, run="running", pose_age_ms=5.0, pose_valid=True)


def record(folder: Path, arena: Arena, sent: Iterable[Sent], commit_every: int = 200) -> Path:
    """Write a run folder's recording through the recorder's own tape."""
    from contract.codec import encode

    folder.mkdir(parents=True, exist_ok=True)
    write_config(arena, folder / "config.toml")
    path = folder / "run.mcap"
    tape = Tape(path, arena, (folder / "config.toml").read_bytes())
    for count, (key, message, log_ns) in enumerate(sent, 1):
        tape.write([(key, encode(message), log_ns)])
        if count % commit_every == 0:
            tape.commit()
    tape.close(dropped=0)
    assert not tape.trouble
    return path


def until(done: Callable[[], bool], what: str, timeout_s: float = 30.0) -> None:
    """Poll a condition; AssertionError naming it when it does not come true."""
    deadline = monotonic() + timeout_s
    while not done():
        assert monotonic() < deadline, f"not within {timeout_s:g} s: {what}"
        os.sched_yield()
        sleep(0.01)

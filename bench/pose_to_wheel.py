"""Datagram sent to wheel bytes decoded: the whole chain against the bare one, in alternating blocks of one run.

Both arenas have the same processes and hops; the bare one (``bare_chain.py``) has neither JSON, law nor feedback.
They are started in turn, so that neither costs the other anything.
Machine noise falls on both, so the ratio of neighbouring blocks is the figure to trust, not the milliseconds.

    python bench/pose_to_wheel.py --robots 6 --blocks 8 --json FILE
"""

import argparse
import json
import os
import statistics
import sys
import tempfile
import time
from bisect import bisect_left
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from contract.arena import Arena
from contract.messages import Message, MocapFrame, MotorBatch, RobotStep, StepBatch
from groundstation import rig
from groundstation.conduct import Conductor, new_session
from groundstation.course import Plan
from groundstation.link import Link
from groundstation.processes import Child
from groundstation.targets import cloud_of

BLOCK_S = 3.0
SETTLE_S = 1.0
STAGES = ("bridge", "network", "step_and_write", "bus_and_decode")
BARE = "bench.bare_chain"
ROOT = Path(__file__).resolve().parent.parent


class Passage(NamedTuple):
    """One frame's way to one robot's wheels: site time, ns, at every station."""

    sent_ns: int
    published_ns: int
    """The bridge is about to put it; the bare one does not say: as sent."""
    woken_ns: int
    """The robot's loop has it."""
    written_ns: int
    decoded_ns: int
    """The emulated motor has the command."""


class Listener:
    """Passages, from what one arena says.

    :param bare: its steps carry the frame's transmit stamp for the exposure, since no frame is told.
    """

    def __init__(self, bare: bool = False) -> None:
        self._bare = bare
        self._frames: dict[int, MocapFrame] = {}
        self._steps: list[RobotStep] = []
        self._decoded: dict[str, list[int]] = {}

    def receive(self, message: Message) -> None:
        if isinstance(message, MocapFrame):
            self._frames[message.frame] = message
        elif isinstance(message, StepBatch):
            self._steps += message.steps
        elif isinstance(message, MotorBatch):
            self._decoded.setdefault(message.robot, []).extend(sample.stamp_ns for sample in message.samples)

    def passages(self, first_ns: int, last_ns: int) -> list[Passage]:
        """Of the frames sent within the block."""
        found = []
        for step in self._steps:
            if self._bare:
                sent_ns = published_ns = step.exposure_ns
            elif step.frame in self._frames:
                frame = self._frames[step.frame]
                sent_ns, published_ns = frame.transmit_ns, frame.publish_ns
            else:
                continue
            decoded = self._decoded.get(step.robot, [])
            place = bisect_left(decoded, step.step_ns)
            if first_ns <= sent_ns <= last_ns and place < len(decoded):
                found.append(Passage(sent_ns, published_ns, step.step_ns, step.write_ns, decoded[place]))
        return found


class BareRig(rig.Rig):
    """An arena whose bridge and agents are those of :mod:`bench.bare_chain`."""

    def start(self, robots: Iterable[str] | None = None) -> None:
        """The hardware first: a bare agent opens its port once."""
        super().start([])
        for name in self.arena.robots if robots is None else robots:
            self.start_robot(name)
        self.family.wait_ready(rig.READY_S)

    def start_robot(self, name: str) -> Child:
        return self._child(name, BARE, "agent", "--robot", name)

    def start_one(self, name: str) -> Child:
        return self._child(name, BARE, "bridge") if name == "bridge" else super().start_one(name)


Block = tuple[list[Passage], list[Passage]]
"""Through the whole chain, through the bare one."""


def measure(robots: int, blocks: int) -> list[Block]:
    found = []
    for number in range(blocks):
        with tempfile.TemporaryDirectory() as folder:
            changes = rig.Changes(robots=robots, targets=50, seed=number + 1)
            out = Path(folder)
            full = whole(rig.mock_arena(rig.find_arena("experiment2"), out / "full", changes), out / "full")
            bare = stripped(rig.mock_arena(rig.find_arena("experiment2"), out / "bare", changes), out / "bare")
            found.append((full, bare))
        print(f"block {number + 1} of {blocks}", file=sys.stderr, flush=True)
    return found


def whole(arena: Arena, out: Path) -> list[Passage]:
    """A block of a mission under way."""
    cloud, heard = cloud_of(arena, "bench"), Listener()
    with rig.Rig(arena, out, record=False) as processes:
        processes.start()
        with Link(arena, "station") as link:
            listen(link, arena)
            session = new_session(arena, cloud, Plan(automatic=True), link)
            conductor = Conductor(arena, session, cloud, link)
            if not conductor.until(lambda: session.phase == "running", 30.0):
                raise RuntimeError(f"the robots do not start: {session.detail}")
            turn(conductor, SETTLE_S)
            conductor.listener = lambda message, _: heard.receive(message)
            first_ns, last_ns = time.monotonic_ns(), turn(conductor, BLOCK_S)
            turn(conductor, SETTLE_S)
    return heard.passages(first_ns, last_ns)


def stripped(arena: Arena, out: Path) -> list[Passage]:
    """A block of the bare chain, with a station beside it that does the same as the other's."""
    cloud, heard = cloud_of(arena, "bench"), Listener(bare=True)
    with BareRig(arena, out, record=False) as processes:
        processes.start()
        with Link(arena, "station") as link:
            listen(link, arena)
            conductor = Conductor(arena, new_session(arena, cloud, Plan(automatic=True), link), cloud, link)
            turn(conductor, SETTLE_S)
            conductor.listener = lambda message, _: heard.receive(message)
            first_ns, last_ns = time.monotonic_ns(), turn(conductor, BLOCK_S)
            turn(conductor, SETTLE_S)
    return heard.passages(first_ns, last_ns)


def listen(link: Link, arena: Arena) -> None:
    link.subscribe(key for name in arena.robots for key in (link.keys.steps(name), link.keys.motor(name)))


def turn(conductor: Conductor, seconds: float) -> int:
    """Keep the station going for so long; the site time then, ns."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        conductor.turn()
    return time.monotonic_ns()


def spread(values: "np.ndarray[Any, np.dtype[np.float64]]") -> dict[str, float]:
    names = (("p50", 50), ("p99", 99), ("max", 100))
    return {name: round(float(np.percentile(values, q)), 1) for name, q in names}


def judge(blocks: list[Block]) -> dict[str, Any]:
    """Pooled percentiles in us, where the time goes, and the medians over blocks of the ratios of percentiles."""
    times = [tuple(np.array(side, dtype=float).reshape(-1, 5) / 1e3 for side in block) for block in blocks]
    full, bare = (np.concatenate([block[side] for block in times]) for side in (0, 1))

    def latency(passages: "np.ndarray[Any, np.dtype[np.float64]]") -> "np.ndarray[Any, np.dtype[np.float64]]":
        return passages[:, 4] - passages[:, 0]

    def paired(q: int) -> float:
        ratios = [np.percentile(latency(a), q) / np.percentile(latency(b), q) for a, b in times if len(a) and len(b)]
        return round(float(statistics.median(ratios)), 3)

    def stages(passages: "np.ndarray[Any, np.dtype[np.float64]]") -> dict[str, float]:
        return dict(zip(STAGES, np.median(np.diff(passages), axis=0).round(1).tolist(), strict=True))

    return {
        "full_us": spread(latency(full)),
        "full_stages_p50_us": stages(full),
        "bare_us": spread(latency(bare)),
        "bare_stages_p50_us": stages(bare),
        "paired_p50": paired(50),
        "paired_p99": paired(99),
        "blocks": len(blocks),
        "samples": [len(full), len(bare)],
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--blocks", type=int, default=8, help="about 20 s each (default 8)")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument(
        "--gate", action="store_true", help="exit code 1 above 2.0 (p50) or 2.5 (p99) times the bare chain"
    )
    args = parser.parse_args()
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    result = judge(measure(args.robots, args.blocks))
    text = json.dumps(result, indent=2)
    print(text)
    if args.json:
        args.json.write_text(text + "\n")
    return int(args.gate and (result["paired_p50"] > 2.0 or result["paired_p99"] > 2.5))


if __name__ == "__main__":
    sys.exit(main())

"""Datagram sent to wheel bytes decoded: the whole chain against the bare one, in alternating blocks of one run.

Both chains stand beside each other, the same number of processes and hops each; only one is driven at a time.
Machine noise falls on both, so the ratio of neighbouring blocks is the figure to trust, not the milliseconds.

    python bench/pose_to_wheel.py --robots 6 --blocks 12 --json FILE
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from bisect import bisect_left
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from contract.messages import Message, MocapFrame, MotorBatch, RobotStep, StepBatch
from groundstation import rig
from groundstation.conduct import Conductor, new_session
from groundstation.link import Link
from groundstation.mock_arena import FAULTS_FILE
from groundstation.session import Plan
from groundstation.targets import cloud_of

BLOCK_S = 1.0
SETTLE_S = 0.4
STAGES = ("bridge", "network", "step_and_write", "bus_and_decode")
BARE = Path(__file__).with_name("bare_chain.py")


class Passage(NamedTuple):
    """One frame's way to one robot's wheels: site time, ns, at every station."""

    sent_ns: int
    published_ns: int
    """The bridge has put it."""
    woken_ns: int
    """The robot's loop has it."""
    written_ns: int
    decoded_ns: int
    """The emulated motor has the command."""


class Full:
    """Passages through the whole chain, from what the swarm says."""

    def __init__(self) -> None:
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
            frame = self._frames.get(step.frame)
            decoded = self._decoded.get(step.robot, [])
            place = bisect_left(decoded, step.step_ns)
            if frame is not None and first_ns <= frame.transmit_ns <= last_ns and place < len(decoded):
                times = (frame.transmit_ns, frame.publish_ns, step.step_ns, step.write_ns, decoded[place])
                found.append(Passage(*times))
        return found


class Bare:
    """The bare chain's processes."""

    def __init__(self, robots: int, rate_hz: float, folder: Path) -> None:
        tcp, port, _ = rig.free_ports()
        endpoint = f"tcp/127.0.0.1:{tcp}"
        roles = [["hardware", str(port), str(rate_hz), str(folder), str(robots)], ["bridge", endpoint, str(port)]]
        roles += [["agent", endpoint, str(folder / str(number))] for number in range(robots)]
        self._processes: list[subprocess.Popen[str]] = []
        for role in roles:
            process = subprocess.Popen(
                [sys.executable, str(BARE), *role], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
            self._processes.append(process)
            if role[0] != "agent":
                pipe(process.stdout).readline()
        for process in self._processes[2:]:
            pipe(process.stdout).readline()

    def tell(self, word: str) -> None:
        stdin = pipe(self._processes[0].stdin)
        stdin.write(word + "\n")
        stdin.flush()

    def latencies(self) -> list[int]:
        self.tell("off")
        found: list[int] = json.loads(pipe(self._processes[0].stdout).readline())
        return found

    def end(self) -> None:
        for process in self._processes:
            process.kill()
            process.wait()


def pipe(stream: IO[str] | None) -> IO[str]:
    if stream is None:
        raise RuntimeError("no pipe")
    return stream


Block = tuple[list[Passage], list[int]]
"""Of the whole chain; latencies of the bare one, ns."""


def measure(robots: int, blocks: int) -> list[Block]:
    with tempfile.TemporaryDirectory() as folder:
        out, ptys = Path(folder) / "run", Path(folder) / "bare"
        ptys.mkdir()
        changes = rig.Changes(robots=robots, targets=50, seed=1)
        arena = rig.mock_arena(rig.find_arena("experiment2"), out, changes)
        cloud = cloud_of(arena, "bench")
        bare = Bare(robots, arena.mocap.frame_rate_hz, ptys)
        try:
            with rig.Rig(arena, out, record=False) as processes:
                processes.start()
                with Link(arena, "station") as link:
                    link.subscribe(
                        key for name in arena.robots for key in (link.keys.steps(name), link.keys.motor(name))
                    )
                    session = new_session(arena, cloud, Plan(automatic=True))
                    conductor = Conductor(arena, session, cloud, link)
                    if not conductor.until(lambda: session.phase == "running", 30.0):
                        raise RuntimeError(f"the robots do not start: {session.detail}")
                    return [block(conductor, bare, out / FAULTS_FILE) for _ in range(blocks)]
        finally:
            bare.end()


def block(conductor: Conductor, bare: Bare, faults: Path) -> Block:
    full = Full()
    faults.write_text("")
    turn(conductor, SETTLE_S)
    conductor.listener = lambda message, _: full.receive(message)
    first_ns = time.monotonic_ns()
    turn(conductor, BLOCK_S)
    last_ns = time.monotonic_ns()
    turn(conductor, SETTLE_S)
    conductor.listener = None
    faults.write_text("udp dropped\n")
    turn(conductor, SETTLE_S)
    bare.tell("on")
    turn(conductor, BLOCK_S)
    return full.passages(first_ns, last_ns), bare.latencies()


def turn(conductor: Conductor, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        conductor.turn()


def judge(blocks: list[Block]) -> dict[str, Any]:
    """Pooled percentiles in us, the medians over blocks of the ratios of percentiles, and where the time goes."""
    pairs = [([way.decoded_ns - way.sent_ns for way in passages], bare) for passages, bare in blocks]
    full, bare = ([value / 1e3 for pair in pairs for value in pair[side]] for side in (0, 1))
    ways = np.diff(np.array([way for passages, _ in blocks for way in passages]), axis=1) / 1e3

    def spread(values: list[float]) -> dict[str, float]:
        return {name: round(float(np.percentile(values, q)), 1) for name, q in (("p50", 50), ("p99", 99), ("max", 100))}

    def paired(q: int) -> float:
        ratios = [float(np.percentile(a, q) / np.percentile(b, q)) for a, b in pairs if a and b]
        return round(statistics.median(ratios), 3)

    return {
        "full_us": spread(full),
        "stages_p50_us": dict(zip(STAGES, np.median(ways, axis=0).round(1).tolist(), strict=True)),
        "bare_us": spread(bare),
        "paired_p50": paired(50),
        "paired_p99": paired(99),
        "blocks": len(pairs),
        "samples": [len(full), len(bare)],
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--blocks", type=int, default=12)
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument(
        "--gate", action="store_true", help="exit code 1 above 2.0 (p50) or 2.5 (p99) times the bare chain"
    )
    args = parser.parse_args()
    result = judge(measure(args.robots, args.blocks))
    text = json.dumps(result, indent=2)
    print(text)
    if args.json:
        args.json.write_text(text + "\n")
    return int(args.gate and (result["paired_p50"] > 2.0 or result["paired_p99"] > 2.5))


if __name__ == "__main__":
    sys.exit(main())

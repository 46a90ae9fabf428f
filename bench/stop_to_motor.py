"""STOP published to zero decoded by every emulated motor, in the real-time rig, a few stops in one run.

Between stops the swarm is released, armed and started again. A stop's time ends, for each robot, with the first zero
setpoint its emulated controller decoded after the request was published and before which no motion follows; the
acknowledgement is the report that carries the stop's number.

    python bench/stop_to_motor.py --robots 6 --stops 8 --json FILE
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from contract.messages import Message, MotorBatch, MotorSample, RobotReport, StopRequest
from groundstation import rig
from groundstation.conduct import Conductor, new_session
from groundstation.link import Link
from groundstation.session import Plan
from groundstation.targets import cloud_of

PATIENCE_S = 20.0
SETTLE_S = 0.3
MOVING_MPS = 0.05


class Watcher:
    """What the motors decoded, and who has acknowledged which stop when."""

    def __init__(self) -> None:
        self.samples: dict[str, list[MotorSample]] = {}
        self.speeds: dict[str, float] = {}
        self.acknowledged_ns: dict[tuple[str, int], int] = {}

    def receive(self, message: Message, now_ns: int) -> None:
        if isinstance(message, MotorBatch):
            self.samples.setdefault(message.robot, []).extend(message.samples)
            self.speeds[message.robot] = abs(message.true_speed_mps)
        elif isinstance(message, RobotReport) and message.stop_id:
            self.acknowledged_ns.setdefault((message.robot, message.stop_id), now_ns)

    def zero_ns(self, robot: str, since_ns: int) -> int | None:
        """When the last stretch of zeros after ``since_ns`` began; None: it had none."""
        began = None
        for sample in self.samples.get(robot, []):
            if sample.stamp_ns < since_ns:
                continue
            if sample.left_radps or sample.right_radps:
                began = None
            elif began is None:
                began = sample.stamp_ns
        return began


class Bench:
    """The running arena, its station in this process."""

    def __init__(self, processes: rig.Rig, link: Link) -> None:
        arena = processes.arena
        cloud = cloud_of(arena, "stops")
        self.arena, self.link, self.family = arena, link, processes.family
        self.session = new_session(arena, cloud, Plan())
        self.conductor = Conductor(arena, self.session, cloud, link)
        self.watcher = Watcher()
        link.subscribe(link.keys.motor(name) for name in arena.robots)
        self.conductor.listener = lambda message, _: self.watcher.receive(message, time.monotonic_ns())

    def until(self, done: Callable[[], bool], what: str) -> None:
        def checked() -> bool:
            self.family.check()
            return done()

        if not self.conductor.until(checked, PATIENCE_S):
            raise SystemExit(f"not within {PATIENCE_S:g} s: {what}; {self.session.phase}: {self.session.detail}")

    def round(self, stop_id: int) -> tuple[list[float], list[float]]:
        """(motor zero, acknowledgement) in ms after one STOP, of every robot that was moving."""
        session, watcher = self.session, self.watcher
        session.order("disarm", time.monotonic_ns())
        self.until(lambda: session.phase == "ready", "ready")
        session.order("arm", time.monotonic_ns())
        self.until(lambda: session.phase == "armed", "armed")
        session.order("run", time.monotonic_ns())
        most = len(self.arena.robots) // 2 or 1
        self.until(lambda: sum(speed > MOVING_MPS for speed in watcher.speeds.values()) >= most, "half the swarm moves")
        for samples in watcher.samples.values():
            samples.clear()
        stop_ns = time.monotonic_ns()
        self.link.publish(self.link.keys.stop, StopRequest(stamp_ns=stop_ns, source="bench", stop_id=stop_id), "stop")
        self.until(lambda: session.at_rest and session.phase == "stopped", "at rest")
        self.conductor.until(lambda: False, SETTLE_S)
        zeros, answers = [], []
        for name in self.arena.robots:
            zero_ns = watcher.zero_ns(name, stop_ns)
            if zero_ns is None:
                raise SystemExit(f"{name} never heard a zero after stop {stop_id}")
            zeros.append((zero_ns - stop_ns) * 1e-6)
            answers.append((watcher.acknowledged_ns[name, stop_id] - stop_ns) * 1e-6)
        return zeros, answers


def figures(values: list[float]) -> dict[str, float]:
    ordered = sorted(values)
    return {
        "count": len(ordered),
        "p50_ms": round(statistics.median(ordered), 2),
        "p99_ms": round(ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))], 2),
        "max_ms": round(ordered[-1], 2),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--stops", type=int, default=8)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    zeros: list[float] = []
    answers: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        arena = rig.mock_arena(rig.find_arena("experiment2"), out, rig.Changes(args.robots, 60, 1))
        with rig.Rig(arena, out, record=False) as processes:
            processes.start()
            with Link(arena, "station") as link:
                bench = Bench(processes, link)
                for stop_id in range(1, args.stops + 1):
                    motor_ms, answer_ms = bench.round(stop_id)
                    zeros += motor_ms
                    answers += answer_ms
                    print(f"stop {stop_id}: motors {max(motor_ms):.1f} ms, answers {max(answer_ms):.1f} ms", flush=True)
    result = {"robots": args.robots, "stops": args.stops, "motor_zero": figures(zeros), "answer": figures(answers)}
    print(json.dumps(result, indent=2))
    if args.json:
        args.json.write_text(json.dumps(result, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

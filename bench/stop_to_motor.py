"""STOP published to zero decoded by every emulated motor, in the real-time rig, a few stops in one run.

Between stops the swarm is released, armed and started again. A stop's time ends, for each robot, with the first zero
setpoint its emulated controller decoded after the request was published and before which no motion follows; the
acknowledgement is the report that carries the stop's number.

    python bench/stop_to_motor.py --robots 6 --stops 8 --json FILE
"""

import argparse
import json
import math
import sys
import tempfile
from pathlib import Path

from groundstation import rig
from groundstation.faultpage import percentiles
from groundstation.faultrig import Stage
from groundstation.link import Link
from groundstation.stoptimes import stops


def figures(values: list[float]) -> dict[str, float]:
    p50, p99, most = percentiles(values) or (math.nan,) * 3
    return {"count": len(values), "p50_ms": round(p50, 2), "p99_ms": round(p99, 2), "max_ms": round(most, 2)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--stops", type=int, default=8)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    zeros: list[float] = []
    answers: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        arena = rig.mock_arena(rig.find_arena("experiment2"), out, rig.Changes(args.robots, 60, 1))
        with rig.Rig(arena, out, record=False) as processes:
            processes.start()
            with Link(arena, "station") as link:
                for number, (motor_ms, answer_ms) in enumerate(
                    stops(Stage(processes, link), Stage.stop, args.stops), 1
                ):
                    zeros += motor_ms
                    answers += answer_ms
                    print(f"stop {number}: motors {max(motor_ms):.1f} ms, answers {max(answer_ms):.1f} ms", flush=True)
    result = {"robots": args.robots, "stops": args.stops, "motor_zero": figures(zeros), "answer": figures(answers)}
    print(json.dumps(result, indent=2))
    if args.json:
        args.json.write_text(json.dumps(result, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Home to starts too near to each other to pass between, in real processes: by waves, the innermost first."""

import math
import re
from pathlib import Path

from contract.messages import Message, StationHeartbeat
from groundstation import rig
from groundstation.homeward import timeout_s
from groundstation.parking import waves_of
from tests.arena.conftest import Running

GAP_M = 0.3
STARTS = {"r06": (0.35, 0.35), "r08": (0.35 + GAP_M, 0.35), "r09": (0.35, 0.35 + GAP_M), "r11": (0.35 + GAP_M,) * 2}
COLLISION_M = 0.14
PATIENCE_S = 150.0
STALLS = 3
"""So often the proof goes on after this computer has stood still for longer than robots wait."""
ENDED = ("completed", "stopped", "failed")


def dense(folder: Path) -> Path:
    """The example arena with its first four robots alone, their starts in a block whose gaps nobody passes."""
    text, _, _ = rig.find_arena("experiment2").read_text().partition("[robots.r13]")
    for name, (x, y) in STARTS.items():
        text, count = re.subn(
            rf"(\[robots\.{name}\].*?start = )\[[^]]*\]", rf"\g<1>[{x:.2f}, {y:.2f}]", text, flags=re.S
        )
        assert count == 1
    path = folder / "dense.toml"
    path.write_text(text)
    return path


class Dense(Running):
    """Notes who was on the way, who waited aside, and how near two came."""

    def __init__(self, out: Path, arena: Path) -> None:
        super().__init__(out, robots=4, targets=4, arena=str(arena))
        self.aside: list[frozenset[str]] = []
        self.nearest_m = math.inf

    def __enter__(self) -> "Dense":
        super().__enter__()
        self.watcher.subscribe([self.watcher.keys.heartbeat])
        return self

    def _note(self, message: Message) -> None:
        super()._note(message)
        if isinstance(message, StationHeartbeat):
            waiting = frozenset(message.aside)
            if waiting and (not self.aside or self.aside[-1] != waiting):
                self.aside.append(waiting)

    def turn(self) -> None:
        super().turn()
        places = [(batch.true_x_m, batch.true_y_m) for batch in self.motors.values()]
        for k, place in enumerate(places):
            for other in places[k + 1 :]:
                self.nearest_m = min(self.nearest_m, math.dist(place, other))

    def spread(self) -> None:
        """Into a mission until every robot is away from its start, then still and without power."""
        starts = {name: robot.start for name, robot in self.arena.robots.items()}

        def away() -> bool:
            places = {name: (batch.true_x_m, batch.true_y_m) for name, batch in self.motors.items()}
            return len(places) == len(starts) and all(math.dist(places[n], starts[n]) > 0.4 for n in starts)

        self.until(lambda: away() or self.session.phase in ENDED, "all are away from their starts", PATIENCE_S)
        self.lie_still()
        assert away()

    def lie_still(self) -> None:
        self.session.order("disarm", self.link.now_ns())
        self.until(self.at_rest, "all at rest")
        self.until(lambda: {report.run for report in self.reports.values()} == {"disarmed"}, "all are disarmed")

    def home(self) -> str:
        """The way home, taken again where this computer stood still too long for the robots; what was said last."""
        words = ""
        for _ in range(STALLS):
            command = self.command("home", "--arena", str(self.rig.config))
            self.until(lambda command=command: command.poll() is not None, "an answer", timeout_s(self.arena) + 30.0)
            words = command.stdout.read() if command.stdout else ""
            if command.returncode == 0 or not re.search("heartbeat|watchdog|loop|pose", words):
                break
            print(f"this computer stood still: {words}")
            self.lie_still()
        return words


def test_a_block_is_filled_wave_after_wave(tmp_path: Path) -> None:
    with Dense(tmp_path / "out", dense(tmp_path)) as four:
        steps = waves_of(four.arena)
        assert len(steps) > 1
        four.spread()
        four.nearest_m = math.inf
        words = four.home()
        assert "all 4 robots at home" in words, words
        for name, (x, y) in STARTS.items():
            batch = four.motors[name]
            assert math.dist((batch.true_x_m, batch.true_y_m), (x, y)) < 0.05, name
    print({"waves": [sorted(step) for step in steps], "waited": [sorted(names) for names in four.aside],
           "nearest_m": round(four.nearest_m, 3)})  # fmt: skip
    assert four.aside, "later waves were sent aside"
    assert four.nearest_m > COLLISION_M

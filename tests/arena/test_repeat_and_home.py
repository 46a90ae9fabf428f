"""Home, repeat and seed from another terminal, in a mock arena of processes; every run in a folder of its own."""

import math
from pathlib import Path

from groundstation.runfolder import read
from tests.arena.conftest import Running


def test_a_mission_home_and_the_mission_again(tmp_path: Path) -> None:
    out = tmp_path / "lab"
    with Running(out, robots=2, targets=3, record=True) as two:
        two.until(lambda: two.session.phase == "completed", "the first mission completed")
        home = two.command("home", "--arena", str(two.rig.config))
        two.until(lambda: home.poll() is not None, "all at home")
        words = home.stdout.read() if home.stdout else ""
        assert home.returncode == 0, words
        assert "all 2 robots at home" in words
        for name, robot in two.arena.robots.items():
            batch = two.motors[name]
            assert math.dist((batch.true_x_m, batch.true_y_m), robot.start) < 0.05
        two.until(lambda: {report.run for report in two.reports.values()} == {"disarmed"}, "all are disarmed")
        again = two.command("repeat", "--arena", str(two.rig.config))
        two.until(lambda: again.poll() is not None, "a new mission")
        assert again.returncode == 0
        assert two.session.cloud.mission == "test.2"
        two.until(lambda: two.session.phase == "ready", "ready")
        two.session.order("arm", two.link.now_ns())
        two.until(lambda: two.session.phase == "armed", "armed")
        two.session.order("run", two.link.now_ns())
        two.until(lambda: two.session.phase == "completed", "the second mission completed")
        two.until(lambda: two.session.at_rest, "all at rest")
        two.session.order("disarm", two.link.now_ns())
        seed = two.command("seed", "--points", "1.2,1.2", "1.6,1.4", "--arena", str(two.rig.config))
        two.until(lambda: seed.poll() is not None, "other targets")
        assert seed.returncode == 0
        assert [(target.x_m, target.y_m) for target in two.session.cloud.targets] == [(1.2, 1.2), (1.6, 1.4)]
    assert set(two.codes.values()) == {0}, two.codes
    for folder in (out, tmp_path / "lab-2"):
        run = read(folder)
        assert run.recording.whole
        assert run.metrics is not None
        assert (run.metrics.completed, run.metrics.occupied, run.metrics.visited) == (True, 3, 3), folder
        assert run.metrics.collisions == 0

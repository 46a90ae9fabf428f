"""A law of another distribution: found by its entry point, kept within the supervisor's limits, whatever it says."""

import csv
import math
from pathlib import Path
from typing import Any

import pytest

from contract.arena import ArenaError, digest, parse, table_of
from groundstation import cli
from groundstation.emulated import MockArena
from onboard.ahdc.parameters import Vector
from onboard.ahdc.view import Goal, View
from tests.onboard.samples import arena as sample

MODULE = "tests.onboard.test_laws"
LAWS = {"straight": "Straight", "hostile": "Hostile", "broken": "Broken", "absent": "NoSuchLaw", "field": "Hostile"}


class Straight:
    """To the goal and nothing else."""

    def __init__(self, robot: str, parameters: Any, options: dict[str, Any]) -> None:
        self.speed_mps = options.get("speed_mps", parameters.max_speed_mps)

    def velocity(self, view: View, goal: Goal | None) -> Vector:
        if goal is None:
            return (0.0, 0.0)
        dx, dy = goal.point[0] - view.motion.x_m, goal.point[1] - view.motion.y_m
        far = math.hypot(dx, dy)
        if far <= goal.stop_short_m:
            return (0.0, 0.0)
        return (self.speed_mps * dx / far, self.speed_mps * dy / far)


class Hostile(Straight):
    """At the nearest robot, or else the nearest wall, far too fast."""

    def velocity(self, view: View, goal: Goal | None) -> Vector:
        x, y = view.motion.x_m, view.motion.y_m
        victim = min(((s.x_m, s.y_m) for s in view.sighted.values()), key=lambda p: math.dist(p, (x, y)), default=None)
        dx, dy = (victim[0] - x, victim[1] - y) if victim else (-x, 0.0)
        return (100.0 * dx, 100.0 * dy)


class Broken(Straight):
    """Raises, or answers with what is no velocity."""

    def __init__(self, robot: str, parameters: Any, options: dict[str, Any]) -> None:
        self.answers = [None, (1.0,), ("a", "b"), (math.nan, 0.0), (0.0, math.inf), 7]
        self.step = 0

    def velocity(self, view: View, goal: Goal | None) -> Vector:
        self.step += 1
        return self.answers[self.step % len(self.answers)]  # type: ignore[return-value]


@pytest.fixture(autouse=True)
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "laws-1.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: laws\nVersion: 1\n")
    entries = "".join(f"{name} = {MODULE}:{what}\n" for name, what in LAWS.items())
    (folder / "entry_points.txt").write_text(f"[ahdc.laws]\n{entries}")
    monkeypatch.syspath_prepend(str(tmp_path))


def with_control(**control: Any) -> dict[str, Any]:
    table = table_of(sample())
    table["control"] = {key: value for key, value in table["control"].items() if key != "field"} | control
    return table


def test_the_profile_selects_it_and_its_table_reaches_it() -> None:
    arena = MockArena(robots=2, targets=2, seed=3, profile="straight", law={"speed_mps": 0.3})
    law = next(iter(arena.world.agents.values())).controller.own
    assert law is not None
    assert law._law.speed_mps == 0.3  # type: ignore[attr-defined]
    arena.run(4.0)
    speeds = [abs(speed) * 0.03 for robot in arena.robots for speed in arena.speeds(robot)]
    assert 0.05 < max(speeds) <= 0.5


def test_a_file_with_it_is_checked_like_any_other() -> None:
    arena = parse(with_control(profile="straight", law={"gain": 2.0}), "test")
    assert (arena.control.profile, arena.control.law) == ("straight", {"gain": 2.0})
    assert parse(table_of(arena), "again") == arena
    assert digest(arena) != digest(parse(with_control(profile="straight", law={"gain": 2.5}), "test"))
    with pytest.raises(ArenaError, match=r'control\.profile = "strait".*straight.*did you mean "straight"'):
        parse(with_control(profile="strait"), "test")
    with pytest.raises(ArenaError, match=r'control\.paper.*not used by profile "straight"'):
        parse(with_control(profile="straight", paper={}), "test")
    with pytest.raises(ArenaError, match=r'control\.law.*not used by profile "field"'):
        parse(with_control(law={}), "test")


def test_an_experiment_compares_it_with_ours(tmp_path: Path) -> None:
    file = tmp_path / "laws.toml"
    file.write_text('name = "laws"\nrobots = [2]\ntargets = [1]\nprofiles = ["field", "straight"]\n')
    assert cli.main(["experiment", str(file), "--out", str(tmp_path / "out")]) == 0
    with (tmp_path / "out" / "trials.csv").open() as table:
        assert {row["profile"]: row["ending"] for row in csv.DictReader(table)} == dict.fromkeys(
            ("field", "straight"), "completed"
        )


def test_what_cannot_be_loaded_is_named() -> None:
    with pytest.raises(ValueError, match=r"'absent'.*test_laws:NoSuchLaw of ahdc\.laws"):
        MockArena(robots=1, targets=1, profile="absent")


def test_a_name_of_ours_stays_ours() -> None:
    assert next(iter(MockArena(robots=1, targets=1).world.agents.values())).controller.own is None


@pytest.mark.parametrize("seed", [1, 2])
def test_a_hostile_law_touches_nobody_and_leaves_no_floor(seed: int) -> None:
    arena = MockArena(robots=4, targets=4, seed=seed, profile="hostile")
    (width, height), reach = arena.world.arena.arena.size_m, 0.0
    for _ in range(60):
        arena.run(0.1)
        for robot in arena.robots:
            x, y, _ = arena.pose(robot)
            assert 0.0 < x < width
            assert 0.0 < y < height
            reach = max(reach, *map(abs, arena.speeds(robot)))
    assert arena.collisions == 0
    assert reach * 0.03 > 0.1, "it did drive"


def test_a_broken_law_stands_still_and_is_counted() -> None:
    arena = MockArena(robots=2, targets=2, seed=1, profile="broken")
    arena.run(2.0)
    assert max(abs(speed) for robot in arena.robots for speed in arena.speeds(robot)) == 0.0
    counters = arena.counters(arena.robots[0])
    assert {"law: TypeError", "law: ValueError", "law: not finite"} <= counters.keys()

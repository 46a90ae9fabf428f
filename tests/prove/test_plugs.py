"""Pulled plugs, 200 in lockstep and ten in real time; lockstep missions with each controller family and with six."""

import random
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
import tomlkit

sys.path.insert(0, str(Path(__file__).parents[1] / "drivers"))

from plugs import CAUSES, COAST_MPS2, SIX, WATCHDOG_S, Puller, judge, six_families
from plugs import PULLS as WAYS

from drivers.registry import family_of
from groundstation import rig
from groundstation.faultreal import TOLD_S
from groundstation.faultrig import Stage, rolled_m
from groundstation.faultwords import zero_after_s
from groundstation.link import Link
from tests.prove.test_families import wheels_of

PULLS = 200
EACH = 4
REAL_PULLS = 10
MAX_SPEED_MPS = 0.8
REAL_CAUSES = {how: (cause,) for how, cause in CAUSES.items()} | {"unplug": ("hung up", "Input/output error")}
"""A line that is gone is noticed by the next write or the next read, whichever comes first."""


@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", range(1, PULLS // EACH + 1))
def test_a_pulled_plug_stops_one_robot_and_is_named(seed: int) -> None:
    world = six_families(seed)
    puller = Puller(world, seed)
    puller.run(0.8)
    for _ in range(EACH):
        judge(puller.pull())


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "kinds", [*((kind,) * 6 for kind in (*SIX, "vesc_uart")), SIX], ids=lambda k: "-".join(sorted(set(k)))
)
def test_a_mission_completes_with_every_family(kinds: tuple[str, ...]) -> None:
    result = six_families(3, kinds=kinds).run()
    assert result.completed, result.why
    assert (result.disconnected_steps, result.collisions) == (0, 0)


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """Six families on six robots in real processes; the station is this one."""
    folder = tmp_path_factory.mktemp("plugs")
    table = tomllib.loads(rig.find_arena("experiment2").read_text(encoding="utf-8"))
    for robot, kind in zip(table["robots"].values(), SIX, strict=True):
        robot["wheels"] = wheels_of(kind) | ({"gear_ratio": 6.0} if kind == "vesc" else {})
        robot.pop("emulate", None)
    file = folder / "six.toml"
    file.write_text(tomlkit.dumps(table), encoding="utf-8")
    arena = rig.mock_arena(file, folder / "run", rig.Changes(6, 60, 1))
    with rig.Rig(arena, folder / "run") as processes:
        processes.start()
        with Link(arena, "station") as link:
            yield Stage(processes, link)


@pytest.mark.timeout(180)
@pytest.mark.parametrize("pull", range(REAL_PULLS))
def test_a_pulled_plug_in_real_time(pull: int, stage: Stage) -> None:
    """Every family meets every way that its wire has; the moment within the mission is random."""
    draw = random.SystemRandom()
    robots = stage.arena.robots
    stage.to_running()
    stage.watch(draw.uniform(0.2, 1.5))
    stage.until(lambda: bool(stage.moving()) or stage.session.phase != "running", "somebody moves")
    victim = draw.choice(stage.moving() or list(robots))
    family = family_of(robots[victim].wheels["kind"])
    assert family is not None
    how = draw.choice([way for way in WAYS if way != "bus-off" or family.port_key == "channel"])
    whole = stage.is_whole(victim)
    left_at = {victim: stage.places[victim][-1][1:3]}
    stage.forget()
    since_ns = time.monotonic_ns()
    stage.spoil(*(f"{victim} {kind}" for kind in WAYS[how]))
    split, reasons = False, set()
    deadline = time.monotonic() + 2.5
    while time.monotonic() < deadline:
        stage.turn()
        reasons.add(stage.reports[victim].reason)
        split = split or (whole and stage.is_split(victim, left_at))
    until_ns = time.monotonic_ns()
    stage.spoil()
    stage.watch(1.0)
    told = f"{victim}, {family.kind}, {how}: {sorted(reasons)}"
    samples = stage.samples.get(victim, [])
    if how != "kill":
        zero_s = zero_after_s([sample for sample in samples if sample.stamp_ns < until_ns], since_ns)
        assert zero_s is None or zero_s <= WATCHDOG_S + TOLD_S + 0.05, f"{told}, zero after {zero_s} s"
    rolled = rolled_m([place for place in stage.places[victim] if since_ns <= place.stamp_ns])
    bound_m = MAX_SPEED_MPS * (WATCHDOG_S + TOLD_S) + MAX_SPEED_MPS**2 / (2 * COAST_MPS2) + 0.05
    assert rolled <= bound_m, f"{told}, rolled {rolled:.3f} m"
    named = [reason for reason in reasons if any(cause in reason for cause in REAL_CAUSES[how])]
    assert any(f"of {victim} on " in reason for reason in named), told
    assert not split, told
    stage.rig.family.check()
    assert stage.reports[victim].run not in ("armed", "running"), f"{told}, then {stage.reports[victim].run}"
    assert stage.places[victim][-1].speed_mps < 0.01, told
    stage.to_running()
    stage.until(lambda: stage.reports[victim].run == "running", "the robot runs again")
    print(f"{told}; rolled {rolled:.3f} m")

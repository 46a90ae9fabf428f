"""A robot that no longer hears its wheels: what it tells of its motion, and that nobody leans on its links."""

import math

import pytest

from contract.messages import LinkMessage, NeighbourState, TransactionId, WheelFeedback
from onboard.ahdc.links import ON, LinkTable
from onboard.asked import DOUBT_NS, Asked
from onboard.guard import Guard
from onboard.odometry import BASE_NS, STALE_NS, Odometry, Pose, advance
from onboard.sensing import STUCK_NS
from tests.onboard.test_agent import PERIOD_NS, Stage

MS = 1_000_000


def watched(speed_mps: float, turn_radps: float, period_ns: int = 10 * MS) -> Odometry:
    """Wheels told 0.5 m/s at time 0 and nothing after that; the body moves otherwise for two seconds."""
    odometry, pose = Odometry(0.11), Pose(1.0, 1.0, 3.0)
    odometry.record(0, 0.5, 0.5)
    for stamp_ns in range(0, 2_000 * MS, period_ns):
        odometry.seen(pose, stamp_ns)
        pose = advance(pose, speed_mps, turn_radps, period_ns * 1e-9)
        pose = pose._replace(heading_rad=math.remainder(pose.heading_rad, math.tau))
    return odometry


@pytest.mark.parametrize(("speed_mps", "turn_radps"), [(0.0, 0.0), (0.4, 0.0), (-0.3, 2.0), (0.0, -4.0)])
def test_poses_tell_what_silent_wheels_do(speed_mps: float, turn_radps: float) -> None:
    half = turn_radps * 0.11 / 2
    assert watched(speed_mps, turn_radps).rims == pytest.approx((speed_mps - half, speed_mps + half), abs=1e-3)


def test_a_body_that_shakes_a_little_stands() -> None:
    assert watched(0.04, 0.2).rims == (0.0, 0.0)


@pytest.mark.parametrize(("period_ns", "told"), [(BASE_NS - 1, True), (STALE_NS, True), (STALE_NS + 1, False)])
def test_poses_too_far_apart_say_nothing(period_ns: int, told: bool) -> None:
    assert (watched(0.0, 0.0, period_ns).rims == (0.0, 0.0)) == told


def test_a_jump_is_no_speed() -> None:
    odometry = Odometry(0.11)
    odometry.record(0, 0.5, 0.5)
    for k in range(30):
        odometry.seen(Pose(float(k), 0.0, 0.0), k * BASE_NS)
    assert odometry.rims == (0.5, 0.5)


def test_wheels_that_speak_are_believed_and_at_once_when_they_speak_again() -> None:
    odometry = Odometry(0.11, silence_s=0.25)
    for at_ms in range(0, 1000, 10):
        odometry.seen(Pose(0.0, 0.0, 0.0), at_ms * MS)
        if at_ms <= 500 or at_ms == 900:
            odometry.record(at_ms * MS + 1, 0.5, 0.5)
        expected = 0.5 if at_ms < 800 or at_ms >= 900 else 0.0
        assert odometry.rims == (expected, expected), at_ms


class Silent(Stage):
    """Its wheels turn at 10 rad/s until they fall silent; motion capture sees it stand."""

    silent = False

    def feedback(self) -> WheelFeedback:
        if self.silent:
            return self.last
        self.last = WheelFeedback(
            robot="r01", stamp_ns=self.now_ns, left_radps=10.0, right_radps=10.0, left_rad=0.0, right_rad=0.0,
            enabled=True,
        )  # fmt: skip
        return self.last


def states(stage: Stage) -> list[NeighbourState]:
    return [message for _, message in stage.said if isinstance(message, NeighbourState)]


def test_a_robot_at_rest_does_not_tell_the_speed_that_its_wheels_had_when_they_fell_silent() -> None:
    stage = Silent()
    stage.run(20)
    assert states(stage)[-1].vx_mps == pytest.approx(0.3)
    stage.silent = True
    stage.run(80)
    told = states(stage)[-1]
    assert (told.vx_mps, told.vy_mps, told.moving) == (0.0, 0.0, False)
    assert told.stop_long == told.stop_short == (told.x_m, told.y_m) == (0.5, 0.5)


def test_what_stands_is_what_silent_wheels_were_asked_when_they_were_heard_last() -> None:
    asked = Asked()
    assert asked.standing(5 * DOUBT_NS) == (0.0, 0.0)
    asked.command(0.1, 0.2)
    asked.feedback(1000)
    asked.command(0.3, 0.4)
    assert (asked.latest, asked.standing(1000 + DOUBT_NS)) == ((0.3, 0.4), (0.3, 0.4))
    assert asked.standing(1001 + DOUBT_NS) == (0.1, 0.2)
    asked.feedback(1000)
    assert asked.standing(1001 + DOUBT_NS) == (0.1, 0.2), "the same sample, heard again"
    asked.feedback(1001)
    asked.command(0.5, 0.6)
    assert asked.standing(1001 + DOUBT_NS) == (0.5, 0.6)
    assert asked.standing(1002 + DOUBT_NS) == (0.3, 0.4)


def test_a_robot_tells_its_neighbours_and_its_own_limits_what_its_wheels_can_have_heard(monkeypatch) -> None:
    stage = Silent({"r02": (0.9, 0.5)})
    stage.start()
    limited: list[tuple[float, float]] = []
    limit = Guard.limited

    def noted(self, decision, pose, rims, asked, *around):
        limited.append(asked)
        return limit(self, decision, pose, rims, asked, *around)

    monkeypatch.setattr(Guard, "limited", noted)
    stage.silent = True
    stage.said.clear()
    stage.run(40)
    told = [state.asked_mps for state in states(stage)]
    assert told[0] not in (None, (0.0, 0.0))
    assert stage.drives[-1].left_radps == 0.0, "it holds, for nothing is heard of its wheels"
    assert len({asked for asked in told if asked != told[-1]}) >= 1, "at first what it commands"
    last = told[-1]
    assert last is not None
    assert last == pytest.approx(limited[-1], abs=1e-5)
    assert last != (0.0, 0.0)
    since = int(DOUBT_NS / PERIOD_NS) + 2
    assert set(limited[since:]) == {limited[-1]}
    stage.silent = False
    stage.run(4)
    assert states(stage)[-1].asked_mps != last


def test_a_robot_whose_wheels_obey_nobody_says_that_it_will_roll() -> None:
    stage = Silent({"r02": (0.9, 0.5)})
    stage.start()
    arena = stage.agent.arena
    stage.run(10)
    before = states(stage)[-1]
    stage.silent = True
    stage.run(int(2 * DOUBT_NS / PERIOD_NS))
    told = states(stage)[-1]
    coasts_m = 0.3 * 0.3 / (2 * arena.platform.coast_deceleration_mps2)
    assert math.dist(before.stop_long, (before.x_m, before.y_m)) < coasts_m
    assert coasts_m < math.dist(told.stop_long, (told.x_m, told.y_m)) < coasts_m + 0.8 * arena.safety.watchdog_s
    assert math.dist(told.stop_short, (told.x_m, told.y_m)) < coasts_m
    assert told.links_on == ()


def test_a_robot_without_power_says_that_it_coasts() -> None:
    stage = Silent()
    stage.run(20)
    told = states(stage)[-1]
    coasts_m = 0.3 * 0.3 / (2 * stage.agent.arena.platform.coast_deceleration_mps2)
    assert stage.agent.run_state == "disarmed"
    assert math.dist(told.stop_long, (told.x_m, told.y_m)) == pytest.approx(coasts_m, rel=0.02)


def test_where_tracking_is_stuck_a_robot_tells_where_its_wheels_have_taken_it_since() -> None:
    stage = Silent()
    stage.run(20)
    ahead = [state.x_m - 0.5 for state in states(stage)]
    assert ahead[-1] == pytest.approx(19 * PERIOD_NS * 1e-9 * 0.3, abs=0.006)
    stage.run(60)
    assert states(stage)[-1].x_m - 0.5 == pytest.approx(STUCK_NS * 1e-9 * 0.3, abs=0.006)


def linked() -> Silent:
    """r01 runs, with a link to r02 and one to r03 that it vouches for."""
    stage = Silent({"r02": (0.9, 0.5), "r03": (0.5, 0.9)})
    stage.start()
    field = stage.agent.controller.field
    assert field is not None
    for name in ("r02", "r03"):
        field.links.offer(name, 0.0)
        field.links.entries[name].state = ON
    return stage


def test_a_robot_whose_wheels_fell_silent_keeps_its_links_but_vouches_for_none_until_it_is_released() -> None:
    stage = linked()
    stage.run(10)
    assert set(states(stage)[-1].links_on) == {"r02", "r03"}
    stage.silent = True
    stage.run(int(300 * MS / PERIOD_NS))
    assert stage.agent.verdict is not None
    assert stage.agent.verdict.failsafe == "driver_silent"
    assert (states(stage)[-1].links_on, set(states(stage)[-1].links_kept)) == ((), {"r02", "r03"})
    stage.run(int(1000 * MS / PERIOD_NS))
    assert stage.agent.run_state == "fault"
    assert states(stage)[-1].links_on == ()
    stage.silent = False
    stage.run(10)
    assert states(stage)[-1].links_on == (), "still a fault"
    stage.give("disarm")
    stage.run(10)
    assert set(states(stage)[-1].links_on) == {"r02", "r03"}


@pytest.mark.parametrize("fit", [True, False])
def test_no_detour_leads_through_a_robot_that_does_not_obey(fit: bool) -> None:
    table = LinkTable("b", 1)
    for other in ("a", "c"):
        table.offer(other, 0.0)
        table.entries[other].state = ON
    table.outbox.clear()
    table.fit = fit
    lock = LinkMessage(
        to="b", kind="lock", tx=TransactionId(coordinator="a", boot=1, number=7), path=("a", "b", "c"), hop=1
    )
    table.hear("a", lock, 0.1)
    assert [message.kind for message in table.outbox] == ["lock" if fit else "nack"]
    assert table.propose_removal(["b", "a", "c"], 0.2) == fit
    assert table.enforced() == ["a", "c"]

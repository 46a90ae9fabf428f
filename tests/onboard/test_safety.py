"""The supervisor: every state with every event, every failsafe row, orders obeyed once."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.arena import Arena, digest, parse
from contract.messages import SCHEMA_VERSION, StationHeartbeat, StopRequest
from onboard.failsafes import FAILSAFES, LOST_FACTOR, Conditions, age_s, markdown
from onboard.safety import EVENTS, POWERED, STATES, TRANSITIONS, Supervisor

MS = 1_000_000
T0 = 10_000 * MS
ORDERS = ("disarm", "arm", "run", "hold", "stop")


def arena(**safety: object) -> Arena:
    table = {
        "arena": {"name": "lab", "size_m": [4.0, 5.0]},
        "robots": {
            name: {"body": name, "start": [x, 1.0], "wheels": {"kind": "odrive"}}
            for name, x in (("r06", 1.0), ("r08", 2.0))
        },
        "safety": {"battery_low_v": 11.0, "battery_critical_v": 10.0, **safety},
    }
    return parse(table, "test")


ARENA = arena()
HASH = digest(ARENA)


def good(now_ns: int, **changes: object) -> Conditions:
    facts = Conditions(
        pose_valid=True,
        pose_reason="",
        pose_stamp_ns=now_ns - 10 * MS,
        pose_arrival_ns=now_ns - 5 * MS,
        frame_advancing=True,
        feedback_stamp_ns=now_ns - 5 * MS,
        driver_active=True,
        loop_last_step_ns=now_ns - 10 * MS,
        battery_v=12.0,
    )
    return facts._replace(**changes)


class Bench:
    """A supervisor with a station that beats in time."""

    def __init__(self, arena: Arena = ARENA) -> None:
        self.now = T0
        self.hash = digest(arena)
        self.supervisor = Supervisor(arena, "r06")
        self.seq = 0
        self.order_id = 1
        self.boot = 7
        self.beat("disarm")
        self.assess()

    def beat(self, order: str, **changes: object) -> None:
        self.seq += 1
        fields = {
            "schema_version": SCHEMA_VERSION,
            "boot": self.boot,
            "seq": self.seq,
            "stamp_ns": self.now,
            "order": order,
            "order_id": self.order_id,
            "arena_hash": self.hash,
            **changes,
        }
        self.supervisor.heartbeat(StationHeartbeat(**fields), self.now)

    def order(self, order: str, **changes: object) -> None:
        self.order_id += 1
        self.beat(order, **changes)

    def assess(self, **changes: object):
        return self.supervisor.assess(good(self.now, **changes), self.now)

    def to(self, state: str) -> "Bench":
        path = {
            "disarmed": (),
            "armed": ("arm",),
            "running": ("arm", "run"),
            "holding": ("arm", "run", "hold"),
            "stopped": ("stop",),
            "fault": ("arm",),
        }[state]
        for order in path:
            self.order(order)
        if state == "fault":
            self.assess(driver_fault="broken")
        assert self.supervisor.state == state
        return self


# What each state becomes after each event, written out by hand.
EXPECTED = """
disarmed arm armed, disarmed run disarmed, disarmed hold disarmed, disarmed disarm disarmed
disarmed adopt disarmed, disarmed stop stopped, disarmed halt disarmed, disarmed fault disarmed
armed arm armed, armed run running, armed hold armed, armed disarm disarmed
armed adopt disarmed, armed stop stopped, armed halt stopped, armed fault fault
running arm running, running run running, running hold holding, running disarm disarmed
running adopt disarmed, running stop stopped, running halt stopped, running fault fault
holding arm holding, holding run running, holding hold holding, holding disarm disarmed
holding adopt disarmed, holding stop stopped, holding halt stopped, holding fault fault
stopped arm stopped, stopped run stopped, stopped hold stopped, stopped disarm disarmed
stopped adopt stopped, stopped stop stopped, stopped halt stopped, stopped fault stopped
fault arm fault, fault run fault, fault hold fault, fault disarm disarmed
fault adopt fault, fault stop stopped, fault halt fault, fault fault fault
"""
PRODUCT = [tuple(entry.split()) for entry in re.split(r"[,\n]", EXPECTED) if entry.strip()]


def test_table_is_the_full_product() -> None:
    assert {(state, event) for state, event, _ in PRODUCT} == {(s, e) for s in STATES for e in EVENTS}
    assert {(state, event): after for state, event, after in PRODUCT} == TRANSITIONS


@pytest.mark.parametrize(("state", "event", "after"), PRODUCT)
def test_every_event_in_every_state_through_the_supervisor(state: str, event: str, after: str) -> None:
    bench = Bench().to(state)
    if event in ORDERS:
        bench.order(event)
    elif event == "adopt":
        bench.boot += 1
        bench.beat("run")
    elif event == "halt":
        bench.assess(battery_v=1.0)
    else:
        bench.assess(driver_fault="broken")
    assert bench.supervisor.state == after


@pytest.mark.parametrize("order", ["arm", "run", "hold"])
def test_a_rebooted_robot_obeys_no_order_given_before(order: str) -> None:
    bench = Bench()
    bench.supervisor = Supervisor(ARENA, "r06")
    bench.order_id = 40
    for _ in range(3):
        bench.beat(order)
        assert bench.assess().run == "disarmed"
    bench.order("arm")
    assert bench.assess().run == "armed"


def test_an_order_is_obeyed_once() -> None:
    bench = Bench().to("armed")
    bench.order("disarm")
    bench.order_id -= 1
    bench.beat("arm")
    assert bench.supervisor.state == "disarmed"


def test_a_restarted_station_neither_resumes_nor_releases() -> None:
    running, stopped = Bench().to("running"), Bench().to("stopped")
    for bench, after in ((running, "disarmed"), (stopped, "stopped")):
        bench.boot, bench.seq, bench.order_id = 99, 0, 1
        bench.beat("disarm")
        assert bench.supervisor.state == after


def test_orders_to_others_are_not_obeyed_but_stop_is() -> None:
    bench = Bench()
    bench.order("arm", robots=("r08",))
    assert bench.supervisor.state == "disarmed"
    bench.order("arm", robots=("r06",))
    assert bench.supervisor.state == "armed"
    bench.order("stop", robots=("r08",))
    assert bench.supervisor.state == "stopped"


@pytest.mark.parametrize("age_ms", [-10_000, -100, 0, 600, 3_600_000])
def test_stop_is_obeyed_at_any_age(age_ms: int) -> None:
    bench = Bench().to("running")
    bench.order("stop", stamp_ns=max(0, T0 - age_ms * MS))
    assert bench.supervisor.state == "stopped"


def test_stop_request_latches_and_is_acknowledged() -> None:
    bench = Bench().to("running")
    bench.supervisor.stop_request(StopRequest(stamp_ns=0, source="a terminal", stop_id=5), bench.now)
    verdict = bench.assess()
    assert (verdict.run, verdict.may_move, verdict.latched, bench.supervisor.stop_id) == ("stopped", False, True, 5)
    assert "a terminal" in verdict.reason
    for order in ("run", "arm", "hold", "run"):
        bench.order(order)
    assert bench.assess().run == "stopped"
    bench.order("disarm")
    assert bench.assess().run == "disarmed"


def test_release_never_resumes() -> None:
    bench = Bench().to("running")
    bench.order("stop")
    bench.order("disarm")
    bench.order("run")
    verdict = bench.assess()
    assert (verdict.run, verdict.may_move) == ("disarmed", False)


@pytest.mark.parametrize("offset_ms", [-501, 21])
def test_an_old_or_future_heartbeat_is_no_heartbeat(offset_ms: int) -> None:
    bench = Bench().to("running")
    bench.now += 501 * MS
    bench.beat("run", stamp_ns=bench.now + offset_ms * MS)
    verdict = bench.assess()
    assert (verdict.may_move, verdict.failsafe) == (False, "station_silent")
    assert bench.supervisor.ignored_heartbeats == 1


def test_a_repeated_heartbeat_does_not_keep_a_robot_moving() -> None:
    bench = Bench().to("running")
    bench.now += 501 * MS
    bench.seq -= 1
    bench.beat("run")
    assert not bench.assess().may_move


# One change of the facts for each row, the boundary that still passes, and how it ends.
ROWS = {
    "driver_fault": ({"driver_fault": "port gone"}, {"driver_fault": ""}),
    "driver_lost": ({"feedback_stamp_ns": T0 - 1001 * MS}, {"feedback_stamp_ns": T0 - 250 * MS}),
    "driver_silent": ({"feedback_stamp_ns": T0 - 251 * MS}, {"feedback_stamp_ns": T0 - 250 * MS}),
    "duplicate_id": ({"duplicate_id": True}, {"duplicate_id": False}),
    "motion_mismatch": ({"motion_fault": "wheels turn, body still"}, {"motion_fault": ""}),
    "pose_jumped": ({"jump": "it came back 0.50 m away"}, {"jump": ""}),
    "battery_critical": ({"battery_v": 9.99}, {"battery_v": 11.0}),
    "outside_fence": ({"inside_fence": False}, {"inside_fence": True}),
    "pose_invalid": ({"pose_valid": False, "pose_reason": "occluded"}, {"pose_valid": True}),
    "pose_silent": ({"pose_arrival_ns": T0 - 151 * MS}, {"pose_arrival_ns": T0 - 150 * MS}),
    "pose_stale": ({"pose_stamp_ns": T0 - 151 * MS}, {"pose_stamp_ns": T0 - 150 * MS}),
    "pose_ahead": ({"pose_stamp_ns": T0 + 21 * MS}, {"pose_stamp_ns": T0 + 20 * MS}),
    "pose_frozen": ({"frame_advancing": False}, {"frame_advancing": True}),
    "driver_inactive": ({"driver_active": False}, {"driver_active": True}),
    "loop_overrun": ({"loop_last_step_ns": T0 - 101 * MS}, {"loop_last_step_ns": T0 - 100 * MS}),
    "battery_low": ({"battery_v": 10.99}, {"battery_v": 11.0}),
}
BY_TIME = {"station_silent", "station_lost", "station_mismatch"}


def long_active(state: str) -> Bench:
    """Motors enabled two seconds ago, all well at T0."""
    bench = Bench()
    bench.now -= 2000 * MS
    bench.assess(driver_active=False)
    bench.assess()
    bench.now = T0
    bench.beat("disarm")
    bench.assess()
    return bench.to(state)


def test_every_row_has_a_case() -> None:
    assert ROWS.keys() | BY_TIME == {row.name for row in FAILSAFES}


def check_row(row) -> None:
    bad, fine = ROWS[row.name]
    passing = long_active("running").assess(**fine)
    assert (passing.run, passing.may_move) == ("running", True)
    assert passing.failsafe != row.name
    bench = long_active("running")
    verdict = bench.assess(**bad)
    assert verdict.failsafe == row.name
    assert row.trigger in verdict.reason
    assert verdict.may_move == (row.action == "warn")
    assert verdict.run == {"hold": "holding", "stop": "stopped", "fault": "fault", "warn": "running"}[row.action]
    assert verdict.latched == (row.action in ("stop", "fault"))
    assert verdict.enable
    assert verdict.remedy == row.remedy
    after = bench.assess()
    assert after.may_move == (row.action in ("hold", "warn"))


@pytest.mark.parametrize("row", [row for row in FAILSAFES if row.name in ROWS], ids=lambda row: row.name)
def test_failsafe(row) -> None:
    check_row(row)


@pytest.mark.parametrize("row", [row for row in FAILSAFES if row.name in ROWS], ids=lambda row: row.name)
def test_a_row_without_its_threshold_is_found_out(row, monkeypatch: pytest.MonkeyPatch) -> None:
    blind = tuple(r._replace(tripped=lambda sight: False) if r is row else r for r in FAILSAFES)
    monkeypatch.setattr("onboard.safety.FAILSAFES", blind)
    with pytest.raises(AssertionError):
        check_row(row)


@pytest.mark.parametrize(
    ("name", "check"),
    [
        ("station_silent", "test_station_silence_holds_then_stops"),
        ("station_lost", "test_station_silence_holds_then_stops"),
        ("station_mismatch", "test_a_station_with_another_file_or_schema_is_refused"),
    ],
)
def test_a_row_of_time_without_its_threshold_is_found_out(
    name: str, check: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    blind = tuple(r._replace(tripped=lambda sight: False) if r.name == name else r for r in FAILSAFES)
    monkeypatch.setattr("onboard.safety.FAILSAFES", blind)
    arguments = ({"schema_version": 99},) if name == "station_mismatch" else ()
    with pytest.raises(AssertionError):
        globals()[check](*arguments)


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("row", [row for row in FAILSAFES if row.name in ROWS], ids=lambda row: row.name)
def test_no_failsafe_gives_leave_to_move(row, state: str) -> None:
    bench = long_active(state)
    verdict = bench.assess(**ROWS[row.name][0])
    assert not verdict.may_move or (state == "running" and row.action == "warn")
    if state not in POWERED:
        assert bench.supervisor.state == state


def test_a_fault_that_lasts_refuses_arming_and_says_why() -> None:
    bench = Bench().to("fault")
    bench.order("disarm")
    bench.assess(driver_fault="port gone")
    bench.order("arm")
    verdict = bench.assess(driver_fault="port gone")
    assert verdict.run == "disarmed"
    assert "arm refused" in verdict.reason
    assert "port gone" in verdict.reason
    bench.assess()
    bench.beat("arm")
    assert bench.assess().run == "disarmed", "a refused order is not obeyed later by surprise"
    bench.order("arm")
    assert bench.assess().run == "armed"


def test_station_silence_holds_then_stops() -> None:
    bench = Bench().to("running")
    beat_ns = bench.now
    bench.now = beat_ns + 500 * MS
    assert bench.assess().may_move
    bench.now = beat_ns + 501 * MS
    verdict = bench.assess()
    assert (verdict.run, verdict.failsafe, verdict.latched) == ("holding", "station_silent", False)
    bench.beat("run")
    assert bench.assess().may_move, "the station is back: its will is still to run"
    bench.now += LOST_FACTOR * 500 * MS
    assert bench.assess().failsafe == "station_silent"
    bench.now += 1 * MS
    verdict = bench.assess()
    assert (verdict.run, verdict.failsafe, verdict.latched) == ("stopped", "station_lost", True)
    bench.beat("run")
    assert bench.assess().run == "stopped"


@pytest.mark.parametrize(
    "change", [{"arena_hash": "000000000000"}, {"arena_hash": "~" * 12}, {"arena_hash": ""}, {"schema_version": 99}]
)
def test_a_station_with_another_file_or_schema_is_refused(change: dict[str, object]) -> None:
    bench = Bench()
    bench.order("arm", **change)
    verdict = bench.assess()
    assert verdict.run == "disarmed"
    assert "station" in verdict.reason
    bench = Bench().to("running")
    bench.beat("run", **change)
    assert bench.assess().failsafe == "station_mismatch"
    assert bench.supervisor.state == "fault"


@pytest.mark.parametrize("side", ["left_mps", "right_mps"])
@pytest.mark.parametrize(
    ("speed_mps", "rests"),
    [(0.0, True), (0.019, True), (-0.019, True), (0.02, False), (-0.02, False), (0.5, False), (-0.5, False)],
)
def test_a_robot_rests_while_both_wheels_are_slower_than_2_cm_a_second(
    side: str, speed_mps: float, rests: bool
) -> None:
    assert Bench().assess(**{side: speed_mps}).at_rest is rests


@pytest.mark.parametrize("order", ["stop", "disarm"])
def test_motors_stay_enabled_until_the_wheels_rest(order: str) -> None:
    bench = Bench().to("running")
    bench.assess()
    bench.order(order)
    assert bench.assess(left_mps=0.3, right_mps=0.3).enable
    bench.now += 100 * MS
    assert bench.assess(left_mps=0.019, right_mps=-0.021).enable
    assert bench.assess(left_mps=0.0, right_mps=0.0, feedback_stamp_ns=T0).enable, "feedback from before the stop"
    verdict = bench.assess(left_mps=0.019, right_mps=-0.019)
    assert (verdict.enable, verdict.at_rest) == (False, True)
    assert not bench.assess(left_mps=0.3).enable, "once disabled, disabled"


def test_motors_are_disabled_after_the_settling_time_whatever_the_wheels_say() -> None:
    bench = Bench().to("running")
    bench.order("stop")
    bench.now += 499 * MS
    assert bench.assess(left_mps=0.5).enable
    bench.now += 1 * MS
    assert not bench.assess(left_mps=0.5).enable


def test_disarmed_motors_are_never_enabled() -> None:
    assert not Bench().assess().enable
    assert not Bench().to("stopped").assess().enable


def test_without_any_message_nothing_moves() -> None:
    supervisor = Supervisor(ARENA, "r06")
    verdict = supervisor.assess(good(T0), T0)
    assert (verdict.run, verdict.may_move, verdict.enable) == ("disarmed", False, False)


def test_motors_are_disabled_however_late_one_looks() -> None:
    bench = Bench().to("running")
    bench.order("stop")
    bench.now = 2 * T0
    assert not bench.assess(left_mps=0.5).enable


@pytest.mark.parametrize("offset_ms", [-499, -100, 20])
def test_a_heartbeat_of_usual_age_counts(offset_ms: int) -> None:
    bench = Bench().to("running")
    bench.now += 1000 * MS
    bench.beat("run", stamp_ns=bench.now + offset_ms * MS)
    assert bench.supervisor.ignored_heartbeats == 0
    assert bench.assess().may_move


def test_numbers_begin_at_zero_and_tell_what_was_obeyed() -> None:
    supervisor = Supervisor(ARENA, "r06")
    assert (supervisor.order_id, supervisor.stop_id, supervisor.homing) == (0, 0, False)
    assert "none yet" in supervisor.assess(good(T0), T0).reason
    bench = Bench()
    bench.order("arm", robots=("r08",))
    assert bench.supervisor.order_id == 0, "not for this robot"
    bench.order("stop", robots=("r08",))
    assert bench.supervisor.order_id == bench.order_id, "a stop is for all"


def test_a_station_whose_boot_is_zero_or_large_is_heard_like_any_other() -> None:
    bench = Bench()
    bench.supervisor, bench.boot = Supervisor(ARENA, "r06"), 0
    bench.assess()
    bench.beat("arm")
    assert bench.assess().run == "disarmed", "its first order was given before this robot came up"
    bench = Bench()
    for order in ("disarm", "arm", "run"):
        bench.boot = int("1" + "0" * 12)
        bench.order(order)
    assert bench.assess().run == "running"


@pytest.mark.parametrize("order", ["run", "hold"])
def test_an_order_to_a_disarmed_robot_is_refused_in_words(order: str) -> None:
    bench = Bench()
    bench.order(order)
    verdict = bench.assess()
    assert (verdict.reason, verdict.remedy) == (f"{order} refused: not armed", "arm first")
    stopped = Bench().to("stopped")
    stopped.order(order)
    assert "refused" not in stopped.assess().reason
    blocked = Bench()
    blocked.assess(driver_fault="port gone")
    blocked.order(order)
    assert "not armed" in blocked.assess(driver_fault="port gone").reason


def test_an_order_that_changes_nothing_is_obeyed_and_not_refused() -> None:
    armed = Bench().to("armed")
    armed.order("hold")
    assert (armed.assess().run, armed.supervisor.order_id) == ("armed", armed.order_id)
    stopped = Bench().to("stopped")
    stopped.assess(driver_fault="port gone")
    stopped.order("arm")
    assert "refused" not in stopped.assess(driver_fault="port gone").reason


def test_only_run_says_whether_the_way_is_home() -> None:
    bench = Bench()
    bench.order("arm", home=True)
    assert not bench.supervisor.homing
    bench.order("run", home=True)
    assert bench.supervisor.homing
    bench.order("hold")
    assert bench.supervisor.homing
    bench.order("run")
    assert not bench.supervisor.homing


def test_the_remedy_is_the_drivers_for_its_faults_and_the_rows_for_others() -> None:
    bench = long_active("running")
    assert bench.assess(driver_fault="port gone", driver_remedy="plug it in").remedy != ""
    assert bench.assess().remedy == "plug it in"
    bench = long_active("running")
    bench.assess(duplicate_id=True, driver_remedy="plug it in")
    assert bench.assess().remedy == "give every robot its own id; look for a second agent"


@pytest.mark.parametrize(("arena_hash", "words"), [("000000000000", "000000000000 at"), ("", "(none) at")])
def test_the_stations_file_is_named(arena_hash: str, words: str) -> None:
    bench = Bench().to("running")
    bench.beat("run", arena_hash=arena_hash)
    assert words in bench.assess().reason


def test_a_driver_that_is_not_enabled_is_not_a_silent_one() -> None:
    bench = Bench().to("armed")
    bench.assess(driver_active=False)
    verdict = bench.assess(driver_active=False, feedback_stamp_ns=0)
    assert (verdict.run, verdict.failsafe) == ("armed", "driver_inactive")
    supervisor = Supervisor(ARENA, "r06")
    assert "feedback" not in supervisor.assess(good(T0, driver_active=False, feedback_stamp_ns=0), T0).reason


@given(
    st.lists(
        st.tuples(
            st.sampled_from([*ORDERS, "request", "silence", "fault"]),
            st.integers(0, 300),
            st.booleans(),
        ),
        max_size=30,
    )
)
def test_leave_to_move_needs_run_after_arm_and_a_fresh_station(script) -> None:
    bench = Bench()
    armed = ran = False
    beat_ns = bench.now
    for what, wait_ms, repeat in script:
        bench.now += wait_ms * MS
        if what == "request":
            bench.supervisor.stop_request(StopRequest(stamp_ns=0, source="x", stop_id=1), bench.now)
            armed = ran = False
        elif what == "fault":
            bench.assess(driver_fault="x")
            armed = ran = False
        elif what != "silence":
            (bench.beat if repeat and what != "stop" else bench.order)(what)
            beat_ns = bench.now
            if what in ("disarm", "stop") and not (repeat and what == "disarm"):
                armed = ran = False
            armed = armed or what == "arm"
            ran = (ran or what == "run") and armed
        if bench.assess().may_move:
            assert ran
            assert bench.now - beat_ns <= 500 * MS


SECOND = 1_000_000_000


@pytest.mark.parametrize("boot", [0, 1, 2])
def test_the_first_station_heard_is_a_new_one_whatever_its_boot(boot: int) -> None:
    bench = Bench()
    bench.supervisor, bench.boot, bench.order_id = Supervisor(ARENA, "r06"), boot, 5
    bench.beat("run")
    assert bench.assess().reason == "", "its order was given before this robot came up: neither obeyed nor refused"


def test_nothing_is_armed_before_the_first_look_around() -> None:
    bench = Bench()
    bench.supervisor = Supervisor(ARENA, "r06")
    bench.beat("disarm")
    bench.order("arm")
    verdict = bench.assess()
    assert (verdict.run, verdict.reason) == ("disarmed", "arm refused: not assessed yet")
    assert verdict.remedy == "remove the cause, then arm again"


def test_a_robot_that_comes_up_rolling_does_not_enable_its_motors() -> None:
    assert not Supervisor(ARENA, "r06").assess(good(T0, left_mps=0.5), T0).enable


def test_motors_not_enabled_yet_are_not_lost_however_soon_silence_counts() -> None:
    bench = Bench(arena(driver_silence_s=0.05)).to("armed")
    for _ in range(100):
        bench.now += 20 * MS
        bench.beat("arm")
        verdict = bench.assess(driver_active=False, feedback_stamp_ns=0)
        assert (verdict.run, verdict.failsafe) == ("armed", "driver_inactive")


def test_the_mission_is_the_one_the_newest_heartbeat_names() -> None:
    bench = Bench()
    bench.beat("disarm", mission="first")
    assert bench.supervisor.mission == "first"
    bench.beat("disarm", mission="second")
    bench.beat("disarm", mission="late", stamp_ns=bench.now - 10_000 * MS)
    assert bench.supervisor.mission == "second"


@pytest.mark.parametrize("boot", [0, 7])
def test_a_station_that_another_took_over_from_is_heard_no_more(boot: int) -> None:
    bench = Bench()
    bench.supervisor, bench.boot = Supervisor(ARENA, "r06"), boot
    bench.beat("disarm", mission="first")
    bench.beat("disarm", mission="second", boot=8)
    bench.order("arm", mission="first")
    assert (bench.supervisor.mission, bench.supervisor.state) == ("second", "disarmed")
    assert bench.supervisor.ignored_heartbeats == 1


@pytest.mark.parametrize("back", [0, 1, 5])
def test_a_heartbeat_that_is_repeated_or_overtaken_is_ignored(back: int) -> None:
    bench = Bench()
    for mission in ("first", "second", "third", "fourth", "fifth", "sixth"):
        bench.beat("disarm", mission=mission)
    bench.beat("disarm", mission="late", seq=bench.seq - back)
    assert (bench.supervisor.mission, bench.supervisor.ignored_heartbeats) == ("sixth", 1)


@pytest.mark.parametrize("apart", [-1, 1])
def test_an_older_and_a_newer_schema_both_refuse_to_arm(apart: int) -> None:
    bench = Bench()
    bench.order("arm", schema_version=SCHEMA_VERSION + apart)
    assert bench.supervisor.state == "disarmed"
    assert f"message schema {SCHEMA_VERSION + apart}" in bench.assess().reason


def test_where_to_wait_is_what_the_newest_heartbeat_says() -> None:
    bench = Bench()
    bench.beat("disarm", aside={"r06": (1.5, 2.0), "r08": (0.5, 0.5)})
    assert bench.supervisor.aside == (1.5, 2.0)
    bench.beat("disarm", aside={"r08": (0.5, 0.5)})
    assert bench.supervisor.aside is None


@pytest.mark.parametrize("order", ["run", "hold"])
def test_an_order_refused_while_disarmed_leaves_no_trace_but_the_reason(order: str) -> None:
    bench = Bench()
    before = bench.supervisor.order_id
    bench.order(order, home=True)
    assert (bench.supervisor.order_id, bench.supervisor.homing) == (before, False)
    assert bench.assess().reason == f"{order} refused: not armed"
    bench.order("disarm")
    assert (bench.supervisor.order_id, bench.assess().reason) == (bench.order_id, "")


def test_motors_keep_their_power_while_a_robot_that_has_run_for_long_comes_to_rest() -> None:
    bench = Bench().to("running")
    for _ in range(3):
        bench.now += 20 * MS
        bench.beat("run")
        assert bench.assess().enable
    bench.now += 20 * MS
    bench.assess(left_mps=0.5)
    bench.order("stop")
    assert bench.assess(left_mps=0.5).enable
    bench.now += 20 * MS
    bench.beat("stop")
    assert not bench.assess().enable


def test_only_a_run_can_be_a_way_home_and_only_disarm_clears_a_reason() -> None:
    bench = Bench().to("stopped")
    reason = bench.assess().reason
    assert reason
    bench.order("arm")
    assert bench.assess().reason == reason
    bench.order("stop", home=True)
    assert not bench.supervisor.homing


def test_arming_what_is_armed_is_obeyed_whatever_the_station_says_of_itself() -> None:
    """Refused is only what would enable motors; the next look sees the mismatch."""
    bench = Bench().to("armed")
    bench.order("arm", arena_hash="0" * 12)
    assert bench.supervisor.order_id == bench.order_id
    assert bench.assess().failsafe == "station_mismatch"


def test_a_supervisor_just_made_knows_no_mission_and_settles_nothing() -> None:
    """On a computer that has just started, too: its clock begins at zero."""
    supervisor = Supervisor(ARENA, "r06")
    assert supervisor.mission == ""
    assert not supervisor.assess(good(100 * MS, left_mps=0.5), 100 * MS).enable


def test_a_driver_active_from_the_first_look_on_is_silent_only_later() -> None:
    bench = Bench()
    bench.supervisor = Supervisor(ARENA, "r06")
    bench.beat("disarm")
    quiet = {"feedback_stamp_ns": 0}
    assert bench.assess(**quiet).failsafe == ""
    bench.order("arm")
    assert bench.assess(**quiet).run == "armed"
    assert bench.assess(**quiet).failsafe == ""


@pytest.mark.parametrize(("age_ns", "ignored"), [(SECOND, 0), (SECOND + 1, 1)])
def test_a_heartbeat_is_late_from_one_nanosecond_over_its_timeout(age_ns: int, ignored: int) -> None:
    bench = Bench(arena(heartbeat_timeout_s=1.0))
    bench.beat("disarm", stamp_ns=T0 - age_ns)
    assert bench.supervisor.ignored_heartbeats == ignored


def test_motors_are_enabled_to_the_last_nanosecond_of_the_settling_time() -> None:
    bench = Bench(arena(stop_settle_s=1.0)).to("running")
    bench.order("stop")
    bench.now += SECOND - 1
    assert bench.assess(left_mps=0.5).enable
    bench.now += 1
    assert not bench.assess(left_mps=0.5).enable


@pytest.mark.parametrize(("quiet_ns", "lost"), [(SECOND, False), (SECOND + 1, True)])
def test_a_driver_is_lost_from_one_nanosecond_over_four_of_its_silences(quiet_ns: int, lost: bool) -> None:
    verdict = long_active("running").assess(feedback_stamp_ns=T0 - quiet_ns)
    assert verdict.failsafe == ("driver_lost" if lost else "driver_silent")


def test_robots_taken_out_are_those_of_the_newest_heartbeat() -> None:
    bench = Bench()
    bench.beat("disarm", excluded=("r08",))
    assert bench.supervisor.excluded == {"r08"}
    bench.beat("disarm")
    assert bench.supervisor.excluded == frozenset()


def test_of_several_rows_the_gravest_speaks() -> None:
    faulty = long_active("running").assess(driver_fault="port gone", duplicate_id=True, battery_v=1.0)
    assert (faulty.failsafe, faulty.run) == ("driver_fault", "fault")
    holding = long_active("running").assess(pose_valid=False, pose_stamp_ns=T0 - 151 * MS, battery_v=10.5)
    assert (holding.failsafe, holding.run) == ("pose_invalid", "holding")


def test_a_robot_without_power_keeps_the_reason_it_was_stopped_for() -> None:
    bench = long_active("running")
    bench.order("stop")
    verdict = bench.assess(duplicate_id=True)
    assert (verdict.run, verdict.failsafe, verdict.reason) == ("stopped", "", "the station ordered stop")


def test_a_loop_that_has_not_run_yet_is_not_late() -> None:
    verdict = long_active("running").assess(loop_last_step_ns=0)
    assert (verdict.may_move, verdict.failsafe) == (True, "")


def test_a_station_without_an_arena_file_is_told_apart_in_words() -> None:
    bench = Bench().to("running")
    bench.beat("run", arena_hash="")
    assert f"arena file (none) at the station, {HASH} here" in bench.assess().reason


def test_a_robot_whose_battery_nobody_measures_drives() -> None:
    verdict = long_active("running").assess(battery_v=None)
    assert (verdict.may_move, verdict.failsafe) == (True, "")


@pytest.mark.parametrize(("volts", "speaks"), [(11.0, ""), (10.0, "battery_low")])
def test_a_battery_at_its_threshold_is_not_below_it(volts: float, speaks: str) -> None:
    assert long_active("running").assess(battery_v=volts).failsafe == speaks


def test_what_is_not_said_of_a_robot_is_nothing() -> None:
    names = ("pose_valid", "pose_reason", "pose_stamp_ns", "pose_arrival_ns", "frame_advancing", "feedback_stamp_ns")
    defaults = Conditions(**dict.fromkeys(names), driver_active=True)[len(names) + 1 :]
    assert defaults == ("", "", 0.0, 0.0, 0, True, False, "", "", None)


def test_ages_are_seconds_exactly_and_infinite_for_never() -> None:
    assert age_s(1, SECOND + 1) == 1.0
    assert age_s(0, SECOND) == float("inf")


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({"pose_arrival_ns": T0 - 151 * MS}, "no pose frame arrives: 151 ms"),
        ({"pose_arrival_ns": T0 - 1500 * MS}, "no pose frame arrives: 1500 ms"),
        ({"pose_arrival_ns": 0}, "no pose frame arrives: none yet"),
        ({"pose_stamp_ns": T0 + 21 * MS}, "the pose is stamped in the future, beyond the clock's uncertainty"),
        ({"pose_stamp_ns": T0 + 21 * MS}, "(negative age): 21 ms"),
        ({"battery_v": 10.5}, "battery voltage below the low value: 10.5 V"),
    ],
)
def test_a_reason_tells_what_was_seen(facts: dict[str, object], words: str) -> None:
    assert words in long_active("running").assess(**facts).reason


def test_a_reason_without_anything_to_tell_is_the_trigger_alone() -> None:
    assert long_active("running").assess(duplicate_id=True).reason == "another process writes this robot's keys"


def test_every_row_is_a_line_of_the_table() -> None:
    lines = markdown().splitlines()
    assert [line.split("`")[1] for line in lines[2:]] == [row.name for row in FAILSAFES]
    assert all(line.startswith("| ") and line.endswith(" |") for line in lines[2:])


def test_the_page_shows_the_table() -> None:
    page = (Path(__file__).parents[2] / "docs" / "safety.md").read_text()
    assert markdown() in page, "regenerate with: ahdc-onboard failsafes"

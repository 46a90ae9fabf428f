"""Virtual bodies beside tracked ones: one frame holds both, at one instant."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.arena import Arena, parse, table_of
from contract.codec import decode, encode
from contract.messages import ExternalBody, ExternalFrame
from mocap_bridge.mock.bodies import BodyState
from mocap_bridge.mock.virtual import VirtualStream
from mocap_bridge.natnet.frame import TRACKING_VALID
from mocap_bridge.pipeline import Pipeline
from mocap_bridge.sources.base import STEADY, OnNetwork, Source, SourceFrame, SourceStatus
from mocap_bridge.sources.choose import open_source
from mocap_bridge.sources.external import ExternalSource
from mocap_bridge.sources.virtual import STALE_NS, VirtualBodies, WithVirtual
from tests.mocap_bridge.lockstep import arena

T0 = 10**12
STEP_NS = 8_333_333


def mixed(**mocap: object) -> Arena:
    """r06 tracked, the others virtual: r08 wholly emulated, r09 on a stand; r09's body is turned on its robot."""
    table = table_of(arena(up_axis="z", origin_m=[0.5, -1.0], rotation_rad=0.7, **mocap))
    for name, emulate in (("r06", []), ("r08", ["wheels", "body"]), ("r09", ["body"])):
        table["robots"][name]["emulate"] = emulate
    table["robots"]["r09"]["heading_offset_rad"] = 0.3
    return parse(table, "mixed")


SITE = mixed()


def message(stamp_ns: int, seq: int = 1, **places: tuple[float, float, float]) -> bytes:
    bodies = tuple(ExternalBody(body=n, x_m=x, y_m=y, heading_rad=h) for n, (x, y, h) in places.items())
    return encode(ExternalFrame(seq=seq, stamp_ns=stamp_ns, bodies=bodies))


class Cameras:
    """A tracked source that sees r06 only."""

    def __init__(self) -> None:
        self.frames: list[SourceFrame] = []
        self.closed = False

    def see(self, number: int, exposure_ns: int, also: str = "") -> None:
        axes = VirtualBodies(SITE)._axes
        position, rotation = axes.source(1.0, 1.0, 0.5)
        bodies = {name: (1, *position, *rotation, 0.0, TRACKING_VALID) for name in ("r06", also) if name}
        self.frames.append(
            SourceFrame(0, number, exposure_ns, exposure_ns + 5_000_000, exposure_ns + 6_000_000, 100_000, bodies)
        )

    def wait(self, timeout_s: float) -> None:
        return

    def receive(self, now_ns: int) -> list[SourceFrame]:
        taken, self.frames = self.frames, []
        return taken

    def status(self) -> SourceStatus:
        return SourceStatus("cameras", STEADY, names=frozenset({"r06"}))

    def close(self) -> None:
        self.closed = True


def test_the_arena_file_alone_says_which_bodies_join() -> None:
    assert set(SITE.virtual_beside_tracked()) == {"r08", "r09"}
    assert arena().virtual_beside_tracked() == {}
    emulated = table_of(arena())
    for robot in emulated["robots"].values():
        robot["emulate"] = ["body"]
    assert parse(emulated, "all").virtual_beside_tracked() == {}
    for site, kind in ((mixed(source="external"), WithVirtual), (arena(source="external"), ExternalSource)):
        source = open_source(site)
        assert type(source) is kind
        assert isinstance(source, OnNetwork)
        source.close()


def test_one_frame_holds_both_kinds_and_all_checks_apply() -> None:
    cameras = Cameras()
    source: Source = WithVirtual(SITE, cameras)
    assert isinstance(source, WithVirtual)
    pipeline = Pipeline(SITE, 1)
    reasons = []
    for k in range(4):
        now_ns = T0 + k * STEP_NS
        x_m = 2.0 + 0.006 * k + (0.9 if k == 3 else 0.0)
        if k:
            source.store(message(now_ns - 2_000_000, k, r08=(x_m, 2.0, 0.1 * k), r09=(3.0, 2.0, -3.1)))
        cameras.see(k + 1, now_ns)
        (frame,) = source.receive(now_ns + 7_000_000)
        found = pipeline.frame(frame, now_ns + 7_000_000)
        assert found.exposure_ns == now_ns
        reasons.append([body.reason for body in found.bodies])
        if k == 2:
            poses = {body.robot: (body.x_m, body.y_m, body.heading_rad) for body in found.bodies}
    assert reasons == [["", "missing", "missing"], ["", "", ""], ["", "", ""], ["", "jump", ""]]
    assert poses["r06"] == pytest.approx((1.0, 1.0, 0.5), abs=2e-3)
    ahead = 2_000_000 / STEP_NS
    assert poses["r08"] == pytest.approx((2.012 + 0.006 * ahead, 2.0, 0.2 + 0.1 * ahead), abs=2e-3)
    assert poses["r09"] == pytest.approx((3.0, 2.0, -3.1), abs=2e-3)
    source.close()
    assert cameras.closed


@given(
    speed=st.floats(-2.0, 2.0),
    turn=st.floats(-10.0, 10.0),
    start=st.floats(-math.pi, math.pi),
    later_ns=st.integers(-30_000_000, 30_000_000),
)
def test_a_body_that_moves_evenly_is_where_it_is_at_the_exposure(
    speed: float, turn: float, start: float, later_ns: int
) -> None:
    bodies = VirtualBodies(SITE)

    def truth(stamp_ns: int) -> tuple[float, float, float]:
        t = (stamp_ns - T0) * 1e-9
        return 2.0 + speed * t, 1.0 - speed * t, math.remainder(start + turn * t, math.tau)

    for k in range(3):
        bodies.take(message(T0 + k * STEP_NS, k, r08=truth(T0 + k * STEP_NS)))
    at_ns = T0 + 2 * STEP_NS + later_ns
    body = bodies.at(at_ns)["r08"]
    pose = bodies._axes.pose(body[1:4], body[4:8])
    x_m, y_m, heading_rad = truth(at_ns)
    assert (pose.x_m, pose.y_m) == pytest.approx((x_m, y_m), abs=1e-4)
    assert math.remainder(pose.heading_rad - heading_rad, math.tau) == pytest.approx(0.0, abs=1e-3)


def test_a_silent_stream_leaves_its_bodies_untracked_and_is_named() -> None:
    cameras = Cameras()
    source = WithVirtual(SITE, cameras)
    assert "r08, r09" in source.status().problem
    assert "mock-arena" in source.status().problem
    source.store(message(T0, 1, r08=(2.0, 2.0, 0.0), r09=(1.0, 2.0, 0.0)))
    for late_ns, tracked in ((STALE_NS, True), (STALE_NS + 1, False)):
        cameras.see(1, T0 + late_ns)
        (frame,) = source.receive(T0 + late_ns)
        assert bool(frame.bodies["r08"][9] & TRACKING_VALID) is tracked
        assert frame.bodies["r06"][9] & TRACKING_VALID
    assert source.status().problem == ""
    assert source.status().names == {"r06", "r08", "r09"}


def test_a_virtual_name_belongs_to_the_virtual_body_and_foreign_ones_are_left_out() -> None:
    cameras = Cameras()
    source = WithVirtual(SITE, cameras)
    source.store(message(T0, 1, r08=(2.0, 2.0, 0.0), r06=(0.0, 0.0, 0.0), ghost=(0.0, 0.0, 0.0)))
    source.store(message(T0 - STEP_NS, 2, r08=(9.0, 9.0, 0.0)))
    source.store(b"{}")
    cameras.see(1, T0, also="r08")
    (frame,) = source.receive(T0)
    pose = VirtualBodies(SITE)._axes.pose(frame.bodies["r08"][1:4], frame.bodies["r08"][4:8])
    assert (pose.x_m, pose.y_m) == pytest.approx((2.0, 2.0), abs=1e-3)
    assert set(frame.bodies) == {"r06", "r08"}
    assert source.status().counters == {"virtual_foreign": 2, "virtual_old": 1, "virtual_malformed": 1}


def test_the_mock_arenas_stream_keeps_its_period_and_tells_what_it_shows() -> None:
    stream = VirtualStream(120.0)
    poses = [BodyState("r08", 1.0, 2.0, 0.5)]
    assert [bool(stream.stream(T0 + k * 1_000_000, poses)) for k in range(18)] == [k in (0, 9, 17) for k in range(18)]
    (frame,) = stream.stream(T0 + 100_000_000, poses)
    assert (frame.seq, frame.stamp_ns, stream.next_due_ns) == (4, T0 + 100_000_000, T0 + 13 * STEP_NS)
    (body,) = decode(ExternalFrame, encode(frame)).bodies
    assert (body.body, body.x_m, body.y_m) == ("r08", pytest.approx(1.0, abs=2e-3), pytest.approx(2.0, abs=2e-3))
    assert body.heading_rad == 0.5


def test_virtual_bodies_that_stand_are_not_taken_for_frozen() -> None:
    cameras, stream, pipeline = Cameras(), VirtualStream(120.0), Pipeline(SITE, 1)
    source = WithVirtual(SITE, cameras)
    poses = [BodyState("r08", 2.0, 2.0, 0.1), BodyState("r09", 3.0, 2.0, 0.2)]
    reasons = set()
    for k in range(240):
        now_ns = T0 + k * 8_334_000
        for frame in stream.stream(now_ns, poses):
            source.store(encode(frame))
        cameras.see(k + 1, now_ns)
        (seen,) = source.receive(now_ns)
        reasons |= {body.reason for body in pipeline.frame(seen, now_ns).bodies if body.robot != "r06"}
    assert reasons == {""}

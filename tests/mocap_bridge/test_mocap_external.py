"""Poses from another system over the network, and from Qualisys: the pure receivers."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.codec import encode
from contract.messages import ExternalBody, ExternalFrame
from mocap_bridge.pipeline import Pipeline
from mocap_bridge.sources.external_receiver import ExternalReceiver
from mocap_bridge.sources.qualisys_receiver import Packet, QualisysReceiver, quaternion, setup_of
from tests.mocap_bridge.lockstep import arena

SITE = arena(up_axis="z", origin_m=[0.5, -1.0], rotation_rad=0.7)
T0 = 10**12


def payload(seq: int, stamp_ns: int = 0, x_m: float = 1.0, tracked: bool = True) -> bytes:
    body = ExternalBody(body="r06", x_m=x_m, y_m=2.0, heading_rad=-0.5, tracked=tracked)
    return encode(ExternalFrame(seq=seq, stamp_ns=stamp_ns, bodies=(body,)))


def test_external_pose_arrives_as_it_was_sent() -> None:
    frame = ExternalReceiver(SITE).receive(payload(1, T0 - 5_000_000), T0)
    assert frame is not None
    assert (frame.number, frame.exposure_ns, frame.received_ns) == (1, T0 - 5_000_000, T0)
    message = Pipeline(SITE, 1).frame(frame, T0)
    assert [(b.robot, b.valid, b.reason) for b in message.bodies] == [
        ("r06", True, ""),
        ("r08", False, "missing"),
        ("r09", False, "missing"),
    ]
    pose = message.bodies[0]
    assert (pose.x_m, pose.y_m, pose.heading_rad) == (1.0, 2.0, -0.5)


def test_external_jump_is_refused_like_any_other() -> None:
    receiver, pipeline = ExternalReceiver(SITE), Pipeline(SITE, 1)
    reasons = []
    for seq, x_m in enumerate([1.0, 1.001, 1.6], 1):
        frame = receiver.receive(payload(seq, T0 + seq * 10_000_000, x_m), T0 + seq * 10_000_000)
        assert frame is not None
        reasons.append(pipeline.frame(frame, T0).bodies[0].reason)
    assert reasons == ["", "", "jump"]


def test_external_order_restart_and_garbage() -> None:
    receiver = ExternalReceiver(SITE)
    step = 10_000_000
    results = [receiver.receive(payload(seq), T0 + k * step) for k, seq in enumerate([5, 5, 7, 1, 2])]
    assert [None if r is None else (r.session, r.number) for r in results] == [(0, 5), None, (0, 7), (1, 1), (1, 2)]
    assert receiver.receive(b"{}", T0) is None
    assert receiver.receive(payload(9, T0 - 10**10), T0) is None
    assert receiver.receive(payload(9, T0 + 10**9), T0) is None
    assert receiver.counters == {"duplicate": 1, "restart": 1, "malformed": 1, "stamp_not_now": 2}
    assert receiver.status("k").frames_dropped == 1


def test_external_status_says_where_to_publish() -> None:
    assert ExternalReceiver(SITE).status("lab/mocap/external").phase == "nobody publishes on lab/mocap/external"


BODIES = "".join(f"<Body><Name>{name}</Name></Body>" for name in ("r06", "r08"))
GENERAL = "<General><Frequency>120</Frequency></General>"
XML = f"<QTM_Parameters_Ver_1.25>{GENERAL}<The_6D><Bodies>2</Bodies>{BODIES}</The_6D></QTM_Parameters_Ver_1.25>"
NAN = (math.nan,) * 9


def yaw_matrix(angle: float) -> tuple[float, ...]:
    c, s = math.cos(angle), math.sin(angle)
    return (c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0)  # column by column


@given(st.floats(-3.14, 3.14))
def test_quaternion_of_a_turn_about_z(angle: float) -> None:
    x, y, z, w = quaternion(yaw_matrix(angle))
    assert math.hypot(x, y, z, w) == pytest.approx(1.0)
    assert math.remainder(2.0 * math.atan2(z, w) - angle, math.tau) == pytest.approx(0.0, abs=1e-6)


def test_qualisys_packets_become_frames_by_name() -> None:
    assert setup_of(XML) == (("r06", "r08"), 120.0)
    assert setup_of("<QTM_Parameters_Ver_1.25/>") == ((), 0.0)
    with pytest.raises(ValueError, match="QTM's parameters"):
        setup_of("Parse error")
    receiver = QualisysReceiver(setup_of(XML))
    bodies = [((1000.0, 2000.0, 50.0), yaw_matrix(0.5), 0.4), ((math.nan,) * 3, NAN, math.nan)]
    frame = receiver.receive(Packet(7, 5_000_000, bodies, T0))
    assert frame is not None
    site = arena(up_axis="z")
    first, second, third = Pipeline(site, 1).frame(frame, T0).bodies
    assert (first.x_m, first.y_m, first.heading_rad, first.valid) == (1.0, 2.0, 0.5, True)
    assert (second.reason, third.reason) == ("occluded", "missing")
    assert receiver.receive(Packet(7, 5_000_000, bodies, T0)) is None
    assert receiver.receive(Packet(9, 5_020_000, bodies, T0 + 20_000_000)) is not None
    assert receiver.dropped == 1
    loose = [(bodies[0][0], bodies[0][1], 12.0), bodies[1]]
    bad = receiver.receive(Packet(10, 5_030_000, loose, T0 + 30_000_000))
    assert bad is not None
    assert Pipeline(site, 1).frame(bad, T0).bodies[0].reason == "marker_error"
    assert receiver.receive(Packet(1, 10_000, bodies, T0 + 30_000_000)) is None
    assert (receiver.session, receiver.dropped) == (1, 1)

"""Messages survive the wire; anything else is refused with the message, the field and the fault."""

import contextlib
import math
import typing
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract import messages as m
from contract.codec import MAX_PAYLOAD_BYTES, WireError, decode, encode, json_schema
from contract.keys import KeyNameError, Keys

TOP_LEVEL = [
    kind
    for _, kind in sorted(vars(m).items())
    if isinstance(kind, type) and issubclass(kind, m.Message) and kind is not m.Message
]

POSE = m.BodyPose(robot="r06", x_m=1.0, y_m=2.0, heading_rad=0.5)
FRAME = m.MocapFrame(session=1, frame=2, exposure_ns=3, transmit_ns=4, publish_ns=5, rate_hz=120.0, bodies=(POSE,))
STATE = m.NeighbourState(
    robot="r06",
    boot=1,
    seq=2,
    stamp_ns=3,
    x_m=1.0,
    y_m=2.0,
    heading_rad=0.0,
    vx_mps=0.1,
    vy_mps=0.2,
    stop_long=(1.0, 2.0),
    stop_short=(1.0, 2.0),
    claim=4,
    claim_at=(1.5, 2.5),
    help=m.Help(robot="r08", hops=1),
    mail=(
        m.LinkMessage(
            to="r08", kind="lock", tx=m.TransactionId(coordinator="r06", boot=1, number=2), path=("r06", "r08")
        ),
    ),
)


@pytest.mark.parametrize("message", [FRAME, STATE, m.StopRequest(stamp_ns=1, source="cli", stop_id=2)])
def test_a_message_survives_the_wire(message: m.Message) -> None:
    assert decode(type(message), encode(message)) == message


def test_a_frame_of_twelve_robots_fits_one_datagram() -> None:
    bodies = tuple(m.BodyPose(robot=f"r{k:02d}", x_m=1.23456 + k, y_m=4.56789, heading_rad=-3.14159) for k in range(12))
    assert len(encode(msgspec.structs.replace(FRAME, bodies=bodies))) < 1150


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (b"", "Input data was truncated"),
        (b"{", "truncated"),
        (b"\xff\xfe", "MocapFrame"),
        (b"[]", "Expected `object`"),
        (encode(STATE), "unknown field"),
        (encode(FRAME).replace(b'"frame":2', b'"frame":-2'), "$.frame"),
        (encode(FRAME).replace(b'"frame":2', b'"frame":null'), "$.frame"),
        (encode(FRAME).replace(b'"x_m":1.0', b'"x_m":NaN'), "malformed"),
        (encode(FRAME).replace(b'"x_m":1.0', b'"x_m":1e9'), "$.bodies[0].x_m"),
        (encode(FRAME).replace(b'"robot":"r06"', b'"robot":"r0600000000000000"'), "$.bodies[0].robot"),
        (encode(FRAME).replace(b'"session":1,', b""), "missing required field `session`"),
        (b" " * (MAX_PAYLOAD_BYTES + 1), "bytes"),
        (b"[" * 60000, "MocapFrame"),
    ],
)
def test_what_is_not_the_message_is_refused_by_name(payload: bytes, words: str) -> None:
    with pytest.raises(WireError, match="MocapFrame") as caught:
        decode(m.MocapFrame, payload)
    assert words in str(caught.value)


@given(st.binary(max_size=200), st.sampled_from(TOP_LEVEL))
def test_no_payload_crashes_the_decoder(payload: bytes, kind: type[m.Message]) -> None:
    with contextlib.suppress(WireError):
        decode(kind, payload)


@given(st.integers(0, len(encode(STATE)) - 1), st.integers(0, 7))
def test_one_flipped_bit_is_refused_or_still_a_message_within_bounds(index: int, bit: int) -> None:
    payload = bytearray(encode(STATE))
    payload[index] ^= 1 << bit
    try:
        state = decode(m.NeighbourState, bytes(payload))
    except WireError:
        return
    assert abs(state.x_m) <= 1000
    assert all(math.isfinite(v) for v in (state.x_m, state.y_m, state.vx_mps, *state.stop_long, *state.stop_short))


@pytest.mark.parametrize("kind", TOP_LEVEL)
def test_every_message_has_a_schema_and_frozen_fields(kind: type[m.Message]) -> None:
    schema: dict[str, Any] = json_schema(kind)
    assert schema["$ref"].endswith(kind.__name__)
    assert kind.__struct_config__.frozen
    assert kind.__struct_config__.forbid_unknown_fields


def test_every_key_names_its_message_and_its_robot() -> None:
    keys = Keys("lab6")
    hints = typing.get_type_hints
    assert hints(Keys.kind)["return"] is not None
    for key, kind in [
        (keys.mocap_frame, m.MocapFrame),
        (keys.mocap_health, m.MocapHealth),
        (keys.heartbeat, m.StationHeartbeat),
        (keys.targets, m.TargetCloud),
        (keys.status, m.RunStatus),
        (keys.stop, m.StopRequest),
        (keys.state("r06"), m.NeighbourState),
        (keys.report("r06"), m.RobotReport),
        (keys.steps("r06"), m.StepBatch),
        (keys.feedback("r06"), m.FeedbackBatch),
        (keys.motor("r06"), m.MotorBatch),
        (keys.log("bridge"), m.LogEntry),
    ]:
        assert keys.kind(key) is kind
        assert keys.robot_of(key) == ("r06" if "r06" in key else None)
        assert Keys("other").kind(key) is None
    assert keys.kind("lab6/nonsense") is None


@pytest.mark.parametrize("name", ["", "a/b", "a*", "$x", "R06", "x" * 33])
def test_a_name_that_is_no_chunk_is_refused(name: str) -> None:
    with pytest.raises(KeyNameError):
        Keys(name)
    with pytest.raises(KeyNameError):
        Keys("lab6").state(name)

"""Play back a recording as if it happened now: raw NatNet datagrams, or the frames of a mission."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from contract.arena import Arena
from contract.codec import WireError, decode
from contract.keys import Keys
from contract.messages import MocapFrame
from mocap_bridge.frames import ArenaFrame
from mocap_bridge.natnet.frame import TRACKING_VALID, Body
from mocap_bridge.natnet.version import Version
from mocap_bridge.sources.base import STEADY, SourceFrame, SourceStatus
from mocap_bridge.sources.natnet_receiver import NatNetReceiver
from mocap_bridge.sources.tape import TapePlayer
from mocap_bridge.sources.tape_file import TapeError, read_tape

LEAD_NS = 100_000_000
"""The first frame is due this long after the start."""
MAX_BATCH = 64


class Recorded(NamedTuple):
    """A frame and when it came in."""

    received_ns: int
    frame: SourceFrame


def natnet_frames(path: Path, receiver: NatNetReceiver) -> Iterator[Recorded]:
    """Frames of a tape of raw datagrams.

    :raises TapeError: not such a tape.
    """
    for frame in TapePlayer(receiver).frames(read_tape(path)):
        yield Recorded(frame.received_ns, frame)


def mission_frames(path: Path, arena: Arena) -> Iterator[Recorded]:
    """Frames of a mission's recording, back in the source's axes; invalid bodies stay invalid.

    :raises TapeError: not an MCAP file, or none of this site's frames in it.
    """
    key = Keys(arena.arena.name).mocap_frame
    axes = ArenaFrame(arena.mocap)
    channels: set[int] = set()
    try:
        with path.open("rb") as file:
            for record in StreamReader(file).records:
                if isinstance(record, Channel) and record.topic.strip("/") == key:
                    channels.add(record.id)
                elif isinstance(record, Message) and record.channel_id in channels:
                    frame = _source_frame(decode(MocapFrame, record.data), arena, axes)
                    yield Recorded(frame.received_ns, frame)
    except OSError as error:
        raise TapeError(f"{path}: {error.strerror or error}") from None
    except WireError as error:
        raise TapeError(f"{path}: {error}") from None
    except (McapError, ValueError):
        pass
    if not channels:
        raise TapeError(f"{path}: neither NatNet datagrams nor frames of {key}")


def _source_frame(message: MocapFrame, arena: Arena, axes: ArenaFrame) -> SourceFrame:
    bodies: dict[str, Body] = {}
    for body in message.bodies:
        robot = arena.robots.get(body.robot)
        if robot is not None:
            at, turned = axes.source(body.x_m, body.y_m, body.heading_rad, 0.0, robot.heading_offset_rad)
            bodies[robot.body] = (0, *at, *turned, 0.0, TRACKING_VALID if body.valid else 0)
    return SourceFrame(
        message.session,
        message.frame,
        message.exposure_ns,
        message.transmit_ns,
        message.publish_ns,
        0,
        bodies,
    )


class ReplaySource:
    """Paces recorded frames by their times of arrival, with stamps moved to now."""

    def __init__(self, arena: Arena, path: Path) -> None:
        self._path = path
        self._receiver = NatNetReceiver("replay", Version(4, 1), bool(arena.mocap.multicast_group))
        try:
            self._frames = natnet_frames(path, self._receiver)
            self._next: Recorded | None = next(self._frames, None)
        except TapeError:
            self._frames = mission_frames(path, arena)
            self._next = next(self._frames, None)
        self._shift_ns: int | None = None
        self._first_session: int | None = None
        self._ended = False

    def wait(self, timeout_s: float) -> None:
        """Until the next frame is due, at most ``timeout_s``."""
        if self._next is not None and self._shift_ns is not None:
            due_s = (self._next.received_ns + self._shift_ns - time.monotonic_ns()) * 1e-9
            timeout_s = min(timeout_s, due_s)
        time.sleep(max(timeout_s, 0.0))

    def receive(self, now_ns: int) -> list[SourceFrame]:
        """Frames due by now."""
        out: list[SourceFrame] = []
        while self._next is not None and len(out) < MAX_BATCH:
            if self._shift_ns is None:
                self._shift_ns = now_ns + LEAD_NS - self._next.received_ns
                self._first_session = self._next.frame.session
            if self._next.received_ns + self._shift_ns > now_ns:
                break
            out.append(self._moved(self._next.frame))
            self._next = next(self._frames, None)
        return out

    def _moved(self, frame: SourceFrame) -> SourceFrame:
        shift = self._shift_ns or 0
        return frame._replace(
            session=frame.session - (self._first_session or 0),
            exposure_ns=frame.exposure_ns + shift,
            transmit_ns=frame.transmit_ns + shift,
            received_ns=frame.received_ns + shift,
        )

    def status(self) -> SourceStatus:
        ended = "" if self._next is not None else f"{self._path.name} has been played to its end"
        return SourceStatus(
            name=f"replay of {self._path.name}"[:64],
            phase=STEADY,
            problem=ended,
            nominal_rate_hz=self._receiver.client.nominal_rate_hz,
            malformed=self._receiver.client.counters["malformed"],
            counters=self._receiver.client.counters + self._receiver.counters,
        )

    def close(self) -> None:
        self._next = None

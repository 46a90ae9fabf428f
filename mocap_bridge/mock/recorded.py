"""Bodies that move as they did in a mission's recording. Pure."""

from collections.abc import Iterator

from contract.arena import Arena
from mocap_bridge.frames import ArenaFrame
from mocap_bridge.mock.bodies import BodyState
from mocap_bridge.natnet.frame import TRACKING_VALID
from mocap_bridge.sources.base import SourceFrame


class RecordedBodies:
    """Where every body is, from the start of the recording on; :attr:`ended` after its last frame."""

    def __init__(self, arena: Arena, frames: Iterator[SourceFrame]) -> None:
        self._axes = ArenaFrame(arena.mocap)
        self._offsets = {robot.body: robot.heading_offset_rad for robot in arena.robots.values()}
        self._frames = frames
        self._next = next(frames, None)
        self._start_ns = self._next.received_ns if self._next else 0
        self._poses: list[BodyState] = []
        self.ended = self._next is None

    def poses(self, elapsed_s: float) -> list[BodyState]:
        """The newest recorded frame by then."""
        newest = None
        while self._next is not None and (self._next.received_ns - self._start_ns) * 1e-9 <= elapsed_s:
            newest, self._next = self._next, next(self._frames, None)
        if newest is not None:
            self._poses = [self._state(name, newest) for name in newest.bodies]
        self.ended = self._next is None
        return self._poses

    def _state(self, name: str, frame: SourceFrame) -> BodyState:
        body = frame.bodies[name]
        pose = self._axes.pose(body[1:4], body[4:8], self._offsets.get(name, 0.0))
        return BodyState(name, pose.x_m, pose.y_m, pose.heading_rad, bool(body[9] & TRACKING_VALID))

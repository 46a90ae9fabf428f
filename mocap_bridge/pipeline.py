"""From a source's frame to the message everybody steers by. Pure; the same in lockstep and in real time."""

from contract.arena import Arena
from contract.messages import MocapFrame, MocapHealth
from mocap_bridge.checks import Checker
from mocap_bridge.health import Health
from mocap_bridge.sources.base import SourceFrame, SourceStatus


class Pipeline:
    """Checks, frame and health of one arena.

    :param session: number of the first session; a bridge that starts anew must not reuse numbers, so
        the shell passes its monotonic clock in milliseconds.
    """

    def __init__(self, arena: Arena, session: int, allow_edited: bool = False) -> None:
        self.checker = Checker(arena, allow_edited)
        self.health = Health(arena.mocap.frame_rate_hz)
        self._base = session
        self._session = session

    def frame(self, frame: SourceFrame, now_ns: int) -> MocapFrame:
        """The message to publish for a frame, at once."""
        if self._base + frame.session != self._session:
            self._session = self._base + frame.session
            self.checker.restart()
        self.health.frame(frame, now_ns)
        return MocapFrame(
            session=self._session,
            frame=frame.number,
            exposure_ns=max(frame.exposure_ns, 0),
            transmit_ns=max(frame.transmit_ns, 0),
            publish_ns=now_ns,
            rate_hz=self.health.rate_hz,
            bodies=self.checker.check(frame),
        )

    def report(self, status: SourceStatus, now_ns: int) -> MocapHealth:
        """The health message."""
        return self.health.message(status, self.checker.tracks, self._session, now_ns)

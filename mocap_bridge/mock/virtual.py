"""Virtual bodies beside tracked ones: their poses go to the bridge as messages, since the cameras are another's."""

from collections.abc import Callable, Iterable

from contract.messages import ExternalBody, ExternalFrame
from contract.units import metres, radians
from mocap_bridge.mock.bodies import BodyState


class VirtualStream:
    """Frames at multiples of the period from the first call. Pure; drives like an emulated server."""

    def __init__(self, rate_hz: float) -> None:
        self.next_due_ns = 0
        """When :meth:`stream` has something to send again; 0 until its first call."""
        self._period_ns = round(1e9 / rate_hz)
        self._seq = 0

    def stream(
        self, now_ns: int, poses: Iterable[BodyState], clock: Callable[[], int] | None = None
    ) -> list[ExternalFrame]:
        """What is due at ``now_ns``; ``poses`` hold then. A late call leaves out the frames it missed."""
        if now_ns < self.next_due_ns:
            return []
        due_ns = self.next_due_ns or now_ns
        self.next_due_ns = due_ns + ((now_ns - due_ns) // self._period_ns + 1) * self._period_ns
        self._seq += 1
        bodies = tuple(
            ExternalBody(
                body=pose.name, x_m=metres(pose.x_m), y_m=metres(pose.y_m), heading_rad=radians(pose.heading_rad)
            )
            for pose in poses
        )
        return [ExternalFrame(seq=self._seq, stamp_ns=now_ns, bodies=bodies)]


class VirtualShell:
    """A stream in the place of :class:`mocap_bridge.mock.udp.ServerShell`; ``publish`` sends to the bridge."""

    def __init__(self, stream: VirtualStream, publish: Callable[[ExternalFrame], None]) -> None:
        self._stream = stream
        self._publish = publish
        self.damage: Callable[[bytes], bytes] | None = None
        """Unused: no datagram leaves here."""

    def fds(self) -> list[int]:
        return []

    def on_readable(self, fd: int, now_ns: int) -> None:
        """Never called: there is nothing to answer."""

    def stream(self, now_ns: int, poses: Iterable[BodyState], clock: Callable[[], int] | None = None) -> None:
        for frame in self._stream.stream(now_ns, poses, clock):
            self._publish(frame)

    def close(self) -> None:
        return

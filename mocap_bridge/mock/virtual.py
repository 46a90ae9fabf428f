"""Virtual bodies beside tracked ones: their poses go to the bridge as messages, since the cameras are another's."""

import random
from collections.abc import Callable, Iterable

from contract.messages import ExternalBody, ExternalFrame
from contract.units import metres, radians
from mocap_bridge.mock.bodies import NOISE_M, BodyState


class VirtualStream:
    """Frames at multiples of the period from the first call. Pure; drives like an emulated server.

    Places have an emulated camera's noise: whoever sends bit for bit the same pose for long has frozen.
    """

    def __init__(self, rate_hz: float, seed: int = 0) -> None:
        self.next_due_ns = 0
        """When :meth:`stream` has something to send again; 0 until its first call."""
        self._period_ns = round(1e9 / rate_hz)
        self._seq = 0
        self._random = random.Random(seed)

    def stream(
        self, now_ns: int, poses: Iterable[BodyState], clock: Callable[[], int] | None = None
    ) -> list[ExternalFrame]:
        """What is due at ``now_ns``; ``poses`` hold then. A late call leaves out the frames it missed."""
        if now_ns < self.next_due_ns:
            return []
        due_ns = self.next_due_ns or now_ns
        self.next_due_ns = due_ns + ((now_ns - due_ns) // self._period_ns + 1) * self._period_ns
        self._seq += 1
        gauss = self._random.gauss
        bodies = tuple(
            ExternalBody(
                body=pose.name,
                x_m=metres(pose.x_m + gauss(0.0, NOISE_M)),
                y_m=metres(pose.y_m + gauss(0.0, NOISE_M)),
                heading_rad=radians(pose.heading_rad),
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

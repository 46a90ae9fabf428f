"""A robot on a stand: real wheels off the ground, and a virtual body that rolls as they say they turn. Pure."""

from contract.arena import Platform
from contract.messages import WheelFeedback
from contract.units import Point
from drivers.mock.body import Body

STALE_NS = 300_000_000
"""A wheel not heard of for longer is not taken to turn on."""
SLACK_RAD = 0.5
"""An angle that jumps by more than speed and time explain counts from somewhere else."""


class Stand:
    """The body behind measured wheels. Between samples it rolls on at the last measured speeds."""

    def __init__(self, platform: Platform, start: Point, heading_rad: float) -> None:
        self._body = Body(platform, start, heading_rad)
        self._last: WheelFeedback | None = None
        self._left_rad = 0.0
        self._right_rad = 0.0

    def measured(self, sample: WheelFeedback) -> None:
        """Take a sample; one older than the last is left out. Angles begin anew when the driver is activated."""
        last = self._last
        if last is not None and sample.stamp_ns <= last.stamp_ns:
            return
        self._last = sample
        if last is None or not _continues(last, sample):
            return
        self._left_rad += sample.left_rad - last.left_rad
        self._right_rad += sample.right_rad - last.right_rad
        self._body.roll(self._left_rad, self._right_rad)

    def pose(self, now_ns: int) -> tuple[float, float, float]:
        """x in m, y in m, heading in rad; rolled on from the last sample."""
        body, last = self._body, self._last
        if last is None:
            return body.x_m, body.y_m, body.heading_rad
        ahead_s = min(max(0, now_ns - last.stamp_ns), STALE_NS) * 1e-9
        return body.ahead(last.left_radps * ahead_s, last.right_radps * ahead_s)


def _continues(last: WheelFeedback, sample: WheelFeedback) -> bool:
    if sample.left_rad == 0.0 == sample.right_rad:
        return False
    elapsed_s = (sample.stamp_ns - last.stamp_ns) * 1e-9
    fastest = max(abs(speed) for s in (last, sample) for speed in (s.left_radps, s.right_radps))
    bound = 2.0 * fastest * elapsed_s + SLACK_RAD
    return abs(sample.left_rad - last.left_rad) <= bound and abs(sample.right_rad - last.right_rad) <= bound

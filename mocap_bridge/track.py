"""What is known of one robot's body from frame to frame. Pure."""

from collections import Counter

from mocap_bridge.frames import Pose
from mocap_bridge.natnet.frame import Body


class Track:
    """One robot's body: last believed pose, and what speaks against the present one."""

    __slots__ = (
        "accepted_ns",
        "believed",
        "body",
        "candidate",
        "candidate_ns",
        "changed_ns",
        "consistent",
        "faults",
        "offset_rad",
        "place",
        "pose",
        "raw",
        "reason",
        "resets",
        "robot",
        "since_ns",
    )

    def __init__(self, robot: str, body: str, offset_rad: float) -> None:
        self.robot = robot
        self.body = body
        self.offset_rad = offset_rad
        self.pose = Pose(0.0, 0.0, 0.0, 0.0, 1.0)
        """Last believed."""
        self.place = self.pose
        """Where its robot must be: the last believed pose, then whatever unbelieved body moves on from there."""
        self.believed: Body = (0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0)
        """As the source gave it."""
        self.accepted_ns = -1
        self.since_ns = 0
        """Start of the present unbroken run of believed poses."""
        self.candidate: tuple[Pose, Body] | None = None
        """Pose of the last frame while rejected."""
        self.candidate_ns = 0
        self.consistent = 0
        self.raw: Body | None = None
        self.changed_ns = 0
        self.reason = "missing"
        self.resets = 0
        self.faults: Counter[str] = Counter()

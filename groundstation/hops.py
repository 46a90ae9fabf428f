"""The way of a lockstep mission from bodies to agents and back: the interface, and the way without bytes. Pure."""

from collections.abc import Mapping
from typing import Any, Protocol

from contract.arena import Arena
from contract.messages import BodyPose, Message, MocapFrame, WheelFeedback
from contract.units import metres, radians
from groundstation.plant import Body, Plant
from onboard.agent import Agent, Drive
from onboard.ahdc.parameters import Vector
from onboard.ahdc.stopping import Brake
from onboard.odometry import Pose


class Hops(Protocol):
    """Everything between bodies and agents. Times are virtual; every call returns at once."""

    begin_ns: int
    """When all is connected: the mission's time zero."""
    way_ns: int
    """Exposure to publication of a frame."""

    def free_ns(self, name: str) -> int:
        """Until when the robot's process waits for its motors and hears nothing; 0: not at all."""

    def advance(self, now_ns: int) -> None:
        """Let motors, bodies and whatever sends by itself come to ``now_ns``."""

    def pose(self, name: str) -> Pose:
        """True pose, as of the last :meth:`advance`."""

    def places(self) -> dict[str, Vector]:
        """Where all robots truly are, m, as of the last :meth:`advance`."""

    def place(self, name: str, pose: Pose) -> None:
        """A hand puts the robot there."""

    def frame(self, now_ns: int, seen: Mapping[str, Pose]) -> Any:
        """What is published of a frame that shows the robots there; None: nothing."""

    def pack(self, key: str, message: Message) -> Any:
        """A message as it leaves its sender."""

    def deliver(self, name: str, key: str, parcel: Any, now_ns: int) -> bool:
        """Give a robot what was published or packed; True: a control step is due."""

    def sense(self, name: str, now_ns: int) -> None:
        """Tell the agent what its wheels do."""

    def drive(self, name: str, drive: Drive, now_ns: int) -> bool:
        """Obey the agent; True if wheel speeds were written."""

    def replace(self, name: str, now_ns: int) -> None:
        """The robot's agent is another one: a new process, with the port opened anew."""

    def hang(self, name: str, on: bool) -> None:
        """The robot's process stands still, or goes on: nothing is written, read or asked for meanwhile."""


class ShortCut:
    """:class:`Hops` without bytes: messages as they are, a command acts at once, feedback is the truth."""

    begin_ns = 0
    way_ns = 0

    def __init__(self, arena: Arena, plants: Mapping[str, Plant], agents: Mapping[str, Agent]) -> None:
        self._agents = agents
        coast = Brake(arena.platform.coast_deceleration_mps2, 0.0)
        self._bodies = {name: Body(*plant, coast=coast) for name, plant in plants.items()}
        self._everybody = list(self._bodies.values())
        self._watchdog_ns = int(arena.safety.watchdog_s * 1e9)
        self._separation_m = arena.platform.wheel_separation_m
        self._radius_m = arena.platform.wheel_radius_m
        self._rate_hz = arena.mocap.frame_rate_hz
        self._number = 0

    def free_ns(self, name: str) -> int:
        return 0

    def advance(self, now_ns: int) -> None:
        separation_m = self._separation_m
        for body in self._everybody:
            if body.time_ns < now_ns:
                body.advance(now_ns, separation_m)

    def pose(self, name: str) -> Pose:
        return self._bodies[name].pose

    def places(self) -> dict[str, Vector]:
        return {name: (body.x_m, body.y_m) for name, body in self._bodies.items()}

    def place(self, name: str, pose: Pose) -> None:
        self._bodies[name].place(pose)

    def frame(self, now_ns: int, seen: Mapping[str, Pose]) -> MocapFrame:
        frame = MocapFrame(
            session=1,
            frame=self._number,
            exposure_ns=now_ns,
            transmit_ns=now_ns,
            publish_ns=now_ns,
            rate_hz=self._rate_hz,
            bodies=tuple(
                BodyPose(robot=name, x_m=metres(x), y_m=metres(y), heading_rad=radians(heading))
                for name, (x, y, heading) in seen.items()
            ),
        )
        self._number += 1
        return frame

    def pack(self, key: str, message: Message) -> Message:
        return message

    def deliver(self, name: str, key: str, parcel: Message, now_ns: int) -> bool:
        return self._agents[name].receive(parcel, now_ns)

    def hang(self, name: str, on: bool) -> None:
        body = self._bodies[name]
        body.release_ns = body.time_ns + self._watchdog_ns if on else None
        if not on:
            body.command = (0.0, 0.0)

    def replace(self, name: str, now_ns: int) -> None:
        """Nothing is kept here that knows the old one."""

    def sense(self, name: str, now_ns: int) -> None:
        body = self._bodies[name]
        if body.time_ns < now_ns:
            body.advance(now_ns, self._separation_m)
        sample = WheelFeedback(
            robot=name,
            stamp_ns=now_ns,
            left_radps=body.left_mps / self._radius_m,
            right_radps=body.right_mps / self._radius_m,
            left_rad=0.0,
            right_rad=0.0,
            enabled=True,
        )
        self._agents[name].feedback(sample, now_ns)

    def drive(self, name: str, drive: Drive, now_ns: int) -> bool:
        self._agents[name].driver_active(drive.enable, now_ns)
        command = (drive.left_radps * self._radius_m, drive.right_radps * self._radius_m)
        self._bodies[name].command = command if drive.enable else (0.0, 0.0)
        return True

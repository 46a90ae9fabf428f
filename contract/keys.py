"""Every Zenoh key of the kit; nothing else spells one.

<site>/mocap/frame            MocapFrame        whole frame, real time, latest wins
<site>/mocap/health           MocapHealth
<site>/mocap/external         ExternalFrame     poses from another system, to the bridge
<site>/mocap/virtual          ExternalFrame     virtual bodies where others are tracked, to the bridge
<site>/station/heartbeat      StationHeartbeat  20 Hz, silence stops robots
<site>/station/targets        TargetCloud       cached for late joiners
<site>/station/status         RunStatus
<site>/station/seed           TargetCloud       an operator's wish; the station decides
<site>/station/order          OrderRequest      an operator's wish; the station decides
<site>/stop                   StopRequest       anybody; latches
<site>/robot/<id>/state       NeighbourState    to the robots in radio range
<site>/robot/<id>/report      RobotReport
<site>/robot/<id>/steps       StepBatch
<site>/robot/<id>/feedback    FeedbackBatch
<site>/robot/<id>/inputs      InputBatch        what its agent was given, for replay
<site>/motor/<id>             MotorBatch        from the emulated controllers only
<site>/log/<source>           LogEntry
<site>/clock/ask/<source>     ClockAsk          what time is it? from robots and station to the bridge
<site>/clock/tell/<source>    ClockTell         the bridge's answer
<site>/presence/<source>      liveliness token: presence, never a safety signal
"""

import re
from dataclasses import dataclass

from contract import messages as m

_CHUNK = re.compile(r"^[a-z0-9_-]{1,32}$")


class KeyNameError(ValueError):
    """A name that cannot be a chunk of a key."""


@dataclass(frozen=True)
class Keys:
    """The keys of one site."""

    site: str

    def __post_init__(self) -> None:
        self._chunk("site", self.site)

    @staticmethod
    def _chunk(what: str, name: str) -> str:
        if not _CHUNK.match(name):
            raise KeyNameError(f"{what} {name!r}: 1 to 32 of a-z 0-9 _ - allowed")
        return name

    @property
    def mocap_frame(self) -> str:
        return f"{self.site}/mocap/frame"

    @property
    def mocap_health(self) -> str:
        return f"{self.site}/mocap/health"

    @property
    def external(self) -> str:
        return f"{self.site}/mocap/external"

    @property
    def virtual(self) -> str:
        return f"{self.site}/mocap/virtual"

    @property
    def heartbeat(self) -> str:
        return f"{self.site}/station/heartbeat"

    @property
    def targets(self) -> str:
        return f"{self.site}/station/targets"

    @property
    def status(self) -> str:
        return f"{self.site}/station/status"

    @property
    def seed(self) -> str:
        return f"{self.site}/station/seed"

    @property
    def order(self) -> str:
        return f"{self.site}/station/order"

    @property
    def stop(self) -> str:
        return f"{self.site}/stop"

    def state(self, robot: str) -> str:
        return f"{self.site}/robot/{self._chunk('robot', robot)}/state"

    def report(self, robot: str) -> str:
        return f"{self.site}/robot/{self._chunk('robot', robot)}/report"

    def steps(self, robot: str) -> str:
        return f"{self.site}/robot/{self._chunk('robot', robot)}/steps"

    def feedback(self, robot: str) -> str:
        return f"{self.site}/robot/{self._chunk('robot', robot)}/feedback"

    def inputs(self, robot: str) -> str:
        return f"{self.site}/robot/{self._chunk('robot', robot)}/inputs"

    def motor(self, robot: str) -> str:
        return f"{self.site}/motor/{self._chunk('robot', robot)}"

    def log(self, source: str) -> str:
        return f"{self.site}/log/{self._chunk('source', source)}"

    def presence(self, source: str) -> str:
        return f"{self.site}/presence/{self._chunk('source', source)}"

    def clock_ask(self, source: str) -> str:
        return f"{self.site}/clock/ask/{self._chunk('source', source)}"

    def clock_tell(self, source: str) -> str:
        return f"{self.site}/clock/tell/{self._chunk('source', source)}"

    @property
    def everything(self) -> str:
        """Selector of all data of the site, for the recorder."""
        return f"{self.site}/**"

    def kind(self, key: str) -> type[m.Message] | None:
        """The message a key carries, None for a key that is not ours."""
        chunks = key.split("/")
        if chunks[0] != self.site:
            return None
        match chunks[1:]:
            case ["mocap", "frame"]:
                return m.MocapFrame
            case ["mocap", "health"]:
                return m.MocapHealth
            case ["mocap", "external" | "virtual"]:
                return m.ExternalFrame
            case ["station", "heartbeat"]:
                return m.StationHeartbeat
            case ["station", "targets" | "seed"]:
                return m.TargetCloud
            case ["station", "status"]:
                return m.RunStatus
            case ["station", "order"]:
                return m.OrderRequest
            case ["stop"]:
                return m.StopRequest
            case ["robot", _, "state"]:
                return m.NeighbourState
            case ["robot", _, "report"]:
                return m.RobotReport
            case ["robot", _, "steps"]:
                return m.StepBatch
            case ["robot", _, "feedback"]:
                return m.FeedbackBatch
            case ["robot", _, "inputs"]:
                return m.InputBatch
            case ["motor", _]:
                return m.MotorBatch
            case ["log", _]:
                return m.LogEntry
            case ["clock", "ask", _]:
                return m.ClockAsk
            case ["clock", "tell", _]:
                return m.ClockTell
            case _:
                return None

    def robot_of(self, key: str) -> str | None:
        """The robot whose key this is, None for the others."""
        chunks = key.split("/")
        if len(chunks) == 4 and chunks[1] == "robot":
            return chunks[2]
        return chunks[2] if len(chunks) == 3 and chunks[1] == "motor" else None

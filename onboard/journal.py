"""An agent that writes down everything it was given, in order, so that a recording can be replayed. Pure.

Inputs are recorded where they come from; the journal only names them: which frame, whose message, when.
"""

from zlib import crc32

from contract.arena import Arena
from contract.codec import encode
from contract.keys import Keys
from contract.messages import (
    Input,
    InputBatch,
    InputKind,
    Message,
    MocapFrame,
    NeighbourState,
    RobotReport,
    StationHeartbeat,
    StopRequest,
    TargetCloud,
    WheelFeedback,
)
from onboard.agent import Agent, Drive


def named(message: Message, payload: bytes = b"") -> tuple[InputKind, str, int, int, int] | None:
    """What tells a message from every other: kind, word, origin, number and check of its :class:`Input`.

    None: not an input. Checked are the messages that no other robot's replay would find out, by their
    payload (encoded here if it is not given).
    """
    match message:
        case MocapFrame():
            return ("frame", "", message.session, message.frame, crc32(payload or encode(message)))
        case NeighbourState():
            return ("state", message.robot, message.boot, message.seq, 0)
        case StationHeartbeat():
            return ("heartbeat", "", message.boot, message.seq, 0)
        case StopRequest():
            return ("stop", message.source, message.stop_id, message.stamp_ns, 0)
        case TargetCloud():
            return ("targets", message.mission, 0, 0, crc32(payload or encode(message)))
        case _:
            return None


class JournalledAgent(Agent):
    """:class:`onboard.agent.Agent` that publishes its journal after each report, steps and feedback."""

    def __init__(self, arena: Arena, robot: str, boot: int, software: str = "") -> None:
        super().__init__(arena, robot, boot, software)
        self._inputs_key = Keys(arena.arena.name).inputs(robot)
        self._entries: list[Input] = []
        self._batches = 0
        self._since_ns = self._noted_ns = 0

    def _enter(
        self, now_ns: int, kind: InputKind, word: str = "", origin: int = 0, number: int = 0, check: int = 0
    ) -> None:
        if not self._entries:
            self._since_ns = self._noted_ns = now_ns
        self._entries.append(Input(kind, now_ns - self._noted_ns, word, origin, number, check))
        self._noted_ns = now_ns

    def receive(self, message: Message, now_ns: int, payload: bytes = b"") -> bool:
        name = named(message, payload)
        if name is not None:
            self._enter(now_ns, *name)
        return super().receive(message, now_ns)

    def feedback(self, sample: WheelFeedback, now_ns: int) -> None:
        super().feedback(sample, now_ns)
        if self._feedback is sample:
            self._enter(now_ns, "feedback", number=sample.stamp_ns)

    def driver_fault(self, text: str, remedy: str, now_ns: int) -> None:
        self._enter(now_ns, "fault", text[:400])
        super().driver_fault(text, remedy, now_ns)

    def driver_active(self, active: bool, now_ns: int) -> None:
        self._enter(now_ns, "active", number=int(active))
        super().driver_active(active, now_ns)

    def step(self, now_ns: int) -> Drive:
        self._enter(now_ns, "step")
        return super().step(now_ns)

    def tick(self, now_ns: int) -> Drive:
        self._enter(now_ns, "tick")
        return super().tick(now_ns)

    def wrote(self, write_ns: int) -> None:
        self._enter(write_ns, "wrote")
        super().wrote(write_ns)

    def outbox(self, now_ns: int) -> list[tuple[str, Message]]:
        self._enter(now_ns, "outbox")
        out = super().outbox(now_ns)
        if any(isinstance(message, RobotReport) for _, message in out):
            batch = InputBatch(
                robot=self.robot,
                boot=self.boot,
                number=self._batches,
                since_ns=self._since_ns,
                inputs=tuple(self._entries),
            )
            out.append((self._inputs_key, batch))
            self._batches += 1
            self._entries = []
        return out

"""Recorded inputs through the same agent, and what it says compared with what was recorded. Pure."""

from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from contract.arena import Arena
from contract.messages import (
    FeedbackBatch,
    Input,
    InputBatch,
    Message,
    NeighbourState,
    RobotStep,
    StepBatch,
    WheelFeedback,
)
from onboard.agent import Agent
from onboard.journal import named

CONTEXT = 12
"""Inputs shown before a difference."""

Name = tuple[str, str, int, int]
Life = tuple[str, int]
"""A robot and one boot of it."""


class Incomplete(ValueError):
    """The recording lacks something the agent was given."""


class Difference(NamedTuple):
    """The first thing a replayed agent did otherwise."""

    what: str
    at_ns: int
    recorded: Message | None
    """None: the robot did not do this."""
    replayed: Message | None
    """None: the replayed agent did not do this."""
    context: tuple[tuple[int, Input], ...]
    """Time and input, newest last."""

    def fields(self) -> list[tuple[str, object, object]]:
        """Field, recorded and replayed value of every field that differs."""
        if self.recorded is None or self.replayed is None:
            return []
        names = self.recorded.__struct_fields__
        pairs = [(name, getattr(self.recorded, name), getattr(self.replayed, name, None)) for name in names]
        return [pair for pair in pairs if pair[1] != pair[2]]


class Outcome(NamedTuple):
    """What became of one robot's replay."""

    robot: str
    boot: int
    inputs: int = 0
    steps: int = 0
    """Control steps equal in every bit, wheel speeds above all."""
    states: int = 0
    """Messages to neighbours equal in every bit."""
    altered: tuple[str, ...] = ()
    """Inputs that are recorded otherwise than the robot received them."""
    unrecorded: int = 0
    """What the replayed agent said and the recording lacks: it cannot be judged."""
    lost_states: tuple[NeighbourState, ...] = ()
    """Those of them that other robots may have received."""
    difference: Difference | None = None
    problem: str = ""
    """Why it could not be replayed to the end."""

    @property
    def good(self) -> bool:
        """Replayed from the agent's start to the journal's end, something compared, and all of it equal."""
        return not self.problem and not self.altered and self.difference is None and self.steps > 0


class Archive:
    """A recording's messages, found by what a journal names them."""

    def __init__(self, arena: Arena) -> None:
        self.arena = arena
        self._inputs: dict[Name, tuple[int, Message]] = {}
        self._samples: dict[str, list[WheelFeedback]] = {name: [] for name in arena.robots}
        self.journals: dict[Life, list[InputBatch]] = {}
        self.steps: dict[str, dict[int, RobotStep]] = {name: {} for name in arena.robots}
        self.states: dict[Life, dict[int, NeighbourState]] = {}

    def receive(self, message: Message, payload: bytes = b"") -> None:
        """:param payload: what it was decoded from; checks of inputs are of payloads."""
        match message:
            case InputBatch():
                self.journals.setdefault((message.robot, message.boot), []).append(message)
            case FeedbackBatch() if message.robot in self._samples:
                self._samples[message.robot] += message.samples
            case StepBatch() if message.robot in self.steps:
                self.steps[message.robot] |= {step.step_ns: step for step in message.steps}
            case _:
                name = named(message, payload)
                if name is not None:
                    self._inputs[_place(name)] = (name[4], message)
                if isinstance(message, NeighbourState):
                    self.states.setdefault((message.robot, message.boot), {})[message.seq] = message

    def journal(self, life: Life) -> Iterator[tuple[int, Input]]:
        """Time and input, from the agent's start on.

        :raises Incomplete: batches are missing.
        """
        for number, batch in enumerate(self.journals[life]):
            if batch.number != number:
                first = "the recording begins after the robot's start" if not number else "batches were lost"
                raise Incomplete(f"{first}: input batch {number} is missing, {batch.number} comes next")
            now_ns = batch.since_ns
            for entry in batch.inputs:
                now_ns += entry.after_ns
                yield now_ns, entry

    def message(self, entry: Input) -> tuple[bool, Message]:
        """Whether it is what was received, and the message.

        :raises Incomplete: it is not in the recording.
        """
        found = self._inputs.get(_place((entry.kind, entry.word, entry.origin, entry.number, entry.check)))
        if found is None:
            raise Incomplete(f"{words(entry)} was received but is not in the recording")
        return found[0] == entry.check, found[1]

    def supply(self, state: NeighbourState) -> bool:
        """Add a state that was not recorded, as an input only; False where it is there."""
        name = named(state)
        if name is None or _place(name) in self._inputs:
            return False
        self._inputs[_place(name)] = (0, state)
        return True

    def samples(self, robot: str) -> deque[WheelFeedback]:
        return deque(self._samples[robot])


def _place(name: tuple[str, str, int, int, int]) -> Name:
    """Where a message is kept; clouds of one mission may differ, and are told apart by their check."""
    return (*name[:3], name[4]) if name[0] == "targets" else name[:4]


def words(entry: Input) -> str:
    """An input in words."""
    return " ".join(str(part) for part in (entry.kind, entry.word, entry.origin, entry.number) if part)


class _Player:
    """One agent, fed from an archive."""

    def __init__(self, archive: Archive, life: Life) -> None:
        self.archive = archive
        self.agent = Agent(archive.arena, life[0], life[1])
        self.altered: list[str] = []
        self._samples = archive.samples(life[0])

    def feed(self, entry: Input, now_ns: int) -> list[Message]:
        """Give the agent one input; what it says.

        :raises Incomplete: the recording lacks the input.
        """
        agent = self.agent
        match entry.kind:
            case "feedback":
                agent.feedback(self._sample(entry.number), now_ns)
            case "fault":
                agent.driver_fault(entry.word, "", now_ns)
            case "active":
                agent.driver_active(bool(entry.number), now_ns)
            case "step":
                agent.step(now_ns)
            case "tick":
                agent.tick(now_ns)
            case "wrote":
                agent.wrote(now_ns)
            case "outbox":
                return [message for _, message in agent.outbox(now_ns)]
            case _:
                same, message = self.archive.message(entry)
                if not same:
                    self.altered.append(words(entry))
                agent.receive(message, now_ns)
        return []

    def _sample(self, stamp_ns: int) -> WheelFeedback:
        while self._samples:
            sample = self._samples.popleft()
            if sample.stamp_ns == stamp_ns:
                return sample
        raise Incomplete(f"wheel feedback of {stamp_ns} ns was received but is not in the recording")


def replay(archive: Archive, life: Life) -> Outcome:
    """One robot's whole journal through a fresh agent, up to the first difference."""
    robot, boot = life
    player = _Player(archive, life)
    context: deque[tuple[int, Input]] = deque(maxlen=CONTEXT)
    recorded_steps, recorded_states = archive.steps[robot], archive.states.get(life, {})
    inputs = states = unrecorded = 0
    lost_states: list[NeighbourState] = []
    first_ns = last_ns = 0
    compared: set[int] = set()

    def outcome(difference: Difference | None = None, problem: str = "") -> Outcome:
        altered = tuple(player.altered)
        lost = tuple(lost_states)
        return Outcome(robot, boot, inputs, len(compared), states, altered, unrecorded, lost, difference, problem)

    try:
        for now_ns, entry in archive.journal(life):
            inputs += 1
            first_ns = first_ns or now_ns
            context.append((now_ns, entry))
            for what, at_ns, replayed in _outputs(player.feed(entry, now_ns)):
                found = recorded_steps.get(at_ns) if isinstance(replayed, RobotStep) else recorded_states.get(at_ns)
                if found is None:
                    unrecorded += 1
                    lost_states += [replayed] if isinstance(replayed, NeighbourState) else []
                elif found != replayed:
                    return outcome(Difference(what, now_ns, found, replayed, tuple(context)))
                elif isinstance(replayed, RobotStep):
                    compared.add(at_ns)
                    last_ns = at_ns
                else:
                    states += 1
    except Incomplete as missing:
        return outcome(problem=str(missing))
    for at_ns, step in recorded_steps.items():
        if first_ns <= at_ns <= last_ns and at_ns not in compared:
            return outcome(Difference("step", at_ns, step, None, ()))
    return outcome(problem="" if compared else "no control step was recorded")


def replay_all(archive: Archive, lives: Iterable[Life]) -> dict[Life, Outcome]:
    """Every robot's outcome.

    A state that its receivers got and the recorder missed is taken from its sender's replay, as far as that has been
    equal in everything recorded.
    """
    outcomes = {life: replay(archive, life) for life in lives}
    while True:
        lost = [state for outcome in outcomes.values() for state in outcome.lost_states]
        found = [state for state in lost if archive.supply(state)]
        if not found:
            return outcomes
        outcomes |= {life: replay(archive, life) for life, outcome in outcomes.items() if outcome.problem}


def _outputs(messages: Iterable[Message]) -> Iterator[tuple[str, int, Message]]:
    """What is compared: its name, its number (time of a step, seq of a state) and itself."""
    for message in messages:
        if isinstance(message, StepBatch):
            yield from (("step", step.step_ns, step) for step in message.steps)
        elif isinstance(message, NeighbourState):
            yield "state", message.seq, message

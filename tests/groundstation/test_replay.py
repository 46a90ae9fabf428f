"""A recorded mission through the same agents: equal in every bit, and different as soon as one bit of it is."""

import os
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from contract.codec import decode, encode
from contract.keys import Keys
from contract.messages import BodyPose, FeedbackBatch, InputBatch, Message, MocapFrame, NeighbourState, RunStatus
from groundstation import cli
from groundstation.conditions import FIELD
from groundstation.lockstep import World
from groundstation.recording import CONFIG, Recording
from groundstation.replaying import Archive, Outcome, replay, replay_all
from groundstation.rig import write_config
from groundstation.runwriter import RunWriter, Sink
from groundstation.sweep import Job, arena_for
from groundstation.targets import scenario
from tests.groundstation.kept import KEPT, MOST_BYTES

ROBOT = "r02"
Edit = Callable[[str, Message], Message | None]


class Tape:
    """A lockstep mission as a recorder would have heard it."""

    def __init__(self, wired: bool, limit_s: float) -> None:
        job = Job(3, 6, 2, "field", "field", limit_s, wired)
        self.arena = arena_for(job)
        self.keys = Keys(self.arena.arena.name)
        self.payloads: list[tuple[str, bytes, int]] = []
        world = World(
            self.arena,
            scenario(3, 6, 2),
            FIELD,
            2,
            limit_s,
            wired=wired,
            tap=lambda key, payload, now_ns: self.payloads.append((key, payload, now_ns)),
        )
        world.run()

    def replay(self, edit: Edit = lambda key, message: message, robot: str = ROBOT) -> Outcome:
        archive = Archive(self.arena)
        for key, payload, _ in self.payloads:
            kind = self.keys.kind(key)
            assert kind is not None
            message = edit(key, decode(kind, payload))
            if message is not None:
                archive.receive(message)
        return replay(archive, (robot, 1))


@pytest.fixture(scope="module", params=[False, True], ids=["direct", "wire"])
def tape(request: pytest.FixtureRequest) -> Tape:
    return Tape(request.param, 3.0)


def test_the_recorded_status_tells_targets_and_connectivity(tape: Tape) -> None:
    status = [decode(RunStatus, payload) for key, payload, _ in tape.payloads if key == tape.keys.status]
    running = [entry for entry in status if entry.phase == "running"]
    assert {entry.components for entry in running} == {1}
    assert min(entry.lambda2 for entry in running) > 0.9, "no connected graph of three has less than 1"
    states = [decode(NeighbourState, payload) for key, payload, _ in tape.payloads if key.endswith("/state")]
    bits = 0
    for state in states:
        bits |= int(state.occupied or "0", 16)
    assert len(status[-1].occupied) == bits.bit_count()
    assert all(set(a.occupied) <= set(b.occupied) for a, b in pairwise(status))


def test_replay_is_equal_in_every_bit(tape: Tape) -> None:
    for robot in tape.arena.robots:
        outcome = tape.replay(robot=robot)
        assert outcome.good, outcome
        assert outcome.steps > 200
        assert outcome.states > 100
        assert outcome.unrecorded <= 12


def moved(body: BodyPose, robot: str, by_m: float) -> BodyPose:
    return msgspec.structs.replace(body, x_m=body.x_m + by_m) if body.robot == robot else body


def moving(robot: str, by_m: float, *frames: int) -> Edit:
    def edit(key: str, message: Message) -> Message:
        if not isinstance(message, MocapFrame) or message.frame not in frames:
            return message
        return msgspec.structs.replace(message, bodies=tuple(moved(body, robot, by_m) for body in message.bodies))

    return edit


@pytest.mark.parametrize("robot", ["r01", ROBOT])
def test_one_pose_moved_by_a_hundredth_of_a_millimetre_is_found(tape: Tape, robot: str) -> None:
    outcome = tape.replay(moving(robot, 1e-5, 200))
    assert not outcome.good
    assert outcome.altered == ("frame 1 200",)


def test_moved_poses_change_what_the_agent_does(tape: Tape) -> None:
    outcome = tape.replay(moving(ROBOT, 0.01, *range(200, 206)))
    difference = outcome.difference
    assert difference is not None
    assert difference.fields()
    assert any(entry.kind == "frame" and entry.number >= 200 for _, entry in difference.context)
    assert outcome.steps > 50


def test_changed_feedback_is_found(tape: Tape) -> None:
    def edit(key: str, message: Message) -> Message:
        if not isinstance(message, FeedbackBatch) or message.robot != ROBOT:
            return message
        samples = tuple(
            msgspec.structs.replace(s, left_radps=s.left_radps + 0.01) if abs(s.left_radps) > 0.5 else s
            for s in message.samples
        )
        return msgspec.structs.replace(message, samples=samples)

    assert tape.replay(edit).difference is not None


def test_changed_command_is_found(tape: Tape) -> None:
    archive = Archive(tape.arena)
    for key, payload, _ in tape.payloads:
        kind = tape.keys.kind(key)
        assert kind is not None
        archive.receive(decode(kind, payload))
    steps = archive.steps[ROBOT]
    at_ns = sorted(steps)[150]
    steps[at_ns] = msgspec.structs.replace(steps[at_ns], left_radps=steps[at_ns].left_radps + 1e-5)
    difference = replay(archive, (ROBOT, 1)).difference
    assert difference is not None
    assert [name for name, *_ in difference.fields()] == ["left_radps"]
    steps[at_ns] = msgspec.structs.replace(steps[at_ns], left_radps=steps[at_ns].left_radps - 1e-5, step_ns=at_ns + 1)
    steps[at_ns + 1] = steps.pop(at_ns)
    difference = replay(archive, (ROBOT, 1)).difference
    assert difference is not None
    assert difference.replayed is None


@pytest.mark.parametrize(
    ("lost", "words"),
    [
        (lambda m: isinstance(m, MocapFrame) and m.frame == 50, "frame 1 50"),
        (lambda m: isinstance(m, InputBatch) and m.number == 0 and m.robot == ROBOT, "begins after the robot's start"),
        (lambda m: isinstance(m, InputBatch) and m.number == 5 and m.robot == ROBOT, "batches were lost"),
        (lambda m: isinstance(m, FeedbackBatch) and m.robot == ROBOT, "wheel feedback of"),
        (lambda m: isinstance(m, NeighbourState) and m.robot == "r01", "state r01"),
    ],
    ids=["frame", "first", "batch", "feedback", "state"],
)
def test_what_the_recording_lacks_is_named(tape: Tape, lost: Callable[[Message], bool], words: str) -> None:
    outcome = tape.replay(lambda key, message: None if lost(message) else message)
    assert not outcome.good
    assert words in outcome.problem


def test_a_state_the_recorder_missed_comes_from_its_senders_replay(tape: Tape) -> None:
    archive = Archive(tape.arena)
    for key, payload, _ in tape.payloads:
        kind = tape.keys.kind(key)
        assert kind is not None
        message = decode(kind, payload)
        if not (isinstance(message, NeighbourState) and message.robot == "r01" and message.seq in (40, 80)):
            archive.receive(message)
    assert "state r01" in replay(archive, (ROBOT, 1)).problem
    outcomes = replay_all(archive, archive.journals)
    assert all(outcome.good for outcome in outcomes.values())
    assert outcomes["r01", 1].unrecorded == 2


def test_verb_reads_a_recording(tape: Tape, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_config(tape.arena, tmp_path / CONFIG)
    for name, broken in (("good.mcap", False), ("bad.mcap", True)):
        with (tmp_path / name).open("wb") as file:
            writer = RunWriter(Sink(file.fileno()), tape.keys)
            writer.describe({}, {CONFIG: (tmp_path / CONFIG).read_bytes()}, 0)
            for key, payload, now_ns in tape.payloads:
                message = payload
                if broken and key == tape.keys.mocap_frame:
                    edited = moving(ROBOT, 0.01, *range(200, 206))(key, decode(MocapFrame, payload))
                    assert edited is not None
                    message = encode(edited)
                writer.write(key, message, now_ns)
            writer.finish({})
    assert cli.main(["replay", "--check", str(tmp_path / "good.mcap")]) == 0
    assert "equal in every bit" in capsys.readouterr().out
    assert cli.main(["replay", "--check", str(tmp_path / "bad.mcap"), "--robot", ROBOT]) == 1
    shown = capsys.readouterr().out
    assert "frame 1 200: recorded otherwise" in shown
    assert "first difference" in shown
    assert "inputs before it" in shown
    assert cli.main(["replay", "--check", str(tmp_path / "good.mcap"), "--robot", "r99"]) == 2
    assert cli.main(["replay", "--check", str(tmp_path / "none.mcap")]) == 2
    assert cli.main(["replay", str(tmp_path / "good.mcap")]) == 2


def test_the_kept_recording_replays_in_every_bit_by_the_verb(capsys: pytest.CaptureFixture[str]) -> None:
    assert KEPT.stat().st_size < MOST_BYTES
    code = cli.main(["replay", "--check", str(KEPT)])
    said = capsys.readouterr().out
    assert code == 0, f"{said}\nthe agents decide otherwise; if that is meant: python -m tests.groundstation.kept"
    assert "equal in every bit" in said


def test_one_mutated_pose_of_the_kept_recording_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = Recording(KEPT)
    frames = [m for m in recording.messages() if isinstance(m.message, MocapFrame)]
    mutated = frames[len(frames) // 2]
    file = tmp_path / "mutated.mcap"
    descriptor = os.open(file, os.O_WRONLY | os.O_CREAT)
    writer = RunWriter(Sink(descriptor), Keys(recording.arena().arena.name))
    writer.describe(recording.metadata, recording.attachments, 0)
    for log_ns, key, message, payload in recording.messages():
        if (log_ns, key) == (mutated.log_ns, mutated.key):
            assert isinstance(message, MocapFrame)
            first = msgspec.structs.replace(message.bodies[0], x_m=round(message.bodies[0].x_m + 0.001, 5))
            payload = encode(msgspec.structs.replace(message, bodies=(first, *message.bodies[1:])))
        writer.write(key, payload, log_ns)
    writer.finish({})
    os.close(descriptor)
    assert cli.main(["replay", "--check", str(file)]) == 1
    said = capsys.readouterr().out
    assert "recorded otherwise than the robot received it" in said
    assert said.rstrip().endswith("FAILED")

"""Recording and replay: the same datagrams at the same times give the same frames, bit for bit."""

from pathlib import Path

import msgspec
import pytest
from mcap.writer import Writer

from contract.codec import encode
from contract.keys import Keys
from mocap_bridge.natnet.version import Version
from mocap_bridge.sources.base import SourceFrame
from mocap_bridge.sources.choose import SourceError, open_source
from mocap_bridge.sources.natnet_receiver import NatNetReceiver
from mocap_bridge.sources.replay import ReplaySource
from mocap_bridge.sources.tape import TapePlayer
from mocap_bridge.sources.tape_file import TapeError, TapeWriter, read_tape
from tests.mocap_bridge.lockstep import Story, arena

FAULTS = "0.5 0.3 drop 0.5\n1.0 0.2 truncated\n1.5 0.2 reorder\n2.0 0.4 restart\n3.0 0.1 id_change r06"


@pytest.fixture(scope="module")
def story() -> Story:
    return Story(FAULTS).until(4.0)


def write(story: Story, path: Path) -> Path:
    tape = TapeWriter(path, {"arena": "lab"})
    for entry in story.tape:
        tape.write(entry)
    tape.close()
    return path


def test_replay_is_bit_for_bit(story: Story, tmp_path: Path) -> None:
    tape = list(read_tape(write(story, tmp_path / "session.mcap")))
    assert tape == story.tape
    receiver = NatNetReceiver("test", Version(4, 1), False)
    player = TapePlayer(receiver)
    assert list(player.frames(tape)) == story.source_frames
    assert player.differences == 0
    assert receiver.status().counters == story.receiver.status().counters


def test_player_notices_another_client(story: Story) -> None:
    player = TapePlayer(NatNetReceiver("test", Version(3, 1), False))
    list(player.frames(story.tape))
    assert player.differences > 0


def test_tape_that_was_cut_off_is_read_to_the_cut(story: Story, tmp_path: Path) -> None:
    path = write(story, tmp_path / "session.mcap")
    whole = path.read_bytes()
    for share in (0.3, 0.5, 0.9):
        path.write_bytes(whole[: int(len(whole) * share)])
        tape = list(read_tape(path))
        assert tape[:-1] == story.tape[: len(tape) - 1]
        assert len(tape) > 0.25 * len(story.tape)


@pytest.mark.parametrize("content", [b"", b"no mcap at all, but long enough to have a magic"])
def test_file_that_is_no_tape_is_named(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(TapeError, match=r"x\.mcap"):
        list(read_tape(path))


def played(source: ReplaySource, start_ns: int, seconds: float) -> list[tuple[int, SourceFrame]]:
    out = []
    for now_ns in range(start_ns, start_ns + int(seconds * 1e9), 1_000_000):
        out += [(now_ns, frame) for frame in source.receive(now_ns)]
    return out


def test_replay_source_paces_and_restamps(story: Story, tmp_path: Path) -> None:
    path = write(story, tmp_path / "session.mcap")
    start_ns = 10**15
    frames = played(ReplaySource(story.arena, path), start_ns, 5.0)
    assert [frame.number for _, frame in frames] == [frame.number for frame in story.source_frames]
    assert {frame.session for _, frame in frames} == {0, 1}
    for (now_ns, frame), before in zip(frames, story.source_frames, strict=True):
        assert 0 <= now_ns - frame.received_ns < 1_000_001
        assert frame.received_ns - frame.exposure_ns == before.received_ns - before.exposure_ns
        assert frame.bodies == before.bodies


def test_mission_recording_is_played_back_in_the_arena_frame(story: Story, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(topic=Keys("lab").mocap_frame, message_encoding="json", schema_id=0)
        for message in story.frames:
            writer.add_message(channel, message.publish_ns, encode(message), message.publish_ns)
        writer.finish()
    site = arena(up_axis="z", origin_m=[1.0, -2.0], rotation_rad=0.5)
    replayed = Story(site=site).pipeline
    frames = [replayed.frame(frame, now_ns) for now_ns, frame in played(ReplaySource(site, path), 10**15, 5.0)]
    assert [frame.frame for frame in frames] == [frame.frame for frame in story.frames]
    for frame, before in zip(frames, story.frames, strict=True):
        for body, was in zip(frame.bodies, before.bodies, strict=True):
            if was.valid and body.valid:
                assert (body.x_m, body.y_m, body.heading_rad) == pytest.approx(
                    (was.x_m, was.y_m, was.heading_rad), abs=2e-5
                )
            assert was.valid or not body.valid


def test_missing_recording_is_named_by_its_key() -> None:
    with pytest.raises(SourceError, match=r"mocap.recording: .*nowhere.mcap: No such file"):
        open_source(arena(source="replay", recording="nowhere.mcap"))


def test_end_of_recording_is_said(story: Story, tmp_path: Path) -> None:
    site = arena(source="replay", recording=str(write(story, tmp_path / "session.mcap")))
    source = open_source(msgspec.structs.replace(site))
    assert source.status().problem == ""
    played(source, 10**15, 5.0)  # type: ignore[arg-type]
    assert source.status().problem == "session.mcap has been played to its end"
    source.close()

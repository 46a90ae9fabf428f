"""Recording and replay: the same datagrams at the same times give the same frames, bit for bit."""

from pathlib import Path

import msgspec
import pytest
from mcap.writer import Writer

from contract.codec import encode
from contract.keys import Keys
from mocap_bridge.cli import main
from mocap_bridge.mock.bodies import settings_of
from mocap_bridge.mock.recorded import RecordedBodies
from mocap_bridge.mock.tape_server import TapeServer
from mocap_bridge.natnet import handshake
from mocap_bridge.natnet.version import Version
from mocap_bridge.natnet.wire import open_packet
from mocap_bridge.sources.base import SourceFrame
from mocap_bridge.sources.choose import SourceError, open_source
from mocap_bridge.sources.natnet_receiver import NatNetReceiver
from mocap_bridge.sources.replay import ReplaySource, mission_frames
from mocap_bridge.sources.tape import Entry, TapePlayer
from mocap_bridge.sources.tape_file import TapeError, TapeWriter, read_tape
from tests.mocap_bridge.lockstep import Story, arena
from tests.mocap_bridge.test_mocap_bridge import arena_file, on_free_ports

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


def mission_file(story: Story, path: Path) -> Path:
    """What the recorder of a mission keeps of a story."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(topic=Keys("lab").mocap_frame, message_encoding="json", schema_id=0)
        for message in story.frames:
            writer.add_message(channel, message.publish_ns, encode(message), message.publish_ns)
        writer.finish()
    return path


def test_mission_recording_is_played_back_in_the_arena_frame(story: Story, tmp_path: Path) -> None:
    path = mission_file(story, tmp_path / "run.mcap")
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


# --- a server that says a recording again -----------------------------------------------------------


CLIENT = ("10.0.0.9", 5)


def heard(server: TapeServer, receiver: NatNetReceiver) -> list[tuple[int, bytes, SourceFrame | None]]:
    """Every frame of a tape server as a client in virtual time gets it."""
    out = []
    now_ns = 10**15
    while not server.ended:
        for datagram in receiver.outbox(now_ns):
            for answer in server.receive(datagram, CLIENT, now_ns + 50_000):
                receiver.receive(answer.data, now_ns + 100_000)
        for frame in server.stream(now_ns, ()):
            assert frame.to == CLIENT
            out.append((now_ns, frame.data, receiver.receive(frame.data, now_ns)))
        now_ns += 1_000_000
    return out


def test_tape_is_said_again_byte_for_byte_at_its_own_pace(story: Story) -> None:
    server = TapeServer(settings_of(story.arena), lambda: iter(story.tape))
    receiver = NatNetReceiver("test", Version(4, 1), False)
    frames = heard(server, receiver)
    recorded = [e for e in story.tape if e.way == "received" and e.data[:2] == b"\x07\0"]
    assert [data for _, data, _ in frames] == [entry.data for entry in recorded]
    assert all(
        abs((now_ns - frames[0][0]) - (entry.stamp_ns - recorded[0].stamp_ns)) <= 1_000_000
        for (now_ns, _, _), entry in zip(frames, recorded, strict=True)
    )
    assert receiver.client.info is not None
    assert (receiver.client.info.name, receiver.client.nominal_rate_hz) == ("Emulated Motive", 120.0)
    before = [f for _, _, f in frames[:60] if f is not None]
    assert before
    assert all(set(f.bodies) == {"r06", "r08", "r09"} for f in before)
    assert all(-1_000_000 <= f.received_ns - f.exposure_ns < 3_000_000 for f in before)
    assert receiver.session >= 1, "the recorded restart is one"
    assert receiver.client.models.names[101] == "r06", "the model list that came later"


def test_tape_of_an_older_stream_says_its_version(story: Story) -> None:
    old = Story("", arena(version="3.1")).until(0.5)
    server = TapeServer(settings_of(arena()), lambda: iter(old.tape))
    [answer] = server.receive(b"\0\0\0\0", CLIENT, 0)
    assert handshake.decode_server_info(open_packet(answer.data)).natnet == Version(3, 1)
    group = settings_of(arena(multicast_group="239.1.2.3", data_port=1600))
    shown = TapeServer(group, lambda: iter(old.tape)).info
    assert (shown.multicast, shown.group, shown.data_port) == (True, "239.1.2.3", 1600)


def test_tape_without_a_server_is_refused() -> None:
    with pytest.raises(ValueError, match="no server has introduced itself"):
        TapeServer(settings_of(arena()), lambda: iter([Entry("received", 0, b"\x07\0\0\0")]))


def test_bodies_of_a_mission_move_again_and_can_be_spoilt(tmp_path: Path) -> None:
    before = Story("0.5 0.3 occlusion r08").until(1.5)
    path = mission_file(before, tmp_path / "run.mcap")
    bodies = RecordedBodies(before.arena, (entry.frame for entry in mission_frames(path, before.arena)))
    after = Story("1.0 0.2 absent r06", arena(version="3.0", up_axis="z"), bodies.poses).until(1.4)
    assert after.reasons("r08") == ["", "occluded", ""]
    assert after.reasons("r06") == ["", "missing", ""]
    truth = {frame.frame: frame.bodies[2] for frame in before.frames}
    for frame in after.frames[20:120]:
        near = min(truth.values(), key=lambda pose: abs(pose.x_m - frame.bodies[2].x_m))
        assert abs(near.x_m - frame.bodies[2].x_m) < 2e-3
    assert bodies.poses(99.0)
    assert bodies.ended


@pytest.mark.parametrize("kind", ["tape", "mission"])
def test_emulate_plays_a_recording_to_its_end(
    kind: str, story: Story, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = Story("").until(0.3)
    path = (write if kind == "tape" else mission_file)(short, tmp_path / "x.mcap")
    config = str(arena_file(tmp_path / "arena.toml", on_free_ports(arena())))
    assert main(["emulate", "--arena", config, "--recording", str(path), "--seconds", "20"]) == 0
    assert capsys.readouterr().out.startswith("READY emulate\n")
    (tmp_path / "script").write_text("0 1 drop")
    both = ["emulate", "--arena", config, "--recording", str(path), "--script", str(tmp_path / "script")]
    assert main([*both, "--seconds", "0"]) == (2 if kind == "tape" else 0)


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

"""Recordings: bytes unchanged, complete chunks survive any cut, a full disk costs nothing that was written."""

import errno
import os
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from contract.codec import encode
from contract.keys import Keys
from groundstation import runwriter
from groundstation.recorder import Tape, set_aside
from groundstation.recording import Recording, RecordingError
from groundstation.recover import recover
from groundstation.runwriter import Sink
from tests.groundstation.runs import Sent, arena_of, mission, record

ARENA = arena_of()
SENT = mission(ARENA, frames=30)
CHUNK = 0x06
CHUNK_HEAD = 9 + 8 + 8 + 8 + 4 + 4 + len("zstd") + 8
"""Bytes of a chunk record before its compressed content."""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("run"), ARENA, SENT, commit_every=40)


def chunks(data: bytes) -> list[tuple[int, int, int]]:
    """(start, end, messages up to there) of every chunk record, walked by hand from the format's description."""
    position, found, messages = 8, [], 0
    while position + 9 <= len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, position)
        if opcode == CHUNK:
            messages = min(messages + 40, len(SENT))
            found.append((position, position + 9 + length, messages))
        position += 9 + length
    return found


def payloads(sent: list[Sent]) -> list[tuple[str, bytes, int]]:
    return [(key, encode(message), log_ns) for key, message, log_ns in sent]


def read(path: Path) -> list[tuple[str, bytes, int]]:
    return [(entry.key, entry.payload, entry.log_ns) for entry in Recording(path).messages()]


def test_bytes_come_back_unchanged(recording: Path) -> None:
    assert read(recording) == payloads(SENT)


def test_messages_come_back_typed(recording: Path) -> None:
    assert [entry.message for entry in Recording(recording).messages()] == [message for _, message, _ in SENT]


def test_metadata_and_attachments(recording: Path) -> None:
    opened = Recording(recording)
    assert opened.whole
    assert opened.metadata["run"]["seed"] == "42"
    assert {"run_id", "arena_hash", "profile", "wall_minus_site_ns"} <= opened.metadata["run"].keys()
    assert "python" in opened.metadata["software"]
    assert opened.metadata["recorder"]["messages"] == str(len(SENT))
    assert opened.attachments["config.toml"] == (recording.parent / "config.toml").read_bytes()
    assert opened.arena() == ARENA


def test_schemas_are_those_of_the_contract(recording: Path) -> None:
    with recording.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    keys = Keys(ARENA.arena.name)
    assert summary.channels
    for channel in summary.channels.values():
        kind = keys.kind(channel.topic)
        assert kind is not None
        assert summary.schemas[channel.schema_id].name == kind.__name__
        assert (channel.message_encoding, summary.schemas[channel.schema_id].encoding) == ("json", "jsonschema")


@given(share=st.floats(0.0, 1.0), among_chunks=st.booleans())
def test_any_cut_keeps_every_complete_chunk(
    share: float, among_chunks: bool, recording: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = recording.read_bytes()
    first = chunks(data)[0][0] if among_chunks else 8
    cut = first + round(share * (len(data) - first))
    folder = tmp_path_factory.mktemp("cut")
    (folder / "cut.mcap").write_bytes(data[:cut])
    expected = max((count for _, end, count in chunks(data) if end <= cut), default=0)
    found = recover(folder / "cut.mcap", folder / "whole.mcap")
    assert found.messages == expected
    with (folder / "whole.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        content = [(channel.topic, message.data, message.log_time) for _, channel, message in reader.iter_messages()]
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == expected
    assert sorted(content) == sorted(payloads(SENT)[:expected])
    assert not (folder / "whole.mcap.part").exists()


def test_the_oracle_sees_several_chunks(recording: Path) -> None:
    found = chunks(recording.read_bytes())
    assert len(found) > 5
    assert found[-1][2] == len(SENT)


def test_recovering_keeps_metadata_and_attachments(recording: Path, tmp_path: Path) -> None:
    data = recording.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: chunks(data)[1][1] + 5])
    recover(tmp_path / "cut.mcap", tmp_path / "whole.mcap")
    before, after = Recording(recording), Recording(tmp_path / "whole.mcap")
    assert after.whole
    assert after.attachments == before.attachments
    assert after.metadata["run"] == before.metadata["run"]
    assert after.metadata["recovery"]["was_whole"] == "false"


@given(share=st.floats(0.0, 1.0), bit=st.integers(0, 7))
def test_a_flipped_bit_costs_at_most_its_chunk(
    share: float, bit: int, recording: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = bytearray(recording.read_bytes())
    start, end, _ = chunks(bytes(data))[2]
    where = start + CHUNK_HEAD + round(share * (end - start - CHUNK_HEAD - 1))
    data[where] ^= 1 << bit
    folder = tmp_path_factory.mktemp("flip")
    (folder / "flipped.mcap").write_bytes(data)
    found = recover(folder / "flipped.mcap", folder / "whole.mcap")
    everything, kept = payloads(SENT), read(folder / "whole.mcap")
    gone = len(everything) - len(kept)
    assert found.messages == len(kept)
    assert (found.damaged_chunks, gone) in ((1, 40), (0, 0))  # some bits of a compressed frame change nothing
    assert kept == everything[:80] + everything[80 + gone :]


def test_recover_refuses_what_is_no_recording(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(b"hello, world")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        recover(tmp_path / "x.mcap", tmp_path / "y.mcap")
    with pytest.raises(RecordingError, match="No such file"):
        recover(tmp_path / "no.mcap", tmp_path / "y.mcap")
    assert not (tmp_path / "y.mcap").exists()


def test_foreign_keys_and_wrong_payloads_are_kept_and_counted(tmp_path: Path) -> None:
    keys = Keys(ARENA.arena.name)
    odd = [("made/else/where", b"\x00\xff", 1), (keys.status, b'{"no": 1}', 2), ("other/site", b"", 3)]
    good = payloads(SENT[:3])
    tape = Tape(tmp_path / "run.mcap", ARENA, (record(tmp_path / "r", ARENA, [])).with_name("config.toml").read_bytes())
    tape.write([*odd, *good])
    tape.close(dropped=0)
    assert read(tmp_path / "run.mcap") == [*odd, *good]
    entries = list(Recording(tmp_path / "run.mcap").messages())
    assert [entry.message for entry in entries[:3]] == [None] * 3
    ended = Recording(tmp_path / "run.mcap").metadata["recorder"]
    assert (ended["unknown_keys"], ended["undecodable"]) == ("2", "1")


class Disk:
    """``os.pwrite`` of a disk with so much room left, that writes in part before it refuses."""

    def __init__(self, room: int) -> None:
        self.room = room
        self._real = os.pwrite

    def pwrite(self, descriptor: int, data: memoryview, offset: int) -> int:
        if self.room <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        size = min(len(data), self.room, 500)
        self.room -= size
        return self._real(descriptor, data[:size], offset)


@given(room=st.integers(0, 4000), blocks=st.lists(st.binary(min_size=1, max_size=900), min_size=1, max_size=8))
def test_a_full_disk_leaves_whole_flushes(
    room: int, blocks: list[bytes], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("disk") / "file"
    disk = Disk(room)
    with path.open("wb") as stream, pytest.MonkeyPatch.context() as patch:
        patch.setattr(runwriter.os, "pwrite", disk.pwrite)
        sink = Sink(stream.fileno())
        confirmed = b""
        for k, block in enumerate(blocks):
            sink.write(block)
            try:
                sink.commit()
                confirmed = b"".join(blocks[: k + 1])
            except OSError:
                pass
            assert path.read_bytes() == confirmed
        disk.room = 1 << 20
        sink.commit()
    assert path.read_bytes() == b"".join(blocks)


def test_a_tape_tells_of_a_full_disk_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = record(tmp_path / "r", ARENA, []).with_name("config.toml").read_bytes()
    tape = Tape(tmp_path / "run.mcap", ARENA, config)
    disk = Disk(0)
    monkeypatch.setattr(runwriter.os, "pwrite", disk.pwrite)
    tape.write(payloads(SENT[:50]))
    tape.commit()
    health = tape.health(0, tape.began_ns + 1)
    assert health.level == "error"
    assert "No space left" in health.text
    disk.room = 1 << 30
    tape.write(payloads(SENT[50:]))
    tape.commit()
    assert tape.health(0, tape.began_ns + 1).level != "error"
    tape.close(dropped=0)
    assert read(tmp_path / "run.mcap") == payloads(SENT)


def test_a_nearly_full_disk_is_told_beforehand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = record(tmp_path / "r", ARENA, []).with_name("config.toml").read_bytes()
    tape = Tape(tmp_path / "run.mcap", ARENA, config)
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 1 << 20}))
    assert tape.health(0, tape.began_ns + 10**9).level == "warning"
    tape.close(dropped=0)


def test_an_earlier_recording_is_set_aside(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"old")
    set_aside(path)
    assert not path.exists()
    assert [p.read_bytes() for p in tmp_path.glob("run-until-*.mcap")] == [b"old"]


def test_a_damaged_arena_file_is_told_and_believed_by_nobody(recording: Path, tmp_path: Path) -> None:
    """One digit of it would be another arena, and a report of it another mission."""
    data = bytearray(recording.read_bytes())
    at = data.index(b"sensing_radius_m")
    digit = at + data[at:].index(b"= ") + 2
    assert chr(data[digit]).isdigit()
    data[digit] ^= 1
    path = tmp_path / "flipped.mcap"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"config\.toml in it is damaged"):
        Recording(path).arena()
    with pytest.raises(RecordingError, match="damaged"):
        read(path)
    recover(path, tmp_path / "recovered.mcap")
    again = Recording(tmp_path / "recovered.mcap")
    assert {"config.toml.damaged"} == {name for name in again.attachments if name.startswith("config.toml")}
    assert again.damaged == set()

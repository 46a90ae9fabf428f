"""Visual channels: read back with nothing but the file's own schemas, and true to the recording."""

import json
import math
import struct
from pathlib import Path
from typing import Any

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader

from contract.arena import Arena
from contract.keys import Keys
from contract.messages import MocapFrame, RobotReport, RunStatus
from groundstation import cli
from groundstation.recording import Recording
from groundstation.visualise import layout
from tests.groundstation.runs import MS, START_NS, Sent, arena_of, mission, northward, record


def links_of(arena: Arena) -> list[Sent]:
    """Reports of a chain of links, in which all but one robot run, and one target done."""
    names, keys = list(arena.robots), Keys(arena.arena.name)
    sent: list[Sent] = []
    for i, name in enumerate(names):
        others = tuple(names[j] for j in (i - 1, i + 1) if 0 <= j < len(names))
        report = RobotReport(
            robot=name, boot=1, stamp_ns=START_NS, run="running" if i else "stopped", reason="", links_on=others,
            task="tracking", claim=0, pose_valid=True,
        )  # fmt: skip
        sent.append((keys.report(name), report, START_NS + MS))
    sent.append((keys.status, RunStatus(stamp_ns=START_NS, phase="running", occupied=(1,)), START_NS + 2 * MS))
    return sent


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Arena]:
    folder = tmp_path_factory.mktemp("visual")
    arena = arena_of()
    sent = [entry for entry in mission(arena, ending="") if not isinstance(entry[1], RobotReport)]
    record(folder, arena, sorted(sent + links_of(arena), key=lambda entry: entry[2]))
    assert cli.main(["foxglove", str(folder)]) == 0
    return folder, arena


def decoded(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Topic to (time, message) of the protobuf channels, by the schemas in the file alone."""
    found: dict[str, list[tuple[int, Any]]] = {}
    kinds: dict[str, Any] = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if channel.message_encoding != "protobuf":
                continue
            assert schema is not None
            if schema.name not in kinds:
                files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
                pool = descriptor_pool.DescriptorPool()
                for file in files.file:
                    pool.Add(file)
                kinds[schema.name] = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            found.setdefault(channel.topic, []).append((message.log_time, kinds[schema.name].FromString(message.data)))
    assert set(kinds) == {
        f"foxglove.{n}" for n in ("FrameTransforms", "PoseInFrame", "SceneUpdate", "PointCloud", "Log")
    }
    return found


def test_poses_links_targets_and_log_are_those_of_the_recording(made: tuple[Path, Arena]) -> None:
    folder, arena = made
    found = decoded(folder / "foxglove.mcap")
    assert {f"/robot/{name}/pose" for name in arena.robots} < set(found)
    for log_ns, update in found["/tf"]:
        k = round((log_ns - START_NS) / (10 * MS))
        assert [t.child_frame_id for t in update.transforms] == list(arena.robots)
        for i, transform in enumerate(update.transforms):
            assert (transform.translation.x, transform.translation.y) == pytest.approx(northward(i, k))
            assert 2 * math.atan2(transform.rotation.z, transform.rotation.w) == pytest.approx(1.5)
    gaps = [b[0] - a[0] for a, b in zip(found["/tf"], found["/tf"][1:], strict=False)]
    assert min(gaps) >= 33 * MS, "30 Hz at most"
    newest = {entity.id: entity for _, update in found["/scene"] for entity in update.entities}
    assert {"floor", "links", "targets", *(f"robot {name}" for name in arena.robots)} == set(newest)
    ends = [(point.x, point.y) for line in newest["links"].lines for point in line.points]
    assert len(ends) == 4, "two links in a chain of three"
    assert all(math.dist(a, b) == pytest.approx(0.5) for a, b in zip(ends[::2], ends[1::2], strict=True))
    dots = [struct.unpack_from("<fff", found["/links"][-1][1].data, at) for at in range(0, 2 * 13 * 16, 16)]
    assert len(found["/links"][-1][1].data) == 2 * 13 * 16, "12 steps of about 4 cm a link, both ends, 16 bytes each"
    for a, b in zip(ends[::2], ends[1::2], strict=True):
        assert {a, b} <= {(round(x, 5), round(y, 5)) for x, y, _ in dots}
    clouds = [update.data for _, update in found["/targets"]]
    assert len(clouds[0]) == len(clouds[-1]) == 16 * len(newest["targets"].spheres)
    assert clouds[0] != clouds[-1], "the one that is done has another colour"
    sizes = [sphere.size.z for sphere in newest["targets"].spheres]
    assert sizes[0] > sizes[1], "the one that is done is flat"
    first, second = (newest[f"robot {name}"] for name in list(arena.robots)[:2])
    assert (first.frame_id, first.frame_locked) == ("r01", True)
    assert first.texts[0].text.endswith("stopped")
    assert second.texts[0].text.endswith("tracking T01")
    assert first.cylinders[0].color.r > second.cylinders[0].color.r
    assert [entry.message for _, entry in found["/log"]] == ["a <warning>"]


def test_the_recording_itself_is_in_the_copy_byte_for_byte(made: tuple[Path, Arena]) -> None:
    folder, arena = made

    def own(path: Path) -> list[tuple[int, str, bytes]]:
        return [(m.log_ns, m.key, m.payload) for m in Recording(path).messages() if not m.key.startswith("/")]

    before, after = own(folder / "run.mcap"), own(folder / "foxglove.mcap")
    assert before == after
    assert Recording(folder / "foxglove.mcap").arena() == arena
    assert any(isinstance(m.message, MocapFrame) for m in Recording(folder / "foxglove.mcap").messages())


def test_the_layout_plots_what_the_file_has(made: tuple[Path, Arena]) -> None:
    folder, arena = made
    assert (folder / "foxglove-layout.json").read_bytes() == layout(arena.arena.name)
    table = json.loads(layout(arena.arena.name))
    with (folder / "foxglove.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    topics = {channel.topic for channel in summary.channels.values()}
    panels = table["configById"]
    assert set(panels["3D!swarm"]["topics"]) | {panels["RosOut!log"]["topicToRender"]} <= topics
    fields = set(RunStatus.__struct_fields__)
    for panel in ("Plot!lambda2", "Plot!progress"):
        for path in panels[panel]["paths"]:
            _, topic, field = path["value"].split('"')
            assert topic in topics
            assert field.split(".")[1] in fields

    def leaves(node: Any) -> set[str]:
        return {node} if isinstance(node, str) else leaves(node["first"]) | leaves(node["second"])

    assert leaves(table["layout"]) == set(panels)


def test_it_does_not_write_over_the_recording(made: tuple[Path, Arena]) -> None:
    folder, _ = made
    before = (folder / "run.mcap").read_bytes()
    assert cli.main(["foxglove", str(folder), "--out", str(folder / "run.mcap")]) == 2
    assert (folder / "run.mcap").read_bytes() == before
    assert cli.main(["foxglove", str(folder / "none")]) == 2

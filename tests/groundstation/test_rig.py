"""What the rig makes of an arena file, and the small pure parts of the station's shells."""

import math
import os
import select
import signal
import socket
from pathlib import Path

import pytest

from contract.arena import ArenaError, digest, load
from drivers.registry import port_path, wheel_faults
from groundstation import current
from groundstation.cli import main
from groundstation.mock_arena import flip_bit, follow
from groundstation.orders import Acknowledgement, describe, status_lines
from groundstation.ports import free_ports
from groundstation.processes import Family, kin
from groundstation.rig import ARENAS, Changes, find_arena, mock_arena, write_config
from groundstation.targets import cloud_of
from mocap_bridge.natnet.wire import Malformed, MessageId, open_packet, packet

EXAMPLES = sorted(entry.stem for entry in ARENAS.glob("*.toml"))


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_example_arena_is_sound_and_its_targets_fit(name: str, tmp_path: Path) -> None:
    arena = mock_arena(find_arena(name), tmp_path)
    assert len(cloud_of(arena, "m").targets) == arena.targets.count
    assert all(robot.emulate == ("wheels", "body") for robot in arena.robots.values())
    assert all(port_path(robot.wheels) == str(tmp_path / "ports" / n) for n, robot in arena.robots.items())


def test_the_resolved_file_reads_back_as_the_same_arena(tmp_path: Path) -> None:
    arena = mock_arena(find_arena("experiment2"), tmp_path, Changes(seed=5))
    write_config(arena, tmp_path / "config.toml")
    again = load(tmp_path / "config.toml", wheel_faults)
    assert again == arena
    assert digest(again) == digest(arena)
    assert again.targets.seed == 5


@pytest.mark.parametrize("count", [1, 3, 6, 7, 10, 16])
def test_any_number_of_robots_each_with_its_own_place(count: int, tmp_path: Path) -> None:
    arena = mock_arena(find_arena("experiment2"), tmp_path, Changes(robots=count))
    starts = [robot.start for robot in arena.robots.values()]
    assert len(starts) == count
    assert all(math.dist(p, q) >= 0.3 for i, p in enumerate(starts) for q in starts[i + 1 :])
    assert len({port_path(robot.wheels) for robot in arena.robots.values()}) == count
    assert len({robot.body for robot in arena.robots.values()}) == count


def test_real_addresses_never_reach_the_mock_arena(tmp_path: Path) -> None:
    text = find_arena("bench2").read_text().replace("127.0.0.1", "192.168.7.1")
    (tmp_path / "real.toml").write_text(text.replace("[link]", "[link]\ninsecure = true"))
    arena = mock_arena(tmp_path / "real.toml", tmp_path / "out")
    assert arena.link.router.startswith("tcp/127.0.0.1:")
    assert arena.mocap.server == arena.mocap.local_address == "127.0.0.1"
    assert arena.mocap.multicast_group == ""


@pytest.mark.parametrize(
    "changes",
    [
        Changes(robots=0),
        Changes(robots=-1),
        Changes(robots=99),
        Changes(robots=10**9),
        Changes(targets=0),
        Changes(seed=-1),
    ],
)
def test_impossible_numbers_are_refused(changes: Changes, tmp_path: Path) -> None:
    with pytest.raises(ArenaError):
        mock_arena(find_arena("experiment2"), tmp_path, changes)


def test_an_unknown_name_lists_the_examples() -> None:
    with pytest.raises(ArenaError, match="experiment1, experiment2"):
        find_arena("no-such")


def test_ports_are_free_different_and_none_that_a_system_gives_away_by_itself() -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as other:
        taken = free_ports(1)[0]
        other.bind(("127.0.0.1", taken))
        found = [free_ports(3) for _ in range(200)]
    assert all(len(set(ports)) == 3 and taken not in ports for ports in found)
    low = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    assert all(1024 < port < low for ports in found for port in ports)


def test_stop_names_who_did_not_confirm() -> None:
    lines, confirmed = describe([Acknowledgement("r06", 0.03), Acknowledgement("r08", None)])
    assert not confirmed
    assert lines[0] == "r06  stopped  30 ms"
    assert "NOT CONFIRMED" in lines[1]
    assert lines[2] == "STOP NOT CONFIRMED by r08"
    lines, confirmed = describe([Acknowledgement("r06", 0.7)])
    assert confirmed
    assert "(late)" in lines[0]


def test_status_names_the_silent(tmp_path: Path) -> None:
    arena = mock_arena(find_arena("bench2"), tmp_path)
    assert status_lines(arena, {}, None) == ["no station session", "r06  silent", "r08  silent"]


def test_one_flipped_bit_is_one_bit_and_refused() -> None:
    whole = packet(MessageId.ECHO_REQUEST, bytes(8))
    damaged = flip_bit(whole)
    assert sum((a ^ b).bit_count() for a, b in zip(whole, damaged, strict=True)) == 1
    with pytest.raises(Malformed):
        open_packet(damaged)


def test_a_port_that_was_jammed_or_closed_is_watched_again() -> None:
    reader, writer = os.pipe()
    closed, other = os.pipe()
    with select.epoll() as poll:
        follow(poll, set(), {reader, closed})
        os.close(closed)
        follow(poll, {reader, closed}, set())
        os.write(writer, b"x")
        assert poll.poll(0) == []
        follow(poll, set(), {reader})
        assert poll.poll(0) == [(reader, select.EPOLLIN)]
    for number in (reader, writer, other):
        os.close(number)


def test_the_arena_of_the_last_session_is_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert current.recall() is None
    config = tmp_path / "config.toml"
    config.write_text("")
    current.remember(config)
    assert current.recall() == config
    config.unlink()
    assert current.recall() is None
    monkeypatch.setenv("XDG_STATE_HOME", "/proc/nowhere")
    current.remember(config)
    assert current.recall() is None


def test_processes_end_group_by_group(tmp_path: Path) -> None:
    log = tmp_path / "ended"
    text = (
        "import signal, sys, pathlib\n"
        "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])\n"
        "print('READY', flush=True)\n"
        "signal.sigwait([signal.SIGTERM])\n"
        f"pathlib.Path({str(log)!r}).open('a').write(sys.argv[1] + ' ')\n"
    )
    (tmp_path / "child_to_end.py").write_text(text)
    family = Family()
    paths = os.pathsep.join((str(tmp_path), os.environ.get("PYTHONPATH", "")))
    with pytest.MonkeyPatch.context() as patch, family:
        patch.setenv("PYTHONPATH", paths)
        for name, ends in (("bridge", 2), ("recorder", 1), ("r06", 0), ("r08", 0)):
            family.start(name, "child_to_end", [name], tmp_path / f"{name}.log", ends=ends)
        family.wait_ready(20.0)
        assert family.end() == dict.fromkeys(("r06", "r08", "recorder", "bridge"), 0)
    assert log.read_text().split()[2:] == ["recorder", "bridge"]
    assert sorted(log.read_text().split()[:2]) == ["r06", "r08"]


def test_what_a_process_has_started_is_signalled_without_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (
        "import subprocess\n"
        "child = subprocess.Popen(['sleep', '60'])\n"
        "print('READY', flush=True)\n"
        "raise SystemExit(-child.wait())\n"
    )
    (tmp_path / "child_with_kin.py").write_text(text)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(tmp_path), os.environ.get("PYTHONPATH", ""))))
    with Family() as family:
        child = family.start("parent", "child_with_kin", [], tmp_path / "parent.log")
        family.wait_ready(20.0)
        assert len(kin(child.pid)) == 1
        child.signal_kin(signal.SIGKILL)
        assert child.wait(20.0)
        assert child.code == signal.SIGKILL
        assert kin(child.pid) == []
        child.signal_kin(signal.SIGKILL)


@pytest.mark.parametrize("verb", ["stop", "status", "home", "doctor", "watch", "page"])
def test_without_a_file_or_a_session_every_verb_asks_for_the_arena(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert main([verb]) == 2
    assert capsys.readouterr().err.startswith("which arena? --arena FILE")

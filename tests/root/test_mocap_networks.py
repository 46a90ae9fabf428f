"""Every cause of "connected but no data", on two hosts with two cables: what the doctor calls it."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.house.checkout import ROOT

LAN, WIFI = "10.77.1", "10.77.2"
SERVER, CLIENT = 1, 2
OLD_SERVER = """
import socket
from mocap_bridge.natnet import handshake
from mocap_bridge.natnet.version import Version
info = handshake.ServerInfo("Motive", (3, 4, 0, 0), Version(4, 4), 10_000_000, 1511, False)
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
    sock.bind(("10.77.1.1", 1510))
    print("READY", flush=True)
    while True:
        sock.sendto(handshake.encode_server_info(info), sock.recvfrom(65535)[1])
"""


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, timeout=20)


class Hosts:
    """Two network namespaces with two cables between them: 10.77.1.0/24 and 10.77.2.0/24."""

    def __init__(self) -> None:
        self.names = {SERVER: f"ahdc-motive-{os.getpid()}", CLIENT: f"ahdc-bridge-{os.getpid()}"}
        for name in self.names.values():
            ip("netns", "add", name)
            ip("-n", name, "link", "set", "lo", "up")
        for subnet, cable in ((LAN, "lan"), (WIFI, "wifi")):
            first, second = self.names.values()
            ip("link", "add", cable, "netns", first, "type", "veth", "peer", "name", cable, "netns", second)
            for host, name in self.names.items():
                ip("-n", name, "addr", "add", f"{subnet}.{host}/24", "dev", cable)
                ip("-n", name, "link", "set", cable, "up")

    def on(self, host: int, *command: str) -> list[str]:
        return ["ip", "netns", "exec", self.names[host], *command]

    def close(self) -> None:
        for name in self.names.values():
            ip("netns", "del", name)


@pytest.fixture(scope="module")
def hosts() -> Iterator[Hosts]:
    made = Hosts()
    yield made
    made.close()


def arena_file(path: Path, mocap: dict[str, object]) -> Path:
    """Two robots, apart in both directions: bodies of heading 0 in one line show no up axis."""
    settings = {"server": f"{LAN}.1", "local_address": f"{LAN}.2", "frame_rate_hz": 40.0, **mocap}
    lines = ['[arena]\nname = "lab"\nsize_m = [4.0, 5.0]\n[mocap]']
    lines += [f"{key} = {json.dumps(value)}" for key, value in settings.items()]
    for k, name in enumerate(("r06", "r08")):
        lines.append(
            f'[robots.{name}]\nbody = "{name}"\nstart = [{1 + 1.5 * k}, {2.0 + k}]\nwheels = {{kind = "none"}}'
        )
    path.write_text("\n".join(lines) + "\n")
    return path


GROUP: dict[str, object] = {"multicast_group": "239.255.42.99"}
BROADCAST: dict[str, object] = {"multicast_group": "255.255.255.255"}
CAUSES: dict[str, tuple[dict[str, object], dict[str, object], list[str], str]] = {
    # cause: the client's arena file, what differs in the server's, more options of emulate, the server's script
    "": ({}, {}, [], ""),
    "wrong_interface": ({"local_address": f"{WIFI}.2"}, {}, [], ""),
    "wrong_interface not here": ({"local_address": "10.77.9.9"}, {}, [], ""),
    "multicast_not_joined": (GROUP, {}, ["--multicast-interface", f"{WIFI}.1"], ""),
    "multicast_group": ({"multicast_group": "239.255.42.98"}, GROUP, [], ""),
    "unicast_vs_multicast here": ({}, GROUP, [], ""),
    "unicast_vs_multicast there": (GROUP, {"multicast_group": ""}, [], ""),
    "no_natnet": ({"command_port": 1512}, {"command_port": 1510}, [], ""),
    "host_absent": ({"server": f"{LAN}.9"}, {"server": f"{LAN}.1"}, [], ""),
    "interface": ({"server": "10.99.0.1"}, {"server": f"{LAN}.1"}, [], ""),
    "command_port_only silent": ({}, {}, [], "0 999 silence"),
    "body_not_in_model_list": ({}, {}, [], "0 999 wrong_models r06"),
    "duplicate_name": ({}, {}, [], "0 999 duplicate_name r06"),
    "up_axis": ({}, {"up_axis": "z"}, [], ""),
    "units": ({}, {}, [], "0 999 millimetres"),
    "rate": ({}, {"frame_rate_hz": 60.0}, [], ""),
    "rate lost": ({}, {}, [], "0 999 drop 0.5"),
    "clock": ({}, {}, [], "0 999 no_echo"),
    "edit_mode": ({}, {}, [], "0 999 edit_mode"),
}


def serve(hosts: Hosts, command: list[str]) -> "subprocess.Popen[str]":
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(hosts.on(SERVER, *command), stdout=subprocess.PIPE, text=True, env=environment, cwd=ROOT)
    assert process.stdout is not None
    assert process.stdout.readline().startswith("READY")
    return process


BUSY = {"rate", "clock"}
"""What a busy machine brings about as well."""


def named(hosts: Hosts, path: Path, expected: str = "") -> set[str]:
    """Names of every check that the doctor does not pass."""
    command = [
        sys.executable,
        "-m",
        "mocap_bridge",
        "doctor",
        str(path),
        "--json",
        "--seconds",
        "2.2" if expected == "clock" else "0.8",
    ]
    done = subprocess.run(hosts.on(CLIENT, *command), capture_output=True, text=True, timeout=60, check=False, cwd=ROOT)
    results = json.loads(done.stdout or "null")
    assert results, done.stderr
    assert all(result["remedy"] for result in results if result["verdict"] != "pass")
    bad = {result["name"] for result in results if result["verdict"] != "pass"}
    if expected not in BUSY:
        bad -= BUSY
    assert done.returncode == (1 if any(result["verdict"] == "fail" for result in results) else 0)
    return bad


def emulate(
    hosts: Hosts, folder: Path, mocap: dict[str, object], options: list[str], script: str
) -> "subprocess.Popen[str]":
    (folder / "script.txt").write_text(script)
    theirs = arena_file(folder / "theirs.toml", mocap)
    words = ["emulate", "--arena", str(theirs), "--script", str(folder / "script.txt"), "--seconds", "60", *options]
    return serve(hosts, [sys.executable, "-m", "mocap_bridge", *words])


def end(process: "subprocess.Popen[str]") -> None:
    process.kill()
    process.communicate()


@pytest.mark.parametrize("cause", CAUSES)
def test_doctor_names_the_cause(hosts: Hosts, tmp_path: Path, cause: str) -> None:
    ours, theirs, options, script = CAUSES[cause]
    name = cause.partition(" ")[0]
    server = emulate(hosts, tmp_path, {**ours, **theirs, "local_address": f"{LAN}.1"}, options, script)
    try:
        found = named(hosts, arena_file(tmp_path / "ours.toml", ours), name)
    finally:
        end(server)
    assert found == ({name} if name else set())


@pytest.mark.parametrize("group", [GROUP, BROADCAST], ids=["multicast", "broadcast"])
def test_multicast_and_broadcast_pass(hosts: Hosts, tmp_path: Path, group: dict[str, object]) -> None:
    server = emulate(hosts, tmp_path, group, ["--address", f"{LAN}.1"], "")
    try:
        assert named(hosts, arena_file(tmp_path / "ours.toml", group)) == set()
    finally:
        end(server)


@pytest.mark.parametrize(
    ("host", "way", "port", "cause"),
    [
        (SERVER, "dport", "1510", "firewall"),
        (CLIENT, "sport", "1510", "command_port"),
        (CLIENT, "sport", "1511", "command_port_only"),
    ],
)
def test_port_that_a_firewall_closes(hosts: Hosts, tmp_path: Path, host: int, way: str, port: str, cause: str) -> None:
    """Dropped where the datagrams come in: nobody is told."""
    server = emulate(hosts, tmp_path, {}, [], "")
    rule = ("-n", hosts.names[host], "rule")
    local = ("pref", "0")
    try:
        ip(*rule, "add", "pref", "2", "lookup", "local")
        ip(*rule, "del", *local)
        ip(*rule, "add", "ipproto", "udp", way, port, "iif", "lan", "pref", "1", "blackhole")
        assert named(hosts, arena_file(tmp_path / "ours.toml", {})) == {cause}
    finally:
        end(server)
        for undo in (("add", *local, "lookup", "local"), ("del", "pref", "1"), ("del", "pref", "2")):
            subprocess.run(["ip", *rule, *undo], check=False, capture_output=True)


def test_server_beyond_a_gateway_that_does_not_answer(hosts: Hosts, tmp_path: Path) -> None:
    way = ("-n", hosts.names[CLIENT], "route")
    ip(*way, "add", "10.88.0.0/24", "via", f"{LAN}.1")
    try:
        assert named(hosts, arena_file(tmp_path / "ours.toml", {"server": "10.88.0.1"})) == {"other_subnet"}
    finally:
        ip(*way, "del", "10.88.0.0/24")


def test_version_that_nobody_here_knows(hosts: Hosts, tmp_path: Path) -> None:
    server = serve(hosts, [sys.executable, "-c", OLD_SERVER])
    try:
        assert named(hosts, arena_file(tmp_path / "ours.toml", {})) == {"version"}
    finally:
        end(server)

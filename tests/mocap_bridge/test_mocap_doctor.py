"""The doctor: every cause of "connected but no data" under its own name, pure and over loopback."""

import json
import math
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from contract.arena import Arena
from contract.checks import CheckResult
from mocap_bridge.cli import main
from mocap_bridge.diagnosis import diagnose
from mocap_bridge.evidence import Evidence
from mocap_bridge.interfaces import in_a_local_subnet, neighbour
from mocap_bridge.mock.bodies import settings_of
from mocap_bridge.mock.script import parse
from mocap_bridge.mock.server import EmulatedServer
from mocap_bridge.mock.udp import ServerShell
from mocap_bridge.natnet.handshake import ServerInfo
from mocap_bridge.natnet.version import Version
from mocap_bridge.verbs.doctor import examine
from tests.mocap_bridge.lockstep import arena, circling
from tests.mocap_bridge.test_mocap_bridge import arena_file, on_free_ports

HALF = math.sqrt(0.5)
UPRIGHT = (1, 1.0, 0.1, -1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1)
UNICAST = ServerInfo("Motive", (3, 1, 0, 0), Version(4, 1), 10_000_000, 1511, False, "239.255.42.99")
MULTICAST = UNICAST._replace(multicast=True)
NAMES = frozenset(("r06", "r08", "r09"))
GOOD = Evidence(
    route_address="127.0.0.1",
    info=UNICAST,
    seconds=3.0,
    frames=360,
    names=NAMES,
    bodies={name: [UPRIGHT] for name in NAMES},
    rate_hz=120.0,
    nominal_rate_hz=120.0,
    clock_error_ms=0.1,
)
NOTHING = GOOD._replace(frames=0, bodies={}, rate_hz=0.0)
SITE = arena()
GROUP = arena(multicast_group="239.255.42.99")
HIGH = (1, 1.0, 2.0, -1.0, *UPRIGHT[4:])
TURNED = (*UPRIGHT[:4], 0.0, 0.0, HALF, HALF, 0.0, 1)


def bad(seen: Evidence, site: Arena = SITE) -> list[CheckResult]:
    return [result for result in diagnose(seen, site) if result.verdict != "pass"]


def test_nothing_wrong() -> None:
    results = diagnose(GOOD, SITE)
    assert [result.name for result in results] == [
        "interface",
        "server",
        "frames",
        "bodies",
        "units",
        "up_axis",
        "rate",
        "clock",
    ]
    assert {result.verdict for result in results} == {"pass"}


@pytest.mark.parametrize(
    ("cause", "seen", "site"),
    [
        ("interface", GOOD._replace(route_address="", info=None), SITE),
        ("wrong_interface", GOOD._replace(route_address="192.168.7.5"), SITE),
        ("no_natnet", GOOD._replace(info=None, refused_ports=1), SITE),
        ("server_silent", GOOD._replace(info=None), SITE),
        ("other_subnet", GOOD._replace(info=None, same_subnet=False), SITE),
        ("host_absent", GOOD._replace(info=None, neighbour="absent"), SITE),
        ("firewall", GOOD._replace(info=None, neighbour="present"), SITE),
        ("command_port", GOOD._replace(info=None, early_frames=100), GROUP),
        ("version", GOOD._replace(problem="NatNet 4.4 is not supported"), SITE),
        ("version", GOOD._replace(other_bitstream=1), SITE),
        ("unicast_vs_multicast", NOTHING._replace(info=MULTICAST), SITE),
        ("unicast_vs_multicast", NOTHING, GROUP),
        ("multicast_group", NOTHING._replace(info=MULTICAST._replace(group="239.1.1.1")), GROUP),
        ("multicast_not_joined", NOTHING._replace(info=MULTICAST, elsewhere=("10.0.0.5",)), GROUP),
        ("foreign_sender", NOTHING._replace(foreign_senders=("10.0.0.7",)), SITE),
        ("malformed", NOTHING._replace(malformed=100, last_fault="suffix: 3 bytes"), SITE),
        ("command_port_only", NOTHING, SITE),
        ("body_not_in_model_list", GOOD._replace(names=frozenset(("r06", "r9"))), SITE),
        ("duplicate_name", GOOD._replace(names=NAMES - {"r06"}, duplicate_names=frozenset(("r06",))), SITE),
        ("duplicate_id", GOOD._replace(names=NAMES - {"r06"}, duplicate_ids=frozenset(("r06",))), SITE),
        ("occluded", GOOD._replace(bodies={"r06": [UPRIGHT], "r08": [UPRIGHT]}), SITE),
        ("units", GOOD._replace(units_to_millimetres=1.0), SITE),
        ("units", GOOD._replace(bodies={name: [(1, 900.0, *UPRIGHT[2:])] for name in NAMES}), SITE),
        ("up_axis", GOOD._replace(bodies={name: [TURNED] for name in NAMES}), SITE),
        ("up_axis", GOOD._replace(bodies={key: [UPRIGHT, HIGH] for key in NAMES}), SITE),
        ("rate", GOOD._replace(rate_hz=90.0), SITE),
        ("rate", GOOD._replace(rate_hz=240.0, nominal_rate_hz=240.0), SITE),
        ("clock", GOOD._replace(clock_error_ms=None), SITE),
        ("clock", GOOD._replace(clock_error_ms=5.0), SITE),
        ("edit_mode", GOOD._replace(edited=True), SITE),
    ],
)
def test_each_cause_is_named_alone_with_a_remedy(cause: str, seen: Evidence, site: Arena) -> None:
    [result] = [found for found in bad(seen, site) if found.name == cause] or [None]
    assert result is not None, bad(seen, site)
    assert result.seen
    assert result.remedy
    others = {found.name for found in bad(seen, site)} - {cause}
    assert not others


@contextmanager
def serving(site: Arena, faults: str = "", address: str = "127.0.0.1") -> Iterator[None]:
    server = EmulatedServer(settings_of(site, parse(faults)), [robot.body for robot in site.robots.values()])
    shell = ServerShell(server, address)
    poses = circling({name: robot.start for name, robot in site.robots.items()})
    stop = threading.Event()

    def serve() -> None:
        while not stop.wait(0.001):
            for fd in shell.fds():
                shell.on_readable(fd, time.monotonic_ns())
            if time.monotonic_ns() >= shell.next_due_ns:
                shell.stream(time.monotonic_ns(), poses(server.elapsed_s(time.monotonic_ns())))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        shell.close()


def changed(site: Arena, **mocap: object) -> Arena:
    import msgspec

    return msgspec.structs.replace(site, mocap=msgspec.structs.replace(site.mocap, **mocap))


@pytest.mark.parametrize(
    ("cause", "faults", "theirs"),
    [
        ("", "", {}),
        ("command_port_only", "0 99 silence", {}),
        ("server_silent", "0 99 deaf", {}),
        ("body_not_in_model_list", "0 99 wrong_models r06", {}),
        ("duplicate_name", "0 99 duplicate_name r06", {}),
        ("units", "0 99 millimetres", {}),
        ("edit_mode", "0 99 edit_mode", {}),
        ("up_axis", "", {"up_axis": "z"}),
        ("unicast_vs_multicast", "", {"multicast_group": "239.255.42.96"}),
    ],
)
def test_cause_is_recognised_over_loopback(cause: str, faults: str, theirs: dict[str, object]) -> None:
    site = on_free_ports(arena())
    with serving(changed(site, **theirs), faults):
        results = diagnose(examine(site, 0.8), site)
    named = [result.name for result in results if result.verdict == "fail"]
    assert named == ([cause] if cause else [])


def test_doctor_by_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    site = on_free_ports(arena())
    path = str(arena_file(tmp_path / "arena.toml", site))
    assert main(["doctor", path, "--seconds", "0.2"]) == 1
    said = capsys.readouterr().out
    assert "FAIL no_natnet: 127.0.0.1 is up, but nothing listens" in said
    assert "-> switch streaming on" in said
    assert main(["doctor", str(tmp_path / "none.toml")]) == 2
    assert main(["doctor", path, "--seconds", "0.2", "--json"]) == 1
    named = {result["name"]: result["verdict"] for result in json.loads(capsys.readouterr().out)}
    assert named == {"interface": "pass", "no_natnet": "fail"}


def test_interface_that_is_not_this_machines_is_named_with_the_choice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arena.toml"
    text = arena_file(path, on_free_ports(arena())).read_text()
    path.write_text(text.replace("[mocap]", '[mocap]\nlocal_address = "203.0.113.7"'))
    assert main(["doctor", str(path)]) == 1
    said = capsys.readouterr().out
    assert "FAIL wrong_interface: mocap.local_address = 203.0.113.7" in said
    assert "127.0.0.1 (lo)" in said


ARP = """IP address       HW type     Flags       HW address            Mask     Device
10.0.0.7         0x1         0x2         52:54:00:12:34:56     *        eth0
10.0.0.8         0x1         0x0         00:00:00:00:00:00     *        eth0
"""


@pytest.mark.parametrize(
    ("address", "state"), [("10.0.0.7", "present"), ("10.0.0.8", "absent"), ("10.0.0.9", "unknown")]
)
def test_hosts_of_the_subnet_are_known_by_arp(address: str, state: str) -> None:
    assert neighbour(address, ARP) == state
    assert neighbour(address, "") == "unknown"


def test_loopback_is_a_local_subnet_and_a_documentation_address_is_not() -> None:
    assert in_a_local_subnet("127.0.0.9")
    assert not in_a_local_subnet("203.0.113.7")

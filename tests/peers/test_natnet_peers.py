"""Independent NatNet clients read the emulated server over loopback UDP."""

import importlib.util
import json
import math
import select
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from contract.arena import Mocap
from groundstation.ports import free_ports
from mocap_bridge.mock.bodies import BodyState, ServerSettings
from mocap_bridge.mock.server import EmulatedServer
from mocap_bridge.mock.udp import ServerShell

POSES = [BodyState("r06", 1.0, 2.0, 0.5), BodyState("r08", 2.5, 1.5, -1.0)]
GROUP = "239.255.42.99"
VERSIONS = ["2.9", "3.0", "3.1", "4.0", "4.1", "4.2"]


@contextmanager
def serving(version: str, group: str = "", up_axis: str = "z") -> Iterator[Mocap]:
    """An emulated server at 100 Hz on free ports, in a thread."""
    command, data = free_ports(2)
    mocap = Mocap(
        version=version,
        multicast_group=group,
        command_port=command,
        data_port=data,
        up_axis=up_axis,  # type: ignore[arg-type]
        frame_rate_hz=100.0,
    )
    shell = ServerShell(EmulatedServer(ServerSettings(mocap=mocap), ["r06", "r08"]), "127.0.0.1")
    stop = threading.Event()

    def serve() -> None:
        while not stop.is_set():
            for fd in select.select(shell.fds(), [], [], 0.002)[0]:
                shell.on_readable(fd, time.monotonic_ns())
            if time.monotonic_ns() >= shell.next_due_ns:
                shell.stream(time.monotonic_ns(), POSES)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield mocap
    finally:
        stop.set()
        thread.join()
        shell.close()


def poll_until(done: object, step: object, seconds: float = 8.0) -> None:
    limit = time.monotonic() + seconds
    while not done():  # type: ignore[operator]
        assert time.monotonic() < limit, "the client saw nothing"
        step()  # type: ignore[operator]


@pytest.mark.parametrize("group", ["", GROUP], ids=["unicast", "multicast"])
@pytest.mark.parametrize("version", VERSIONS)
def test_natnet_package_reads_frames_and_models(version: str, group: str) -> None:
    natnet = pytest.importorskip("natnet")
    frames, models = [], []
    with serving(version, group) as mocap:
        client = natnet.NatNetClient(
            "127.0.0.1", "127.0.0.1", GROUP, mocap.command_port, mocap.data_port, use_multicast=bool(group)
        )
        client.on_data_frame_received_event.handlers.append(frames.append)
        client.on_data_description_received_event.handlers.append(models.append)
        with client:
            client.request_modeldef()
            poll_until(lambda: len(frames) >= 5 and models, client.update_sync)
    names = {body.id_num: body.name for body in models[0].rigid_bodies}
    assert set(names.values()) == {"r06", "r08"}
    for frame in frames[:5]:
        seen = {names[body.id_num]: body for body in frame.rigid_bodies}
        for pose in POSES:
            assert math.dist(seen[pose.name].pos[:2], (pose.x_m, pose.y_m)) < 1e-3
            assert seen[pose.name].tracking_valid
            yaw = 2.0 * math.atan2(seen[pose.name].rot[2], seen[pose.name].rot[3])
            assert abs(math.remainder(yaw - pose.heading_rad, math.tau)) < 1e-3
        assert len(frame.labeled_markers) == 6
    numbers = [frame.prefix.frame_number for frame in frames]
    assert numbers == sorted(numbers)


MOTIONCAPTURE = """
import sys, motioncapture
mc = motioncapture.connect("optitrack", {{"hostname": "127.0.0.1", "interface_ip": "127.0.0.1",
                                        "port_command": "{port}"}})
for _ in range(5):
    mc.waitForNextFrame()
for name, body in sorted(mc.rigidBodies.items()):
    print(name, *body.position, body.rotation.z, body.rotation.w)
"""


@pytest.mark.skipif(importlib.util.find_spec("motioncapture") is None, reason="motioncapture has no wheel here")
@pytest.mark.parametrize("version", VERSIONS[1:-1])
def test_motioncapture_reads_multicast(version: str) -> None:
    with serving(version, GROUP) as mocap:
        done = subprocess.run(
            [sys.executable, "-c", MOTIONCAPTURE.format(port=mocap.command_port)],
            capture_output=True,
            text=True,
            timeout=20,
            check=False,
        )
    lines = [line.split() for line in done.stdout.splitlines() if line[:1] == "r"]
    assert [line[0] for line in lines] == ["r06", "r08"], done.stderr
    for line, pose in zip(lines, POSES, strict=True):
        x, y, _, qz, qw = map(float, line[1:])
        assert math.dist((x, y), (pose.x_m, pose.y_m)) < 1e-3
        assert abs(math.remainder(2.0 * math.atan2(qz, qw) - pose.heading_rad, math.tau)) < 1e-3


NATNETSDK = """
import contextlib, io, json, os, sys, time
from natnetsdk.NatNetClient import NatNetClient
client, bodies, frames, said = NatNetClient(), {}, [], io.StringIO()
client.set_use_multicast(False)
client.command_port, client.data_port = map(int, sys.argv[1:])
client.rigid_body_listener = lambda number, position, rotation: bodies.update({number: [*position, *rotation]})
client.new_frame_listener = frames.append
with contextlib.redirect_stdout(said):
    client.set_print_level(0)
    client.run()
    limit = time.monotonic() + 10.0
    while len(frames) < 5 and time.monotonic() < limit:
        time.sleep(0.005)
    client.set_print_level(1)
    client.send_command("Bitstream")
    client.send_request(client.command_socket, client.NAT_REQUEST_MODELDEF, "", ("127.0.0.1", client.command_port))
    while "Rigid Body Name" not in said.getvalue() and time.monotonic() < limit:
        time.sleep(0.005)
    result = json.dumps({
        "bodies": bodies, "names": [name for name in ("r06", "r08") if name in said.getvalue()],
        "markers": frames[-1]["labeled_marker_count"], "numbers": [frame["frame_number"] for frame in frames],
        "streams": client.get_nat_net_requested_version()[:2], "server": client.get_application_name(),
    })
    os.write(1, result.encode())  # past the redirection, which its threads go on printing into
    os._exit(0)  # they wait for datagrams for ever
"""

NATNETCLIENT = """
import json, os, socket, sys, threading, time
from natnetclient.natnet import NatClient
from mocap_bridge.sources.natnet import data_socket
command, data = map(int, sys.argv[1:])
group = data_socket("239.255.42.99", data, "127.0.0.1")
group.setblocking(True)

def hand_on():  # its data socket has an address of its own, where Linux delivers no multicast
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
        while True:
            way.sendto(group.recv(65535), ("127.0.0.1", data))

threading.Thread(target=hand_on, daemon=True).start()
client = NatClient("127.0.0.1", data_port=data, comm_port=command)
limit, first = time.monotonic() + 10.0, client.iFrame
while client.iFrame < first + 5 and time.monotonic() < limit:
    time.sleep(0.005)
bodies = {name: [*body.position, *body.quaternion] for name, body in client.rigid_bodies.items() if body.seen}
print(json.dumps({"bodies": bodies, "version": client.natnet_version[:2]}), flush=True)
os._exit(0)
"""


def run_peer(program: str, mocap: Mocap) -> dict[str, object]:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program, str(mocap.command_port), str(mocap.data_port)],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert done.stdout, done.stderr
    return dict(json.loads(done.stdout))


def assert_poses(seen: dict[str, list[float]], keys: list[str]) -> None:
    for key, pose in zip(keys, POSES, strict=True):
        x, y, _, _, _, qz, qw = seen[key]
        assert math.dist((x, y), (pose.x_m, pose.y_m)) < 1e-3
        assert abs(math.remainder(2.0 * math.atan2(qz, qw) - pose.heading_rad, math.tau)) < 1e-3


@pytest.mark.parametrize("version", ["3.0", "4.1", "4.3"])
def test_natnetsdk_reads_unicast_and_asks_for_the_newest_version_it_knows(version: str) -> None:
    """OptiTrack's own sample. It takes a precision stamp for granted at 4.0, and misreads 2.x."""
    with serving(version) as mocap:
        seen = run_peer(NATNETSDK, mocap)
    assert_poses(seen["bodies"], ["1", "2"])  # type: ignore[arg-type]
    assert (seen["names"], seen["markers"], seen["server"]) == (["r06", "r08"], 6, "Emulated Motive")
    assert seen["streams"] in ([3, 0], [4, 1], [4, 3])
    assert seen["numbers"] == sorted(seen["numbers"])  # type: ignore[call-overload]


def test_natnetclient_reads_2_9() -> None:
    """Its requests announce four bytes of payload and have none."""
    with serving("2.9", GROUP) as mocap:
        seen = run_peer(NATNETCLIENT, mocap)
    assert seen["version"] == [2, 9]
    assert_poses(seen["bodies"], ["r06", "r08"])  # type: ignore[arg-type]

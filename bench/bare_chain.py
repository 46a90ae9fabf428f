"""The hops of pose_to_wheel without their work: UDP, Zenoh through a router session, pty. No JSON, law or feedback.

``hardware``  sends datagrams with a time stamp at the frame rate while told ``on``, and reads what arrives on the
              ptys; on ``off`` it prints the latencies of the block in nanoseconds
``bridge``    holds the router session; puts every datagram as it is
``agent``     writes the stamp of every payload to its pty
"""

import contextlib
import json
import os
import select
import socket
import sys
import time
import tty
from pathlib import Path
from typing import Any

import zenoh

from contract import network
from groundstation.rig import HARDWARE_NICENESS, REALTIME_NICENESS
from mocap_bridge.network import open_session, publisher

DATAGRAM_BYTES = 900
COMMAND_BYTES = 44
"""Two slcan set_input_vel frames."""
KEY = "bare/frame"


def client(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    for key, value in network.client_config(endpoint):
        config.insert_json5(key, value)
    return zenoh.open(config)


def bridge(endpoint: str, port: int) -> None:
    inlet = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    inlet.bind(("127.0.0.1", port))
    with open_session(endpoint) as opened:
        outlet = publisher(opened, KEY, "mocap_frame")
        print("READY bridge", flush=True)
        while True:
            outlet.put(inlet.recv(4096))


def agent(endpoint: str, path: str) -> None:
    event = os.eventfd(0, os.EFD_NONBLOCK)
    slot: list[bytes] = [b""]

    def store(sample: Any) -> None:
        slot[0] = sample.payload.to_bytes()
        os.eventfd_write(event, 1)

    with client(endpoint) as opened:
        opened.declare_subscriber(KEY, store)
        line = os.open(path, os.O_RDWR | os.O_NOCTTY)
        poll = select.poll()
        poll.register(event, select.POLLIN)
        print("READY agent", flush=True)
        while True:
            poll.poll()
            os.eventfd_read(event)
            os.write(line, slot[0][:16].ljust(COMMAND_BYTES - 1, b"0") + b"\n")


def hardware(port: int, rate_hz: float, folder: Path, count: int) -> None:
    outlet = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    poll = select.epoll()
    poll.register(sys.stdin.fileno(), select.EPOLLIN)
    lines = {}
    for number in range(count):
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        (folder / str(number)).symlink_to(os.ttyname(slave))
        poll.register(master, select.EPOLLIN)
        lines[master] = b""
    print("READY hardware", flush=True)
    period_ns, due_ns, on = round(1e9 / rate_hz), 0, False
    latencies: list[int] = []
    while True:
        wait_s = max(0.0, (due_ns - time.monotonic_ns()) / 1e9) if on else -1
        for number, _ in poll.poll(wait_s):
            if number == sys.stdin.fileno():
                word = sys.stdin.readline().strip()
                if not word:
                    return
                on, due_ns = word == "on", time.monotonic_ns()
                if not on:
                    print(json.dumps(latencies), flush=True)
                    latencies.clear()
                continue
            data = lines[number] + os.read(number, 65536)
            *whole, lines[number] = data.split(b"\n")
            now_ns = time.monotonic_ns()
            latencies += [now_ns - int(line[:16], 16) for line in whole]
        if on and time.monotonic_ns() >= due_ns:
            due_ns += period_ns
            outlet.sendto(b"%016x" % time.monotonic_ns() + bytes(DATAGRAM_BYTES - 16), ("127.0.0.1", port))


if __name__ == "__main__":
    role, *words = sys.argv[1:]
    with contextlib.suppress(OSError):
        os.nice(HARDWARE_NICENESS if role == "hardware" else REALTIME_NICENESS)
    if role == "bridge":
        bridge(words[0], int(words[1]))
    elif role == "agent":
        agent(words[0], words[1])
    else:
        hardware(int(words[0]), float(words[1]), Path(words[2]), int(words[3]))

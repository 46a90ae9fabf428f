"""The hops of pose_to_wheel with neither JSON, law nor feedback: what the wire itself costs.

The same bytes on the same hops through the same code: NatNet datagrams decoded and checked by the bridge, Zenoh
through its router, the gate, the drivers and their lines, the emulated hardware in the arena's own process. Between
them a frame is packed numbers, and every robot turns on the spot whatever it says; what the motors answer is thrown
away unread.

``bridge``  begins the router; puts number, transmit stamp and poses of every frame
``agent``   writes the wheels' speeds at every frame and tells now and then what passed when
"""

import argparse
import contextlib
import os
import select
import signal
import struct
import sys
import time
from pathlib import Path
from types import FrameType
from typing import Any

import zenoh

from contract import network
from contract.arena import Arena, load
from contract.codec import encode
from contract.keys import Keys
from contract.messages import MocapFrame, RobotStep, StepBatch
from drivers.base import STANDSTILL, WheelSpeeds
from drivers.registry import open_robot, wheel_faults
from mocap_bridge.network import open_session, publisher
from mocap_bridge.pipeline import Pipeline
from mocap_bridge.sources.choose import open_source

KEY = "bare/frame"
HEAD = struct.Struct("<QQ")
"""Frame number, transmit stamp in ns."""
POSE = struct.Struct("<ddd?")
TURNING = WheelSpeeds(-1.0, 1.0)
TICK_NS = 18_000_000
HOUSEKEEPING_NS = 4_000_000
TELL_EVERY = 10
"""Frames."""


class Ending:
    """Set by SIGTERM."""

    def __init__(self) -> None:
        self.now = False
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._end)

    def _end(self, number: int, frame: FrameType | None) -> None:
        self.now = True


def packed(frame: MocapFrame) -> bytes:
    poses = [POSE.pack(body.x_m, body.y_m, body.heading_rad, body.valid) for body in frame.bodies]
    return HEAD.pack(frame.frame, frame.transmit_ns) + b"".join(poses)


def bridge(arena: Arena, ending: Ending) -> None:
    source = open_source(arena)
    pipeline = Pipeline(arena, time.monotonic_ns() // 1_000_000)
    with open_session(arena.link.router) as joined:
        outlet = publisher(joined.session, KEY, "mocap_frame")
        print("READY bridge", flush=True)
        while not ending.now:
            source.wait(0.02)
            for frame in source.receive(time.monotonic_ns()):
                outlet.put(packed(pipeline.frame(frame, time.monotonic_ns())))
    source.close()


def agent(arena: Arena, robot: str, ending: Ending) -> None:
    os.environ.setdefault("ZENOH_RUNTIME", network.RUNTIME)
    event = os.eventfd(0, os.EFD_NONBLOCK)
    slot = [b""]

    def store(sample: Any) -> None:
        slot[0] = sample.payload.to_bytes()
        os.eventfd_write(event, 1)

    config = zenoh.Config()
    for key, value in network.client_config(arena.link.router):
        config.insert_json5(key, value)
    driver = open_robot(arena, robot)
    with zenoh.open(config) as opened:
        opened.declare_subscriber(KEY, zenoh.handlers.Callback(store, indirect=False))
        teller = publisher(opened, Keys(arena.arena.name).steps(robot), "steps")
        driver.configure()
        driver.activate(time.monotonic_ns())
        fd = driver.fileno()
        assert fd is not None
        poll = select.poll()
        poll.register(event, select.POLLIN)
        print(f"READY {robot}", flush=True)
        steps: list[RobotStep] = []
        wrote_ns = tidy_ns = 0
        while not ending.now:
            due_ns = min(wrote_ns + TICK_NS, tidy_ns or wrote_ns + TICK_NS)
            woken = poll.poll(max(0, due_ns - time.monotonic_ns()) / 1e6)
            now_ns = time.monotonic_ns()
            if woken:
                os.eventfd_read(event)
                number, sent_ns = HEAD.unpack_from(slot[0])
                driver.write(TURNING, now_ns, now_ns)
                wrote_ns = time.monotonic_ns()
                tidy_ns = now_ns + HOUSEKEEPING_NS
                steps.append(
                    RobotStep(
                        robot=robot,
                        frame=number,
                        exposure_ns=sent_ns,
                        step_ns=now_ns,
                        write_ns=wrote_ns,
                        left_radps=TURNING.left_radps,
                        right_radps=TURNING.right_radps,
                    )
                )
            elif now_ns - wrote_ns >= TICK_NS:
                driver.write(STANDSTILL, now_ns, now_ns)
                wrote_ns = now_ns
                tidy_ns = now_ns + HOUSEKEEPING_NS
            if tidy_ns and now_ns >= tidy_ns:
                tidy_ns = 0
                driver.poll(now_ns)
                with contextlib.suppress(BlockingIOError):
                    os.read(fd, 65536)
                if len(steps) >= TELL_EVERY:
                    teller.put(encode(StepBatch(robot=robot, steps=tuple(steps))))
                    steps.clear()
        driver.stop(time.monotonic_ns())
        driver.close()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("role", choices=("bridge", "agent"))
    parser.add_argument("--arena", type=Path, required=True, metavar="FILE")
    parser.add_argument("--robot", metavar="ID", default="", help="of an agent")
    options = parser.parse_args()
    arena, ending = load(options.arena, wheel_faults), Ending()
    if options.role == "bridge":
        bridge(arena, ending)
    else:
        agent(arena, options.robot, ending)
    return 0


if __name__ == "__main__":
    sys.exit(main())

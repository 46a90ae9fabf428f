"""``ahdc-drivers emulate``: one controller with motors behind it, on a pty for any program."""

import argparse
import importlib
import os
import select
import signal
import sys
import time
from pathlib import Path
from typing import Any

from contract.arena import Platform
from drivers.defaults import DEFAULTS
from drivers.mock.controller import EmulatedController, Wheels
from drivers.mock.motor import MotorLimits
from drivers.mock.ports import PtyPort
from drivers.registry import FAMILIES, family_of, read_options


def configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("kind", choices=[family.kind for family in FAMILIES], help="controller family")
    parser.add_argument("--port-link", type=Path, metavar="PATH", help="make the pty reachable under this name")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="an option of the family's wheels table, such as --set dialect=0.5 (see: ahdc-drivers list)",
    )
    parser.add_argument("--dialect", metavar="NAME", help="short for --set dialect=NAME")
    parser.add_argument("--report", action="store_true", help="print wheel speeds and refusals once a second")


def run(args: argparse.Namespace) -> int:
    family = family_of(args.kind)
    assert family is not None
    port = PtyPort(args.port_link)
    try:
        port.plug()
        options = _options(args, port.path)
    except (ValueError, OSError) as error:
        print(error, file=sys.stderr)
        port.unplug()
        return 2
    wheels = Wheels.of(MotorLimits.of(Platform()))
    controller = importlib.import_module(family.emulator).emulate(options, wheels)
    wake, stop = os.pipe()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: os.write(stop, b"x"))
    print(port.path, flush=True)
    try:
        serve(port, controller, wake, args.report)
    finally:
        port.unplug()
    return 0


def serve(port: PtyPort, controller: EmulatedController, wake: int, report: bool) -> None:
    """Until ``wake`` becomes readable."""
    reported_ns = time.monotonic_ns()
    while True:
        now_ns = time.monotonic_ns()
        due_ns = controller.next_due_ns()
        timeout_s = 0.5 if due_ns is None else min(0.5, max(0.0, (due_ns - now_ns) * 1e-9))
        readable, _, _ = select.select([port.fileno(), wake], [], [], timeout_s)
        if wake in readable:
            return
        now_ns = time.monotonic_ns()
        data = port.read() if readable else b""
        port.write(controller.receive(data, now_ns) if data else controller.advance(now_ns))
        controller.take_samples()
        if report and now_ns - reported_ns > 1_000_000_000:
            reported_ns = now_ns
            left, right = controller.wheels
            refused = dict(controller.counters + port.counters)
            print(f"left {left.radps:.2f} rad/s, right {right.radps:.2f} rad/s, refused {refused}", flush=True)


def _options(args: argparse.Namespace, path: str) -> Any:
    """The family's options with the command line's on top.

    :raises ValueError: naming every fault.
    """
    family = family_of(args.kind)
    assert family is not None
    table: dict[str, Any] = {"kind": args.kind, family.port_key: path, **DEFAULTS.get(args.kind, {})}
    words = [*args.set, *([f"dialect={args.dialect}"] if args.dialect else [])]
    for word in words:
        key, equals, text = word.partition("=")
        if not equals:
            raise ValueError(f"--set {word}: needs KEY=VALUE")
        table[key] = _value(key, text)
    return read_options(table)[1]


def _value(key: str, text: str) -> Any:
    if key == "dialect":
        return text
    if text in ("true", "false"):
        return text == "true"
    try:
        return int(text, 0)
    except ValueError:
        pass
    try:
        return float(text)
    except ValueError:
        return text

"""``ahdc-drivers doctor``: look at adapters, ports and controllers; name what is wrong. Enables nothing."""

import argparse
import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from contract.arena import Arena
from contract.checks import CheckResult, worst
from drivers.base import DriverError
from drivers.diagnosis import Evidence, diagnose
from drivers.registry import module_of, open_drive, open_robot, port_path, read_options
from drivers.verbs import robots

MARKS = {"pass": "ok  ", "warn": "WARN", "fail": "FAIL"}
RATES = {"channel": (125_000, 250_000, 500_000, 1_000_000), "port": (38400, 57600, 115200, 1_000_000)}
LISTEN_S = 0.3


def configure(parser: argparse.ArgumentParser) -> None:
    robots.take(parser, required=False)


def run(args: argparse.Namespace) -> int:
    arena = robots.given(args)
    if arena is None:
        return 2
    names = [args.robot] if args.robot else list(arena.robots)
    results = []
    for name in names:
        for result in examine(arena, name):
            results.append(result)
            print(f"{MARKS[result.verdict]} {result.subject} {result.name}: {result.seen}")
            if result.remedy and result.verdict != "pass":
                print(f"     -> {result.remedy}")
    return 0 if worst(results) != "fail" else 1


def examine(arena: Arena, robot: str) -> list[CheckResult]:
    """Everything about one robot's wheels."""
    table = arena.robots[robot].wheels
    seen = look(arena, robot, table)._replace(
        creep_mps=open_robot(arena, robot).dead_zone_radps * arena.platform.wheel_radius_m,
        max_speed_mps=arena.control.max_speed_mps,
    )
    return diagnose(robot, table, seen)


def look(arena: Arena, robot: str, table: dict[str, Any]) -> Evidence:
    """Gather the evidence: names, rights, kernel state, then the controllers themselves."""
    port = port_path(table)
    kernel = table.get("interface", "socketcan") == "socketcan" and "channel" in table
    others = tuple(found())
    if kernel:
        link = link_of(port)
        seen = Evidence(port, link is not None, others=others, link=link)
        if link is None or not link.get("up"):
            return seen
    else:
        seen = Evidence(port, os.path.exists(port), os.access(port, os.R_OK | os.W_OK), others, latency_ms(port))
    if not seen.present or not seen.usable:
        return seen
    error, counters = attempt(arena, robot, table)
    heard, dialect = overhear(table) if "channel" in table else ((), "")
    works_at = None
    if error is not None and not heard and not kernel:
        key = "bitrate" if "channel" in table else "baud"
        rates = [rate for rate in RATES["channel" if "channel" in table else "port"] if rate != table.get(key)]
        works_at = next((rate for rate in rates if attempt(arena, robot, {**table, key: rate})[0] is None), None)
    return seen._replace(error=error, counters=counters, heard=heard, dialect=dialect, works_at=works_at)


def attempt(arena: Arena, robot: str, table: dict[str, Any]) -> tuple[DriverError | None, dict[str, int]]:
    """Configure and close; what it raised and counted."""
    control = arena.control
    drive = open_drive(
        robot,
        table,
        arena.platform,
        arena.safety,
        max_speed_mps=control.max_speed_mps,
        control_period_s=control.control_period_s,
    )
    try:
        drive.configure()
    except DriverError as error:
        return error, dict(drive.counters)
    finally:
        drive.close()
    return None, dict(drive.counters)


def overhear(table: dict[str, Any]) -> tuple[tuple[int, ...], str]:
    """Device ids heard on the bus, and the firmware line of an ODrive."""
    from drivers.can.odrive_codec import GET_VERSION, request

    family, options = read_options(table)
    module: Any = module_of(family)
    port = module.open_port(options)
    sender = module.Drive.sender
    ids: set[int] = set()
    version = False
    try:
        port.open()
        if family.kind == "odrive":
            port.send([request(options.left, GET_VERSION)])  # type: ignore[attr-defined]
        end_ns = port.now_ns() + int(LISTEN_S * 1e9)
        while port.now_ns() < end_ns:
            port.wait(0.02)
            for frame in port.receive():
                if frame.remote:
                    continue
                ids.add(sender(None, frame.can_id))
                version = version or (family.kind == "odrive" and frame.can_id & 0x1F == GET_VERSION)
    except OSError:
        return tuple(sorted(ids)), ""
    finally:
        port.close()
    dialect = "" if family.kind != "odrive" or not ids else "0.6" if version else "0.5"
    return tuple(sorted(ids)), dialect


def found() -> Iterator[str]:
    """Stable names of serial devices, ports without one, and CAN interfaces."""
    stable = sorted(Path("/dev/serial/by-id").glob("*"))
    yield from map(str, stable)
    known = {path.resolve() for path in stable}
    for pattern in ("ttyUSB*", "ttyACM*", "ttyAMA*"):
        yield from (str(path) for path in sorted(Path("/dev").glob(pattern)) if path not in known)
    for path in sorted(Path("/sys/class/net").glob("*can*")):
        yield path.name


def latency_ms(port: str) -> int | None:
    """FTDI's latency timer of a serial device, None without one."""
    path = Path("/sys/bus/usb-serial/devices") / Path(port).resolve().name / "latency_timer"
    try:
        return int(path.read_text())
    except (OSError, ValueError):
        return None


def link_of(interface: str) -> dict[str, Any] | None:
    """What ``ip`` knows of a CAN interface; None if there is none."""
    command = ["ip", "-details", "-json", "link", "show", "dev", interface]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=5, check=False)
        (entry,) = json.loads(done.stdout) if done.returncode == 0 else [None]
    except (OSError, ValueError, subprocess.SubprocessError):
        entry = None
    return None if entry is None else link_facts(entry)


def link_facts(entry: dict[str, Any]) -> dict[str, Any]:
    """The facts of one entry of ``ip -details -json link show``."""
    data = entry.get("linkinfo", {}).get("info_data", {})
    return {
        "up": "UP" in entry.get("flags", []),
        "bitrate": data.get("bittiming", {}).get("bitrate"),
        "state": data.get("state"),
        "restart_ms": data.get("restart_ms"),
    }

"""What is wrong with a robot's wheels, from what was found on this computer. Pure."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from contract.checks import CheckResult
from drivers.base import DriverError

SLOW_LATENCY_MS = 1
CREEP_SHARE = 0.1
"""Of the top speed: wheels that stand at more than this cannot arrive where they should."""
_ERPM = (
    "Lower s_pid_min_erpm in VESC Tool (sensored motors turn from about 100 on) and write the same as min_erpm, "
    "or gear the motor down"
)
SLOWER = {
    "vesc": _ERPM,
    "vesc_uart": _ERPM,
    "ros_arduino": "Fit an encoder with more ticks a turn, or lower PID_RATE in the firmware and as pid_rate_hz",
}
"""What lets wheels turn more slowly, by family."""


class Evidence(NamedTuple):
    """Of one robot's port and of the controllers behind it."""

    port: str
    present: bool
    usable: bool = True
    """This user may read and write it."""
    others: tuple[str, ...] = ()
    """Adapters and ports found besides."""
    latency_ms: int | None = None
    """FTDI's latency timer."""
    link: Mapping[str, Any] | None = None
    """What the kernel says of a CAN interface: ``up``, ``bitrate``, ``state``, ``restart_ms``."""
    error: DriverError | None = None
    """Of ``configure``."""
    counters: Mapping[str, int] = {}
    heard: tuple[int, ...] = ()
    """Device ids heard on the bus."""
    works_at: int | None = None
    """Another bit rate at which the controllers answer."""
    dialect: str = ""
    """Firmware line the device speaks, where it can be told."""
    creep_mps: float = 0.0
    """Rim speed below which the wheels stand, by the arena file; 0: none worth a word."""
    max_speed_mps: float = 0.8


def diagnose(robot: str, table: Mapping[str, Any], seen: Evidence) -> list[CheckResult]:
    """Findings in the order in which they should be mended; passes only where something was looked at."""
    results = [_port(robot, seen)]
    if not seen.present:
        return results + _creep(robot, table, seen)
    for check in (_permission, _latency, _interface, _rate, _ids, _dialect, _watchdog):
        result = check(robot, table, seen)
        if result is not None:
            results.append(result)
    if seen.error is not None and all(result.verdict != "fail" for result in results):
        results.append(_result(robot, "controller", "fail", seen.error.fault, seen.error.remedy))
    elif seen.error is None:
        results.append(_result(robot, "controller", "pass", "answers and is set up; nothing was enabled"))
    return results + _creep(robot, table, seen)


def _result(robot: str, name: str, verdict: Any, text: str, remedy: str = "") -> CheckResult:
    return CheckResult(name=name, verdict=verdict, seen=text[:400], remedy=remedy[:400], subject=robot)


def _port(robot: str, seen: Evidence) -> CheckResult:
    if seen.present:
        return _result(robot, "port", "pass", f"{seen.port} is there")
    found = ", ".join(seen.others) or "none at all"
    remedy = "Plug the adapter in, or write one of the names found into the arena file"
    return _result(robot, "port", "fail", f"{seen.port} is not there; found: {found}", remedy)


def _permission(robot: str, table: Mapping[str, Any], seen: Evidence) -> CheckResult | None:
    if seen.usable:
        return None
    remedy = "Join the port's group: sudo usermod -aG dialout $USER, then log in again"
    return _result(robot, "permission", "fail", f"this user may not read and write {seen.port}", remedy)


def _latency(robot: str, table: Mapping[str, Any], seen: Evidence) -> CheckResult | None:
    if seen.latency_ms is None:
        return None
    if seen.latency_ms <= SLOW_LATENCY_MS:
        return _result(robot, "latency", "pass", f"latency timer {seen.latency_ms} ms")
    name = seen.port.rsplit("/", 1)[-1]
    return _result(
        robot,
        "latency",
        "warn",
        f"latency timer {seen.latency_ms} ms: every reply waits that long",
        f"echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer, or a udev rule",
    )


def _interface(robot: str, table: Mapping[str, Any], seen: Evidence) -> CheckResult | None:
    link = seen.link
    if link is None:
        return None
    rate = table.get("bitrate")
    wanted = f"bitrate {rate}" if rate else "bitrate <bit/s>"
    bring_up = f"sudo ip link set {seen.port} up type can {wanted} restart-ms 100"
    if not link.get("up"):
        return _result(robot, "interface", "fail", f"{seen.port} is down", bring_up)
    if rate and link.get("bitrate") not in (None, rate):
        text = f"{seen.port} runs at {link['bitrate']} bit/s, the arena file says {rate}"
        return _result(robot, "bitrate", "fail", text, f"sudo ip link set {seen.port} down; {bring_up}")
    if link.get("state") == "BUS-OFF":
        return _result(
            robot, "interface", "fail", f"{seen.port} is bus-off", f"Check wiring and termination; {bring_up}"
        )
    if link.get("state") in ("ERROR-WARNING", "ERROR-PASSIVE"):
        text = f"{seen.port} counts errors: {link['state'].lower()}"
        return _result(robot, "interface", "warn", text, "Check bitrate, wiring and termination")
    return _result(robot, "interface", "pass", f"{seen.port} is up at {link.get('bitrate', 'an unknown')} bit/s")


def _rate(robot: str, table: Mapping[str, Any], seen: Evidence) -> CheckResult | None:
    if seen.works_at is None:
        return None
    key = "bitrate" if "channel" in table else "baud"
    text = f"the controllers answer at {seen.works_at} bit/s, the arena file says {table.get(key, 'otherwise')}"
    return _result(
        robot, "bitrate", "fail", text, f"Write {key} = {seen.works_at}, or set the controllers to the file's"
    )


def _ids(robot: str, table: Mapping[str, Any], seen: Evidence) -> CheckResult | None:
    wanted = [table[side] for side in ("left", "right") if side in table]
    if not seen.heard or "channel" not in table:
        return None
    missing = [device for device in wanted if device not in seen.heard]
    heard = ", ".join(map(str, seen.heard))
    if not missing:
        return _result(robot, "ids", "pass", f"heard: {heard}")
    text = f"id {' and '.join(map(str, missing))} is silent; heard on the bus: {heard}"
    return _result(
        robot, "ids", "fail", text, "Write the ids heard as left and right, or set the controllers to the file's"
    )


def _dialect(robot: str, table: Mapping[str, Any], seen: Evidence) -> CheckResult | None:
    if not seen.dialect:
        return None
    stated = table.get("dialect", "0.6")
    if stated == seen.dialect:
        return _result(robot, "dialect", "pass", f"firmware {seen.dialect}")
    text = f"the device speaks firmware {seen.dialect}, the arena file says {stated}"
    return _result(robot, "dialect", "fail", text, f'Write dialect = "{seen.dialect}"')


def _watchdog(robot: str, table: Mapping[str, Any], seen: Evidence) -> CheckResult | None:
    off = table.get("watchdog_s") == 0 or table.get("silence_reaction") == "device"
    if not off:
        return None
    text = "the device watchdog is off by the arena file's word: a hung computer leaves the wheels turning"
    return _result(robot, "watchdog", "warn", text, "Set it in the device and state it: watchdog_s = 0.2")


def _creep(robot: str, table: Mapping[str, Any], seen: Evidence) -> list[CheckResult]:
    """What the arena file alone tells of wheels that cannot turn slowly."""
    if not seen.creep_mps:
        return []
    told = f"commands below {seen.creep_mps:.3g} m/s turn no wheel"
    share = seen.creep_mps / seen.max_speed_mps
    if share <= CREEP_SHARE:
        return [_result(robot, "creep", "pass", told)]
    told += f", {share:.0%} of control.max_speed_mps = {seen.max_speed_mps:g}"
    verdict, so = ("warn", "creeps in jerks and homes only nearly") if share < 1.0 else ("fail", "never drives")
    remedy = SLOWER.get(str(table.get("kind")), "Gear the motor down")
    return [_result(robot, "creep", verdict, f"{told}: the robot {so}", remedy)]

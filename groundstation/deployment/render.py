"""Unit and rules of one robot, from the templates. Pure."""

import re
from pathlib import Path

from contract.arena import Arena, Robot

INTERFACE = re.compile(r"[A-Za-z0-9_.-]{1,15}")
TEMPLATES = Path(__file__).parent / "templates"
CAN_UP = (
    'ACTION=="add", SUBSYSTEM=="net", KERNEL=="{channel}", ATTR{{tx_queue_len}}="128", '
    'RUN+="/sbin/ip link set %k up type can bitrate {bitrate} restart-ms 100"'
)


def unit_name(robot: str) -> str:
    """Of the service."""
    return f"ahdc-robot-{robot}.service"


def rules_name(robot: str) -> str:
    """Of the udev rules."""
    return f"80-ahdc-{robot}.rules"


def folder_of(arena: Arena, robot: str) -> str:
    """Where everything of one robot lies on its computer."""
    return f"{arena.deploy.folder}/{robot}"


def unit(arena: Arena, robot: str, release: str) -> str:
    """The service that runs one robot."""
    lines = []
    if arena.deploy.cpus:
        lines.append(f"CPUAffinity={' '.join(map(str, arena.deploy.cpus))}")
    if arena.deploy.realtime_priority:
        lines += ["CPUSchedulingPolicy=fifo", f"CPUSchedulingPriority={arena.deploy.realtime_priority}"]
    else:
        lines.append("RestrictRealtime=yes")
    return (
        (TEMPLATES / "robot.service")
        .read_text(encoding="utf-8")
        .format(
            robot=robot,
            site=arena.arena.name,
            release=release,
            folder=folder_of(arena, robot),
            scheduling="\n".join(lines),
        )
    )


def rules(robot: Robot) -> str:
    """What the kernel's devices are told when they appear."""
    return (TEMPLATES / "robot.rules").read_text(encoding="utf-8").format(can=_can(robot))


def _can(robot: Robot) -> str:
    wheels = robot.wheels
    channel, bitrate = wheels.get("channel", ""), wheels.get("bitrate", 500_000)
    if wheels.get("interface", "socketcan") != "socketcan" or not INTERFACE.fullmatch(channel):
        return "# No CAN interface of the kernel's."
    return CAN_UP.format(channel=channel, bitrate=bitrate)

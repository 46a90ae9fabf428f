"""Which controller families there are, and how an arena file's ``wheels`` table becomes a driver.

A family is a module with ``Options`` (a Struct whose fields explain themselves), ``check``,
``open_port`` and ``Drive``, and a module with ``emulate`` for its emulated controller.
"""

import importlib
import importlib.metadata
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

from contract.arena import Arena, Platform, Safety
from contract.tables import Fault, nearest, read_table, show
from drivers.base import DiffDrive, Site
from drivers.gate import Gate
from drivers.gated import GatedDrive, limits_of
from drivers.health import Health
from drivers.options import WheelOptions
from drivers.trim import Trim


class Family(NamedTuple):
    """One controller family."""

    kind: str
    module: str
    emulator: str
    port_key: str
    """The option that names the device or bus."""
    summary: str


FAMILIES: tuple[Family, ...] = (
    Family("odrive", "drivers.can.odrive", "drivers.mock.odrive", "channel", "ODrive CANSimple, firmware 0.5 and 0.6"),
    Family("roboclaw", "drivers.serial.roboclaw", "drivers.mock.roboclaw", "port", "RoboClaw packet serial"),
    Family("vesc", "drivers.can.vesc", "drivers.mock.vesc", "channel", "VESC over CAN, two controllers"),
    Family(
        "vesc_uart", "drivers.serial.vesc_uart", "drivers.mock.vesc_uart", "port", "VESC over UART, second one behind"
    ),
    Family("cia402", "drivers.can.cia402", "drivers.mock.cia402", "channel", "CANopen CiA 402, two drives"),
    Family("ros_arduino", "drivers.serial.arduino", "drivers.mock.arduino", "port", "ros_arduino_bridge ASCII"),
    Family("dynamixel", "drivers.serial.dynamixel", "drivers.mock.dynamixel", "port", "Dynamixel Protocol 2.0"),
)


class FamilyModule(Protocol):
    """What a family's module provides."""

    Options: type[WheelOptions]

    def check(self, options: WheelOptions, path: str) -> list[Fault]: ...

    def open_port(self, options: WheelOptions) -> Any: ...

    def Drive(self, robot: str, options: WheelOptions, site: Site, port: Any) -> DiffDrive: ...


PLUG_INS = "ahdc.drivers"
"""Entry point group: each entry names a :class:`Family` of another distribution."""


def families() -> tuple[Family, ...]:
    """Our own families and those of installed plug-ins.

    :raises TypeError: an entry point names something else.
    """
    found = list(FAMILIES)
    for entry in importlib.metadata.entry_points(group=PLUG_INS):
        family = entry.load()
        if not isinstance(family, Family):
            raise TypeError(f"entry point {entry.name} of {PLUG_INS}: {entry.value} is no drivers.registry.Family")
        found.append(family)
    return tuple(found)


def family_of(kind: object) -> Family | None:
    """Ours first: plug-ins are looked for only when the name is none of ours."""
    ours = next((family for family in FAMILIES if family.kind == kind), None)
    return ours or next((family for family in families() if family.kind == kind), None)


def module_of(family: Family) -> FamilyModule:
    """The driver module, imported when first needed."""
    module: Any = importlib.import_module(family.module)
    return module  # type: ignore[no-any-return]


def wheel_faults(table: Mapping[str, Any], path: str) -> list[Fault]:
    """Everything wrong in a ``wheels`` table; the ``wheel_check`` of :func:`contract.arena.load`."""
    faults: list[Fault] = []
    kind = table.get("kind")
    family = family_of(kind)
    if family is None:
        if isinstance(kind, str):
            known = [entry.kind for entry in families()]
            hint = nearest(kind, known)
            faults.append(Fault(f"{path}.kind", show(kind), "needs one of " + ", ".join(known), hint))
        return faults
    module = module_of(family)
    options = read_table(module.Options, dict(table), path, faults)
    return faults if options is None else [*faults, *module.check(options, path)]


def read_options(table: Mapping[str, Any]) -> tuple[Family, WheelOptions]:
    """Family and options of a table.

    :raises ValueError: naming every fault.
    """
    faults = wheel_faults(table, "wheels")
    family = family_of(table.get("kind"))
    if faults or family is None:
        text = "; ".join(map(str, faults)) or f"wheels.kind = {show(table.get('kind', ''))}: no such family"
        raise ValueError(text)
    options: WheelOptions = read_table(module_of(family).Options, dict(table), "wheels", [])
    return family, options


def port_path(table: Mapping[str, Any]) -> str:
    """Device or bus a ``wheels`` table names."""
    family = family_of(table.get("kind"))
    return str(table.get(family.port_key, "")) if family else ""


def trim_of(options: WheelOptions) -> Trim:
    """The robot's own dimensions."""
    return Trim(
        options.left_wheel_radius_multiplier,
        options.right_wheel_radius_multiplier,
        options.wheel_separation_multiplier,
    )


def open_drive(
    robot_id: str,
    wheels_table: Mapping[str, Any],
    platform: Platform,
    safety: Safety,
    *,
    max_speed_mps: float = 0.8,
    control_period_s: float = 0.01,
    port: Any = None,
) -> GatedDrive:
    """A closed driver behind the gate; ``configure`` opens it.

    :param port: in place of the one the table names: another transport, or a wire in virtual time.
    :raises ValueError: the table is faulty; see :func:`wheel_faults`.
    """
    family, options = read_options(wheels_table)
    module = module_of(family)
    site = Site(platform, safety, max_speed_mps, control_period_s)
    drive = module.Drive(robot_id, options, site, module.open_port(options) if port is None else port)
    return GatedDrive(drive, Gate(limits_of(site)), Health(safety, drive.dead_zone_radps), trim_of(options))


def open_robot(arena: Arena, robot_id: str, port: Any = None) -> GatedDrive:
    """:func:`open_drive` with everything taken from the arena."""
    return open_drive(
        robot_id,
        arena.robots[robot_id].wheels,
        arena.platform,
        arena.safety,
        max_speed_mps=arena.control.max_speed_mps,
        control_period_s=arena.control.control_period_s,
        port=port,
    )

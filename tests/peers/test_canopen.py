"""``canopen``'s CiA 402 profile node lays out and drives our emulated drive through a pty, with its own threads."""

import subprocess
import sys
import time
from collections.abc import Iterator

import canopen
import pytest
from canopen.objectdictionary import ObjectDictionary, ODRecord, ODVariable, datatypes
from canopen.profiles.p402 import BaseNode402

VARIABLES = {
    0x6040: datatypes.UNSIGNED16,
    0x6041: datatypes.UNSIGNED16,
    0x6060: datatypes.INTEGER8,
    0x6061: datatypes.INTEGER8,
    0x606C: datatypes.INTEGER32,
    0x60FF: datatypes.INTEGER32,
    0x6502: datatypes.UNSIGNED32,
}
SIZES = {0: datatypes.UNSIGNED8, 2: datatypes.UNSIGNED8, 3: datatypes.UNSIGNED16, 5: datatypes.UNSIGNED16}


def dictionary() -> ObjectDictionary:
    """What an EDS file of such a drive lists."""
    objects = ObjectDictionary()
    for index, kind in VARIABLES.items():
        entry = ODVariable(f"{index:04X}", index)
        entry.data_type = kind
        objects.add_object(entry)
    for index, subs in ((0x1400, (0, 1, 2)), (0x1800, (0, 1, 2, 3, 5)), (0x1600, range(5)), (0x1A00, range(5))):
        record = ODRecord(f"{index:04X}", index)
        for sub in subs:
            entry = ODVariable(f"{index:04X}:{sub}", index, sub)
            entry.data_type = datatypes.UNSIGNED32 if sub and index & 0x200 else SIZES.get(sub, datatypes.UNSIGNED32)
            record.add_member(entry)
        objects.add_object(record)
    return objects


@pytest.fixture
def node(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BaseNode402]:
    link = tmp_path_factory.mktemp("canopen") / "can"
    command = [sys.executable, "-m", "drivers", "emulate", "cia402", "--port-link", str(link)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        network = canopen.Network()
        network.connect(interface="slcan", channel=str(link), bitrate=500_000, sleep_after_open=0)
        yield network.add_node(BaseNode402(1, dictionary()))
        network.disconnect()
        process.terminate()


@pytest.mark.parametrize("timer_ms", [10, None])
def test_the_librarys_profile_node_drives(node: BaseNode402, timer_ms: int | None) -> None:
    node.nmt.state = "PRE-OPERATIONAL"
    for pdos, objects in ((node.tpdo, (0x6041, 0x606C)), (node.rpdo, (0x6040, 0x60FF))):
        pdos.read()
        pdos[1].clear()
        for index in objects:
            pdos[1].add_variable(index)
        pdos[1].enabled = True
    node.tpdo[1].event_timer = timer_ms or 0
    node.tpdo.save()
    node.rpdo.save()
    node.setup_402_state_machine(read_pdos=False)
    node.nmt.state = "OPERATIONAL"
    node.op_mode = "PROFILED VELOCITY"
    node.state = "OPERATION ENABLED"
    for target in (4096, -8192):
        node.rpdo[1][0x60FF].raw = target
        node.rpdo[1].transmit()
        until = time.monotonic() + 20.0
        while abs(node.sdo[0x606C].raw - target) > 20:
            assert time.monotonic() < until, node.sdo[0x606C].raw
    node.state = "QUICK STOP ACTIVE"
    node.state = "SWITCH ON DISABLED"
    node.nmt.state = "RESET"
    assert node.sdo[0x6041].raw == 0x40

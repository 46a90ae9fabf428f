"""CiA 402: golden bytes from CiA 301 v4.2 and CiA 402-2; the ``canopen`` library as peer of driver and emulator."""

import struct
from collections.abc import Callable, Sequence
from typing import Any

import canopen
import pytest
from benches import ROBOT, Bench, arena_of
from canopen.objectdictionary import ObjectDictionary, ODArray, ODRecord, ODVariable
from canopen.profiles.p402 import State402
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base import ControllerFault, LinkLost, Refused
from drivers.can import cia402_codec as codec
from drivers.can.canopen_master import LineNetwork, LineSdo
from drivers.can.frame import CanFrame
from drivers.can.line import CanLine
from drivers.registry import open_robot

LEFT, RIGHT, MASTER = 4, 5, 127


@pytest.mark.parametrize(
    ("frame", "can_id", "data"),
    [
        (codec.setpoint(4, codec.ENABLE, 1000), 0x204, "0f00e8030000"),
        (codec.setpoint(5, codec.SHUTDOWN, -1), 0x205, "0600ffffffff"),
        (codec.setpoint(5, codec.RESET, 0), 0x205, "800000000000"),
        (codec.heartbeat(127), 0x77F, "05"),
        (codec.ask_bus_voltage(4), 0x604, "4079600000000000"),
    ],
)
def test_golden_commands(frame: CanFrame, can_id: int, data: str) -> None:
    assert (frame.can_id, frame.data.hex(), frame.extended, frame.remote) == (can_id, data, False, False)


def test_golden_telemetry() -> None:
    assert codec.decode_motion(bytes.fromhex("2702 18fcffff")) == codec.Motion(0x0227, -1000)
    assert codec.decode_position(bytes.fromhex("ffffff7f")) == 2**31 - 1
    assert codec.decode_emergency(bytes.fromhex("3081 11 0000000000")) == 0x8130
    assert codec.decode_sdo(bytes.fromhex("43796000 c05d0000")) == codec.SdoValue(0x6079, 0, 24000)
    assert codec.decode_sdo(bytes.fromhex("4b3f6000 3081ffff")) == codec.SdoValue(0x603F, 0, 0x8130)
    assert codec.decode_sdo(bytes.fromhex("80796000 00000206")) is None, "an abort"


def test_golden_mapping_switches_each_pdo_off_before_it_changes() -> None:
    writes = codec.mapping(4, 10)
    assert [(w.item, w.subindex, w.data.hex()) for w in writes[:7]] == [
        (0x1400, 1, "04020080"),
        (0x1600, 0, "00"),
        (0x1600, 1, "10004060"),
        (0x1600, 2, "2000ff60"),
        (0x1600, 0, "02"),
        (0x1400, 2, "ff"),
        (0x1400, 1, "04020000"),
    ]
    assert codec.Write(0x1800, 5, 2, 10) in writes
    assert codec.consumer_heartbeat(127, 200) == codec.Write(0x1016, 1, 4, 0x007F00C8)


LIBRARY_NAMES = {
    "not ready": "NOT READY TO SWITCH ON",
    "switch-on disabled": "SWITCH ON DISABLED",
    "ready": "READY TO SWITCH ON",
    "switched on": "SWITCHED ON",
    "operation enabled": "OPERATION ENABLED",
    "quick stop": "QUICK STOP ACTIVE",
    "fault reaction": "FAULT REACTION ACTIVE",
    "fault": "FAULT",
}


def test_every_statusword_has_the_state_the_library_gives_it() -> None:
    for word in range(0x10000):
        theirs = {name for name, (mask, value) in State402.SW_MASK.items() if word & mask == value}
        ours = codec.state_of(word)
        assert theirs == ({LIBRARY_NAMES[ours]} if ours in LIBRARY_NAMES else set()), hex(word)


def test_every_step_towards_enabled_is_one_the_library_takes() -> None:
    for state, controlword in codec.TO_ENABLED.items():
        name = LIBRARY_NAMES[state]
        if state == "operation enabled":
            continue
        steps = {word for (here, _), word in State402.TRANSITIONTABLE.items() if here == name}
        assert controlword in steps
    assert not {"fault", "fault reaction", "not ready"} & set(codec.TO_ENABLED)


@given(st.binary(max_size=8), st.integers(0, 2**11 - 1))
@settings(max_examples=30)
def test_any_frame_is_survived_by_both_ends(data: bytes, can_id: int) -> None:
    bench = Bench("cia402")
    bench.start()
    bench.drive.inner._deal(CanFrame(can_id, data))
    bench.drive.read(bench.now_ns)
    bench.device.device.take_frame(CanFrame(can_id, data), bench.now_ns)
    bench.device.device.take_frame(CanFrame(can_id, data, True), bench.now_ns)


# --- the library's slaves under our driver --------------------------------------------------------------


def dictionary() -> ObjectDictionary:
    """What a drive of another make would have."""
    objects = ObjectDictionary()

    def add(index: int, subindex: int | None, size: int, value: int, parent: Any = None) -> None:
        variable = ODVariable(f"{index:04X}.{subindex or 0}", index, subindex or 0)
        variable.data_type = {1: 5, 2: 6, 4: 7}[size]
        variable.value = variable.default = value
        if parent is None:
            objects.add_object(variable)
        else:
            parent.add_member(variable)

    for index, size, value in ((0x1000, 4, 0x20192), (0x6007, 2, 0), (0x6060, 1, 0), (0x1017, 2, 0)):
        add(index, None, size, value)
    watch = ODArray("consumer heartbeat", 0x1016)
    objects.add_object(watch)
    add(0x1016, 0, 1, 1, watch)
    add(0x1016, 1, 4, 0, watch)
    for record in (0x1400, 0x1800, 0x1801):
        for index, sizes in ((record, (1, 4, 1, 2, 1, 2)), (record + 0x200, (1, 4, 4, 4, 4))):
            entry = ODRecord(f"{index:04X}", index)
            objects.add_object(entry)
            for subindex, size in enumerate(sizes):
                add(index, subindex, size, 0, entry)
    return objects


class LibrarySlaves(canopen.Network):
    """Two ``canopen.LocalNode`` as a :class:`drivers.ports.FramePort`, no threads, no clock."""

    name = "library"

    def __init__(self) -> None:
        super().__init__()
        self.frames: list[CanFrame] = []
        self.time_ns = 0
        self.locals = [self.create_node(node, dictionary()) for node in (LEFT, RIGHT)]

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self.frames.append(CanFrame(can_id, bytes(data)))

    def open(self) -> None: ...

    def close(self) -> None: ...

    def fileno(self) -> None:
        return None

    def now_ns(self) -> int:
        return self.time_ns

    def wait(self, timeout_s: float) -> None:
        self.time_ns += int(timeout_s * 1e9)

    def send(self, frames: Sequence[CanFrame]) -> bool:
        for frame in frames:
            self.notify(frame.can_id, bytearray(frame.data), 0.0)
        return True

    def receive(self) -> list[CanFrame]:
        for node in self.locals:
            if node.nmt.state == "OPERATIONAL":
                self.send_message(0x180 + node.id, struct.pack("<Hi", 0x40, 0))
                self.send_message(0x280 + node.id, bytes(4))
        taken, self.frames = self.frames, []
        return taken

    def take_counters(self) -> dict[str, int]:
        return {}


def test_the_librarys_slaves_take_our_whole_configuration() -> None:
    port = LibrarySlaves()
    drive = open_robot(arena_of("cia402", mode="csv"), ROBOT, port=port)
    drive.configure()
    for node in port.locals:
        assert node.nmt.state == "OPERATIONAL"
        assert node.sdo[0x6060].raw == 9
        assert node.sdo[0x1016][1].raw == MASTER << 16 | 200
        assert node.sdo[0x6007].raw == 1
        assert node.sdo[0x1400][1].raw == 0x200 + node.id
        assert [node.sdo[0x1600][place].raw for place in range(3)] == [2, 0x60400010, 0x60FF0020]
        assert [node.sdo[0x1A00][place].raw for place in range(3)] == [2, 0x60410010, 0x606C0020]
        assert [node.sdo[0x1A01][place].raw for place in range(2)] == [1, 0x60640020]
        assert node.sdo[0x1800][5].raw == 10
    assert not drive.counters


def test_an_object_the_librarys_slave_lacks_is_refused_by_number() -> None:
    port = LibrarySlaves()
    for node in port.locals:
        del node.object_dictionary.indices[0x6007]
    with pytest.raises(Refused, match=r"left \(node 4\) aborts writing 0x1 to 6007h:0 with 0x06020000"):
        open_robot(arena_of("cia402"), ROBOT, port=port).configure()
    open_robot(arena_of("cia402", silence_reaction="device"), ROBOT, port=port).configure()


# --- the library as master of our emulator --------------------------------------------------------------


def library_master(bench: Bench) -> tuple[LineNetwork, Callable[[int], LineSdo]]:
    port = bench.host.wire(ROBOT, bench.clock)
    port.open()
    line: CanLine
    network: LineNetwork

    def take(frame: CanFrame) -> str:
        network.notify(frame.can_id, bytearray(frame.data), 0.0)
        return ""

    line = CanLine("library", port, take)
    network = LineNetwork(line)
    return network, lambda node: LineSdo(network, node)


def test_the_librarys_sdo_client_and_remote_node_command_our_emulator() -> None:
    bench = Bench("cia402")
    network, client = library_master(bench)
    sdo = client(LEFT)
    assert int.from_bytes(sdo.upload(0x1000, 0), "little") == 0x20192
    sdo.download(0x6060, 0, b"\3")
    assert sdo.upload(0x6061, 0) == b"\3"
    for code, index, data in (
        (0x06010002, 0x6041, bytes(2)),
        (0x06020000, 0x5FFF, b"\1"),
        (0x06070010, 0x6060, bytes(2)),
    ):
        with pytest.raises(canopen.SdoAbortedError) as caught:
            sdo.download(index, 0, data)
        assert caught.value.code == code
    remote = network.add_node(LEFT, dictionary())
    remote.nmt.state = "OPERATIONAL"
    assert bench.device.device.slaves[0].nmt == 5
    for word in (6, 7, 15):
        sdo.download(0x6040, 0, struct.pack("<H", word))
    sdo.download(0x60FF, 0, struct.pack("<i", 4096))
    bench.clock.let_pass(1.5)
    bench.host.advance(bench.now_ns)
    assert bench.speeds().left_radps == pytest.approx(2 * 3.14159265 / 7.0, abs=0.01)
    (velocity,) = struct.unpack("<i", sdo.upload(0x606C, 0))
    assert velocity == pytest.approx(4096, abs=5)
    network.line.drain()
    assert remote.nmt.state == "OPERATIONAL", "told by our emulator's heartbeat"


# --- pitfalls -------------------------------------------------------------------------------------------


def slaves(bench: Bench) -> Any:
    return bench.device.device.slaves


def test_pitfall_the_watchdog_is_off_until_1016h_is_set_and_read_back() -> None:
    bench = Bench("cia402")
    assert slaves(bench)[0].get(0x1016, 1) == 0
    bench.drive.configure()
    assert [slave.get(0x1016, 1) for slave in slaves(bench)] == [0x007F00C8, 0x007F00C8]
    deaf = Bench("cia402")
    store = slaves(deaf)[1]._store
    slaves(deaf)[1]._store = lambda index, *rest: 0 if index == 0x1016 else store(index, *rest)
    with pytest.raises(
        Refused, match=r"heartbeat consumer \(1016h:1\) of right \(node 5\) set to 0x7F00C8 reads back 0x0"
    ):
        deaf.drive.configure()


def test_pitfall_monitoring_starts_with_the_first_heartbeat_so_the_master_must_send_them() -> None:
    bench = Bench("cia402")
    bench.drive.configure()
    bench.run(1.0)
    assert "watchdog_expired" not in bench.device.counters, "configured and idle: not yet watched"
    bench.drive.activate(bench.now_ns)
    bench.run(0.5, (5.0, 5.0))
    bench.run(0.3)
    assert bench.device.counters["watchdog_expired"] == 2


def test_pitfall_polls_and_process_data_alone_feed_no_watchdog() -> None:
    bench = Bench("cia402")
    bench.start()
    bench.run(0.5, (10.0, 10.0))
    for _ in range(60):
        bench.device.device.take_frame(codec.setpoint(LEFT, codec.ENABLE, 1000), bench.now_ns)
        bench.drive.inner.poll(bench.now_ns)
        bench.run(0.008)
    assert bench.device.counters["watchdog_expired"] == 2
    assert not bench.device.wheels.left.powered


def test_pitfall_the_reaction_to_silence_is_the_devices_own_and_may_be_nothing() -> None:
    bench = Bench("cia402", silence_reaction="device")
    bench.start()
    bench.run(1.0, (10.0, 10.0))
    bench.run(1.0)
    assert bench.speeds() == pytest.approx((10.0, 10.0), abs=0.01), "6007h = 0: the named risk"
    quick = Bench("cia402", silence_reaction="quick_stop")
    quick.start()
    quick.run(1.0, (10.0, 10.0))
    quick.run(1.5)
    assert quick.speeds() == pytest.approx((0.0, 0.0), abs=0.01)
    assert quick.device.wheels.left.powered, "braked in closed loop"


@pytest.mark.parametrize("units", [60.0, 60.0 * 512 * 4096 / 1875])
def test_pitfall_velocity_units_are_the_vendors(units: float) -> None:
    bench = Bench("cia402", velocity_per_revps=units)
    bench.start()
    feedback = bench.run(1.5, (10.0, -4.0))
    assert bench.speeds() == pytest.approx((10.0, -4.0), abs=0.1)
    assert feedback is not None
    assert (feedback.left_radps, feedback.right_radps) == pytest.approx((10.0, -4.0), abs=0.1)


def test_pitfall_a_fault_needs_an_edge_and_clears_only_on_demand() -> None:
    bench = Bench("cia402")
    bench.start()
    bench.run(0.5, (5.0, 5.0))
    slaves(bench)[0].fault(0x3220)
    feedback = bench.run(0.5, (5.0, 5.0))
    assert feedback is not None
    assert not feedback.enabled
    assert feedback.faults == ("left fault",) or "left bus under-voltage" in feedback.faults
    bench.drive.deactivate(bench.now_ns)
    with pytest.raises(ControllerFault, match="left bus under-voltage"):
        bench.drive.activate(bench.now_ns)
    assert slaves(bench)[0].get(0x6041) == 8, "activation resets no fault but that of our own silence"
    bench.drive.clear_errors(bench.now_ns)
    bench.drive.activate(bench.now_ns)
    bench.run(1.5, (5.0, 5.0))
    assert bench.speeds() == pytest.approx((5.0, 5.0), abs=0.02)


def test_a_drive_that_was_power_cycled_is_not_enabled_by_setpoints() -> None:
    bench = Bench("cia402")
    bench.start()
    bench.run(0.5, (5.0, 5.0))
    slaves(bench)[0]._enter(0x40)
    feedback = bench.run(1.0, (5.0, 5.0))
    assert feedback is not None
    assert "left switch-on disabled" in feedback.faults
    assert bench.speeds().left_radps == 0.0


def test_what_is_not_a_drive_or_not_there_is_named() -> None:
    bench = Bench("cia402")
    slaves(bench)[1].put(0x1000, 401)
    with pytest.raises(Refused, match=r"right \(node 5\) follows device profile 401"):
        bench.drive.configure()
    slaves(bench)[1].node = 9
    with pytest.raises(LinkLost, match=r"no SDO answer from right \(node 5\)"):
        bench.drive.configure()
    with pytest.raises(ValueError, match=r"wheels\.master = 4: must differ"):
        arena_of("cia402", master=4)


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "drivers.can.canopen_master", None)
    with pytest.raises(Refused, match="canopen library is missing") as caught:
        Bench("cia402").drive.configure()
    assert "ahdc-fieldkit[canopen]" in caught.value.remedy


def test_position_wraps_without_a_jump() -> None:
    bench = Bench("cia402")
    for slave in slaves(bench):
        slave.shaft._start_turns = 2**31 / 4096 - 0.5
    bench.start()
    feedback = bench.run(1.0, (10.0, 10.0))
    assert feedback is not None
    assert feedback.left_rad == pytest.approx(bench.device.wheels.left.angle_rad, abs=0.2)


def test_a_reset_node_is_as_it_was_when_switched_on() -> None:
    """CiA 301: reset node takes every object back to power-up, reset communication those below 2000h."""
    bench = Bench("cia402")
    bench.start()
    bench.run(1.0, (5.0, 5.0))
    left, right = slaves(bench)
    frames = bench.device.device.take_frame(CanFrame(0, bytes((0x82, RIGHT))), bench.now_ns)
    assert (right.nmt, right.get(0x1016, 1), right.get(0x6060)) == (0x7F, 0, 3)
    frames += bench.device.device.take_frame(CanFrame(0, bytes((0x81, LEFT))), bench.now_ns)
    assert not left.shaft.wheel.powered
    assert (left.nmt, left.get(0x6041), left.get(0x6060), left.get(0x60FF)) == (0x7F, 0x40, 0, 0)
    sent = frames + bench.device.device.advance(bench.now_ns)
    assert {frame.can_id for frame in sent if frame.data == b"\0"} == {0x700 + LEFT, 0x700 + RIGHT}


def test_other_masters_find_identity_and_records() -> None:
    """CiA 301: 1018h is mandatory, sub 0 of a record is its highest sub; 402: what profile velocity is tuned by."""
    bench = Bench("cia402")
    _, client = library_master(bench)
    sdo = client(LEFT)
    numbers = {
        (0x1018, 0): 4,
        (0x1018, 1): 0,
        (0x1400, 0): 2,
        (0x1800, 0): 5,
        (0x1800, 3): 0,
        (0x605A, 0): 2,
        (0x6083, 0): 0,
        (0x6084, 0): 0,
        (0x607F, 0): 0,
    }
    for (index, subindex), number in numbers.items():
        assert int.from_bytes(sdo.upload(index, subindex), "little") == number, f"{index:04X}h:{subindex}"
    sdo.download(0x6083, 0, struct.pack("<I", 5000))
    with pytest.raises(canopen.SdoAbortedError):
        sdo.download(0x1018, 1, bytes(4))


def test_a_statusword_that_changes_is_told_without_any_timer() -> None:
    bench = Bench("cia402")
    left = slaves(bench)[0]
    device = bench.device.device
    device.advance(bench.now_ns)
    device.take_frame(CanFrame(0, bytes((1, LEFT))), bench.now_ns)

    def told(word: int) -> list[bytes]:
        left.control(word)
        return [frame.data for frame in device.advance(bench.now_ns) if frame.can_id == 0x180 + LEFT]

    assert told(0) == [b"\x40\0"], "once after the start"
    assert told(6) == [b"\x21\0"]
    assert told(6) == []
    left.put(0x1800, 1, 2)
    assert told(7) == [], "transmission type 1 waits for a SYNC"


@pytest.mark.parametrize(
    ("entries", "count", "code"),
    [
        ((), 1, 0x06040041),
        ((0x60400010,), 2, 0x06040041),
        ((0x5FFF0010,), 1, 0x06040041),
        ((0x60400010, 0x60FF0010), 2, 0x06040041),
        ((0x60640020, 0x606C0020, 0x60410010), 3, 0x06040042),
        ((0x60410010,) * 4, 5, 0x06040042),
        ((0x60640020, 0x606C0020), 2, 0),
    ],
)
def test_a_map_of_nothing_or_of_too_much_is_refused(entries: tuple[int, ...], count: int, code: int) -> None:
    """CiA 301: 0604 0041h object cannot be mapped, 0604 0042h longer than a PDO."""
    bench = Bench("cia402")
    left = slaves(bench)[0]

    def write(index: int, subindex: int, size: int, value: int) -> int:
        request = struct.pack("<BHBI", 0x23 | (4 - size) << 2, index, subindex, value)
        answer = left.transfer(request).data
        return struct.unpack_from("<I", answer, 4)[0] if answer[0] == 0x80 else 0

    assert write(0x1800, 1, 4, 0x80000181) == write(0x1A00, 0, 1, 0) == write(0x1A00, 1, 4, 0) == 0
    for place, entry in enumerate(entries, 1):
        write(0x1A00, place, 4, entry)
    assert write(0x1A00, 0, 1, count) == code
    assert write(0x1800, 1, 4, 0x181) == write(0x1800, 5, 2, 10) == 0
    left.order(1)
    assert [len(frame.data) for frame in left.cyclic(10**9) if frame.can_id == 0x181] == [0 if code else 8]

"""The packets a RoboClaw knows, and their checksum (User Manual pp. 58-59, command tables), apart from the driver's."""

from drivers.mock.roboclaw_settings import READ_COMMANDS, WRITE_LAYOUTS

WRITES = {
    0: ">B",
    1: ">B",
    4: ">B",
    5: ">B",
    6: ">B",
    7: ">B",
    8: ">B",
    9: ">B",
    10: ">B",
    11: ">B",
    12: ">B",
    13: ">B",
    14: ">B",
    20: "",
    22: ">i",
    23: ">i",
    28: ">IIII",
    29: ">IIII",
    32: ">h",
    33: ">h",
    34: ">hh",
    35: ">i",
    36: ">i",
    37: ">ii",
    38: ">Ii",
    39: ">Ii",
    40: ">Iii",
    50: ">IiIi",
    52: ">hI",
    53: ">hI",
    54: ">hIhI",
    200: "",
    **WRITE_LAYOUTS,
}
"""Data of every command that is answered by FF."""
READS = {15, 16, 17, 18, 19, 21, 24, 25, 30, 31, 47, 48, 49, 55, 56, 78, 79, 82, 83, 90, 108, 111, 114} | READ_COMMANDS
BOTH = {8, 9, 10, 11, 12, 13, 34, 37, 40, 50, 54}
FIRST = {0, 1, 6, 32, 35, 38, 52}
SECOND = {4, 5, 7, 33, 36, 39, 53}
"""Commands that drive both motors, the first, the second."""


def _crc_table() -> list[int]:
    table = []
    for index in range(256):
        value = index << 8
        for _ in range(8):
            value = ((value << 1) ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
        table.append(value)
    return table


_CRC_TABLE = _crc_table()


def crc16(data: bytes) -> int:
    """CRC-16 with polynomial 0x1021 and start value 0, byte by byte."""
    value = 0
    for byte in data:
        value = (value << 8 & 0xFFFF) ^ _CRC_TABLE[value >> 8 ^ byte]
    return value

"""ros_arduino_bridge ASCII, as spoken by many home-made motor controllers: pure encode and decode.

Source: hbrobotics/ros_arduino_bridge, README "Firmware commands" and ``commands.h``. Commands end
with CR: ``m L R`` (encoder ticks per PID frame, whole numbers), ``e`` (read encoders), ``r``
(reset them); answers end with CR LF: ``OK``, ``L R``, ``Invalid Command``. No checksum.
"""

import re
from collections import Counter

READ_ENCODERS = b"e\r"
RESET_ENCODERS = b"r\r"
MAX_TICKS = 9999
"""Per frame; four digits keep the command short."""
MAX_LINE = 40

_PAIR = re.compile(rb"(-?\d{1,11}) (-?\d{1,11})")


def motor_speeds(left_ticks: int, right_ticks: int) -> bytes:
    """Ticks per PID frame of each wheel."""
    return b"m %d %d\r" % (left_ticks, right_ticks)


class LineReader:
    """Encoder pairs from the byte stream; every other line is counted by name."""

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self._rest = b""

    def reset(self) -> None:
        """Forget what has arrived: the port was reopened."""
        self._rest = b""

    def feed(self, data: bytes) -> list[tuple[int, int]]:
        buffer = self._rest + data
        lines = buffer.splitlines()
        rest = lines.pop() if buffer and buffer[-1] not in b"\r\n" else b""
        if len(rest) > MAX_LINE:
            self.counters["garbage_line"] += 1
            rest = b""
        self._rest = rest
        pairs = []
        for line in lines:
            if line == b"OK" or not line:
                continue
            match = _PAIR.fullmatch(line)
            if match:
                left, right = int(match[1]), int(match[2])
                if -(2**31) <= left < 2**31 and -(2**31) <= right < 2**31:
                    pairs.append((left, right))
                    continue
            self.counters["refused_command" if line == b"Invalid Command" else "garbage_line"] += 1
        return pairs

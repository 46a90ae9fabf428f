"""Links and targets once more as point clouds, for viewers without scenes: rerun reads foxglove.PointCloud. Pure."""

import math
import struct
from collections.abc import Iterable, Iterator
from typing import Any

from foxglove import messages as fx

from contract.units import Point

Color = tuple[float, float, float]
"""Red, green, blue, 0 to 1."""
SPACING_M = 0.04
"""Between the dots of a link."""
_DOT = struct.Struct("<fffBBBB")
"""x, y, z in m; red, green, blue, alpha."""
_FIELDS = [
    fx.PackedElementField(name=name, offset=offset, type=kind)
    for name, offset, kind in (
        ("x", 0, fx.PackedElementFieldNumericType.Float32),
        ("y", 4, fx.PackedElementFieldNumericType.Float32),
        ("z", 8, fx.PackedElementFieldNumericType.Float32),
        ("red", 12, fx.PackedElementFieldNumericType.Uint8),
        ("green", 13, fx.PackedElementFieldNumericType.Uint8),
        ("blue", 14, fx.PackedElementFieldNumericType.Uint8),
        ("alpha", 15, fx.PackedElementFieldNumericType.Uint8),
    )
]


def along(a: Point, b: Point) -> Iterator[Point]:
    """The dots of a line, both ends included."""
    count = max(1, round(math.dist(a, b) / SPACING_M))
    for k in range(count + 1):
        yield a[0] + (b[0] - a[0]) * k / count, a[1] + (b[1] - a[1]) * k / count


def cloud(stamp: Any, frame: str, dots: Iterable[tuple[Point, Color]]) -> Any:
    """A foxglove.PointCloud of places, m."""
    data = b"".join(
        _DOT.pack(x_m, y_m, 0.005, *(round(255 * part) for part in color), 255) for (x_m, y_m), color in dots
    )
    upright = fx.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    origin = fx.Pose(position=fx.Vector3(x=0.0, y=0.0, z=0.0), orientation=upright)
    return fx.PointCloud(
        timestamp=stamp, frame_id=frame, pose=origin, point_stride=_DOT.size, fields=_FIELDS, data=data
    )
